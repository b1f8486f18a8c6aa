"""A robot's node that is there the instant it is wanted, and tells what it is handed: `python -m tests.interop.watched_robot`.

As `dds_robot.py`, without a bridge. A Python process needs a second to start; this one is ready before, and joins its graph
when the file of `--go` is there. It writes a line for each heartbeat and each arm's setpoint that arrives, with the time
since it joined and the age by its stamp where it has one, and a line for each value of its FSM.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from pycdr2 import IdlStruct

from gateway.cli.command_line.arguments import parse
from gateway.sim.node import SimNode, main_sim
from gateway.sim.robot.manual import FSM_ENABLE, Side, joint_cmd_topic
from gateway.sim.robot.settings import SimSettings, settings_of
from tests.interop.dds_robot import DdsRobot

__all__ = ["main"]

ARMS: Final = tuple(map(joint_cmd_topic, Side))


class WatchedRobot(DdsRobot):
    """Tells what it is handed."""

    _joined_s: float = 0.0
    _fsm: int | None = None

    def join(self) -> None:
        """Let the node join the graph, and say so."""
        super().join()
        self._joined_s = time.monotonic()
        self._tell(f"joined {self._joined_s:.3f}")

    def read(self, topic: str, payload: bytes) -> IdlStruct:
        """Return the message of a command sample, and tell of it.

        Raises:
            ValueError: If it is none.
        """
        message = super().read(topic, payload)
        if topic == FSM_ENABLE:
            self._tell(f"heartbeat {message.data}")  # type: ignore[attr-defined]  # a Float32
        elif topic in ARMS:
            stamp = message.header.stamp  # type: ignore[attr-defined]  # a JointState
            self._tell(f"setpoint {topic} {time.time() - stamp.sec - stamp.nanosec * 1e-9:.2f} s old")
        return message

    def step(self, now_ns: int) -> None:
        """Live until now, and tell what becomes of the FSM."""
        super().step(now_ns)
        if (value := self.robot.fsm.published) != self._fsm:
            self._fsm = value
            self._tell(f"fsm {value}")

    def _tell(self, what: str) -> None:
        print(f"{time.monotonic() - self._joined_s:.3f} {what}", flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Wait for the word, then run until SIGTERM; return the exit code."""
    parser = argparse.ArgumentParser(description="All else as for `ta2 sim`.", allow_abbrev=False)
    parser.add_argument("--control", required=True, help="endpoint of the control channel")
    parser.add_argument("--folder", required=True, type=Path, help="for its files")
    parser.add_argument("--go", required=True, type=Path, help="a file that does not exist yet")
    options, words = parser.parse_known_args(arguments)
    sim = parse(["sim", *words])
    print("waiting", flush=True)
    while not options.go.exists():
        time.sleep(0.002)

    def make(settings: SimSettings, listen: str) -> SimNode:
        return WatchedRobot(settings, listen, control=options.control, folder=options.folder, has_bridge=False)

    return main_sim(sim.listen, settings_of(sim), make=make)


if __name__ == "__main__":
    sys.exit(main())
