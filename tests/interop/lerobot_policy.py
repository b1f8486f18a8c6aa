"""LeRobot's own policy server moves a simulated robot by `ta2 policy run`; run by `bin/interop lerobot` with its interpreter.

The policy is an ACT of few parameters, not trained, whose statistics let it say little else than where the arms shall go: 0.05
rad away from where they are. The server is killed and started anew while it plays.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.e2e.system import Process, System, free_port, wait_for

AWAY_RAD, NEAR_RAD = 0.05, 0.01
PICTURE = "observation.images.head_camera"
MAKE = """
import sys
import torch
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.factory import make_pre_post_processors

folder, picture, *row = sys.argv[1:]
row = torch.tensor([float(value) for value in row])
seen = {"observation.state": PolicyFeature(FeatureType.STATE, (len(row),))}
seen[picture] = PolicyFeature(FeatureType.VISUAL, (3, 64, 64))
config = ACTConfig(
    device="cpu", chunk_size=30, n_action_steps=30, dim_model=16, n_heads=2, dim_feedforward=16, n_encoder_layers=1,
    n_decoder_layers=1, use_vae=False, pretrained_backbone_weights=None, push_to_hub=False, input_features=seen,
    output_features={"action": PolicyFeature(FeatureType.ACTION, (len(row),))},
)
zero, one = torch.zeros(len(row)), torch.ones(len(row))
stats = {"observation.state": {"mean": zero, "std": one}, "action": {"mean": row, "std": one * 1e-3}}
stats[picture] = {"mean": torch.zeros(3, 1, 1), "std": torch.ones(3, 1, 1)}
torch.manual_seed(0)
for made in (ACTPolicy(config), *make_pre_post_processors(config, dataset_stats=stats)):
    made.save_pretrained(folder)
"""


def main(python: Path, folder: Path) -> int:
    """Run it; return the exit status."""
    for name in ("played", "served"):
        (folder / name).mkdir(parents=True)
    port, video = free_port(), free_port()
    system = System(folder / "played", has_guard=False, sim_options=("--camera-to", f"127.0.0.1:{video}"))
    server: subprocess.Popen[bytes] | None = None
    log = (folder / "server.log").open("ab")

    def serve() -> subprocess.Popen[bytes]:
        words = [python, "-m", "lerobot.async_inference.policy_server", "--host=127.0.0.1", f"--port={port}"]
        return subprocess.Popen(words, cwd=folder / "served", stdout=log, stderr=log)

    try:
        system.connect().close()
        q_rad = np.array(system.arm_q())
        q_rad[[0, 7]] += AWAY_RAD
        row = np.zeros(72)
        row[0:7], row[8:15], row[[39, 47]] = q_rad[:7], q_rad[7:], -0.8
        subprocess.run([python, "-c", MAKE, folder / "act", PICTURE, *map(str, row)], check=True)
        own_map = folder / "map.toml"
        keys = f'state_key = "observation.state"\nstate = 72\nprompt_key = "task"\n[observation.images]\n"{PICTURE}"'
        columns = '"left_arm", "ignored_1", "right_arm", "ignored_24", "left_gripper_effort", "ignored_7"'
        columns += ', "right_gripper_effort", "ignored_24"'
        own_map.write_text(f'[observation]\n{keys} = "head_left_eye"\n[actions]\ncolumns = [{columns}]\n')
        server = serve()
        wait_for(lambda: "PolicyServer started" in Path(log.name).read_text(), "LeRobot's server", 120.0)
        words = ["--server", f"grpc://127.0.0.1:{port}", "--policy", f"act:{folder / 'act'}", "--map", str(own_map)]
        words += ["--socket", system.target, "--video-port", str(video), "--patience", "60", "--timeout", "10"]
        words += ["--seconds", "60", "--hz", "10", "--yes", "--hold", "--json"]  # long chunks: the machine may be slow
        policy = Process("policy", ["-m", "gateway.cli", "policy", "run", *words], system.folder)
        wait_for(lambda: apart(system, q_rad) < NEAR_RAD, "the arms", 90.0, policy.text)
        print(f"LeRobot's policy server: the arms came to {apart(system, q_rad):.4f} rad of where its policy says")
        server.kill()
        server.wait()
        lost = "DISCONNECTED: the policy server"
        wait_for(lambda: lost in policy.text(), "a server that is missed", 60.0, policy.text)
        server = serve()
        wait_for(
            lambda: "plays again" in policy.text().rpartition(lost)[2], "a policy that plays again", 90.0, policy.text
        )
        assert policy.wait(120.0) == 0, policy.text()
        told = json.loads(next(line for line in policy.text().splitlines() if line.startswith("{")))
        print(f"  {told['chunks']} chunks, inference {told['inference_ms']}, lost its server and played again")
        assert told["chunks"] > 5 and apart(system, q_rad) < NEAR_RAD
    finally:
        if server is not None:
            server.kill()
            server.wait()
        log.close()
        system.close()
    return 0


def apart(system: System, q_rad: np.ndarray) -> float:
    """Return how far the farthest joint is from where it shall be [rad]."""
    return float(np.abs(np.array(system.arm_q()) - q_rad).max())


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
