"""`ta2 frames`: the tree of manual appendix A with where each frame is, one chain of it, the same as JSON, or a picture.

The JSON obeys the manual's own conventions (A.1) and says so: row-major matrices in millimetres, quaternions xyzw.
"""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from msgspec.structs import asdict
from rich.console import Console
from rich.text import Text

from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.figures import age_text
from gateway.errors import Code, GatewayError, failure
from gateway.kinematics.calibration import RobotIdentity, load
from gateway.kinematics.calibration_file.conventions import MANUAL
from gateway.kinematics.frames import ROOT, FrameTree, Located
from gateway.kinematics.sight import Sight
from gateway.kinematics.transform import Transform
from gateway.kinematics.urdf import from_urdf
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings import toml_file
from gateway.values import ArmState, Side, ValueRefused

__all__ = ["Posture", "carry_out", "chain_document", "document", "kind_of", "lines", "measured"]

STYLES = {"nominal": "", "this robot": "green", "stand-in": "yellow", "joints": "cyan", "ours": "dim"}
"""Kinds of edges with their colours."""

MEANINGS = {
    "nominal": "of the model (A.3)",
    "this robot": "calibrated on this robot (A.4)",
    "stand-in": "nominal, where this robot's own calibration is needed (A.4)",
    "joints": "moves with the joints (A.5)",
    "ours": "not in the manual's tree",
}


WIDTH = 38
"""Of the column with the tree."""

PICTURES = (".png", ".svg", ".pdf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Posture:
    """Where the arms are.

    Attributes:
        joints: Per arm; one of which nothing is known is missing.
        source: Where that is from, for people.
        is_measured: Whether the robot measured it: only then do stamps mean anything.
    """

    joints: Mapping[Side, ArmState] = field(default_factory=dict)
    source: str
    is_measured: bool


def carry_out(options: Namespace) -> ExitStatus:
    """Print them.

    Raises:
        ConfigError: The calibration is not this robot's, or a file cannot be read.
        Disconnected: No gateway answers.
        Rejected: There is no such frame, joints are not finite, or no picture can be drawn.
        Stale: The gateway has no joints of an arm that the chain needs.
    """
    link = toml_file.load(options.config).link
    serial = link.serial if options.serial is None else options.serial
    identity = RobotIdentity(serial=serial, model=link.model) if serial else None
    calibration = None if options.calibration is None else load(Path(options.calibration), identity)
    tree = Sight.of(calibration, None if options.urdf is None else from_urdf(Path(options.urdf))).tree
    given = {side: joints for side in Side if (joints := getattr(options, side.value)) is not None}
    posture = measured(options.target, options.timeout_s) if options.live else _given(given)
    if options.plot is not None:
        _draw(tree, posture, Path(options.plot))
    if options.chain is not None:
        parent, child = options.chain
        located = tree.locate(parent, child, posture.joints)
        shown, texts = chain_document(located, posture), _chain_lines(located, posture)
    else:
        shown, texts = document(tree, posture), lines(tree, posture)
    if options.json:
        print(json.dumps(shown, ensure_ascii=False, indent=2))
        return ExitStatus.OK
    Console(highlight=False).print(*texts, sep="\n", soft_wrap=True)
    return ExitStatus.OK


def measured(target: str | None, timeout_s: float) -> Posture:
    """Return the joints that the gateway sees now.

    Args:
        target: Where the gateway is; None finds its socket.
        timeout_s: Longest wait for it [s].

    Raises:
        Disconnected: No gateway answers.
    """
    with connected("frames", target, timeout_s) as robot:
        arms = robot.state.view.arms
    seen = {side: arm for side in Side if (arm := arms[side.value].measured) is not None}
    ages = ", ".join(f"{side} {age_text(arm.age_ns)} old" for side, arm in seen.items()) or "none yet"
    return Posture(
        joints={
            side: ArmState(q_rad=arm.q_rad, dq_radps=arm.dq_radps, tau_nm=arm.tau_nm, stamp_ns=arm.stamp_ns)
            for side, arm in seen.items()
        },
        source=f"measured: {ages}",
        is_measured=True,
    )


def _given(joints: Mapping[Side, Sequence[float]]) -> Posture:
    try:
        states = {
            side: ArmState(q_rad=tuple(joints.get(side, HOME_Q_RAD[side])), dq_radps=(), tau_nm=(), stamp_ns=0)
            for side in Side
        }
    except ValueRefused as error:
        raise failure(Code.NOT_FINITE, f"joints: {error}", field="joints") from None
    sources = [f"{side} {'as given' if side in joints else 'at the initial position of §6.6'}" for side in Side]
    return Posture(joints=states, source=", ".join(sources), is_measured=False)


def _draw(tree: FrameTree, posture: Posture, path: Path) -> None:
    """Write the picture, or say what is in its way."""
    if path.suffix not in PICTURES:
        raise _no_picture(f"{path} is no picture", f"one of {', '.join(PICTURES)}")
    try:
        from gateway.cli.body.frames_plot import write_picture
    except ImportError:
        raise _no_picture("matplotlib is not installed", "pip install 'teleavatar-gateway[demo]'") from None
    try:
        kinds = {frame: kind_of(tree, frame) for frame in tree.frames}
        write_picture(tree, posture.joints, kinds, posture.source, path)
    except OSError as error:
        raise _no_picture(f"{path}: {error.strerror or error}", "name a place that can be written") from None


def _no_picture(message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, f"no picture: {message}", field="plot", hint=hint)


# ----------------------------------------------------------------------------------------------------------------- text


def kind_of(tree: FrameTree, frame: str) -> str:
    """Return what places a frame in its parent, a key of `MEANINGS`."""
    edge = tree.edge(frame)
    if edge is None:
        return "joints"
    if edge.is_of_one_robot:
        return "this robot"
    if edge.is_stand_in:
        return "stand-in"
    return "ours" if frame.endswith(("_shoulder_base", "_wrist_right_camera")) else "nominal"


def lines(tree: FrameTree, posture: Posture) -> Iterator[Text]:
    """Yield the tree, a frame each: where it is in its parent and in the root, and what places it there."""
    yield Text(f"joints: {posture.source}", style="dim")
    yield Text(f"{'':<{WIDTH}} {'in its parent [mm]':>25}   {'in ' + ROOT + ' [mm]':>25}   placed by", style="dim")
    yield from _branch(tree, posture, ROOT, "", "")
    kinds = {kind_of(tree, frame) for frame in tree.frames if frame != ROOT}
    for kind, meaning in MEANINGS.items():
        if kind in kinds:
            yield Text(f"  {kind}: {meaning}", style="dim")


def _branch(tree: FrameTree, posture: Posture, frame: str, lead: str, hook: str) -> Iterator[Text]:
    parent = tree.parent(frame)
    if parent is None:
        yield Text(frame, style="bold")
    else:
        kind = kind_of(tree, frame)
        place = f"{_place(tree, posture, parent, frame)}   {_place(tree, posture, ROOT, frame)}"
        yield Text.assemble(
            (f"{lead}{hook}", "dim"), f"{frame:<{WIDTH - len(lead + hook)}} {place}   ", (kind, STYLES[kind])
        )
    children = tree.children(frame)
    below = "" if parent is None else lead + ("│  " if hook == "├─ " else "   ")
    for child in children:
        yield from _branch(tree, posture, child, below, "└─ " if child == children[-1] else "├─ ")


def _place(tree: FrameTree, posture: Posture, parent: str, child: str) -> str:
    if not set(tree.sides_between(parent, child)) <= set(posture.joints):
        return f"{'no joints':>25}"
    x, y, z = (1e3 * tree.locate(parent, child, posture.joints).transform.p_m).tolist()
    return f"{x:>+8.1f} {y:>+7.1f} {z:>+8.1f}"


def _chain_lines(located: Located, posture: Posture) -> Iterator[Text]:
    transform = located.transform
    yield Text(f"{transform.name} =", style="bold")
    for step in located.edges:
        yield Text(f"  {step}", style="yellow" if step in located.stand_ins else "")
    for row in _in_mm(transform):
        yield Text("  [" + " ".join(f"{value:>12.6f}" for value in row) + " ]   (mm)")
    x, y, z, w = transform.quat_xyzw.tolist()
    yield Text(f"quaternion xyzw {x:+.6f} {y:+.6f} {z:+.6f} {w:+.6f}")
    for side, stamp_ns in located.stamps_ns.items():
        when = f"stamp {stamp_ns / 1e9:.3f} s of the robot's clock" if posture.is_measured else "not measured"
        yield Text(f"joints of the {side} arm: {when} ({posture.source})")
    for name in located.stand_ins:
        yield Text(f"stand-in: {name} is nominal; this robot's own calibration is needed (A.4)", style="yellow")


# ----------------------------------------------------------------------------------------------------------------- JSON


def _in_mm(transform: Transform) -> list[list[float]]:
    matrix = transform.matrix.copy()
    matrix[:3, 3] *= 1e3
    rows: list[list[float]] = matrix.tolist()
    return rows


def document(tree: FrameTree, posture: Posture) -> dict[str, object]:
    """Return the tree for scripts: every transform with its facts (A.4), and where each frame is in the root.

    Args:
        tree: All frames.
        posture: Where the arms are; what needs an arm that is missing has no matrix.
    """
    transforms: dict[str, object] = {}
    for frame in tree.frames:
        parent, edge = tree.parent(frame), tree.edge(frame)
        if parent is None:
            continue
        is_known = set(tree.sides_between(ROOT, frame)) <= set(posture.joints)
        located = tree.locate(parent, frame, posture.joints) if is_known else None
        transforms[f"{parent}_T_{frame}"] = {
            "parent_frame": parent,
            "child_frame": frame,
            "source": "forward_kinematics" if edge is None else edge.origin.value,
            "device_specific": edge is not None and edge.is_of_one_robot,
            "kind": kind_of(tree, frame),
            "note": "" if edge is None else edge.note,
            "stamp_ns": located.stamp_ns if located is not None and posture.is_measured else None,
            "matrix": None if located is None else _in_mm(located.transform),
            f"in_{ROOT}": _in_mm(tree.locate(ROOT, frame, posture.joints).transform) if is_known else None,
        }
    return {"conventions": asdict(MANUAL), "joints": posture.source, "transforms": transforms}


def chain_document(located: Located, posture: Posture) -> dict[str, object]:
    """Return one transform for scripts."""
    transform = located.transform
    return {
        "conventions": asdict(MANUAL),
        "parent_frame": transform.parent,
        "child_frame": transform.child,
        "matrix": _in_mm(transform),
        "translation": (1e3 * transform.p_m).tolist(),
        "quaternion": transform.quat_xyzw.tolist(),
        "edges": list(located.edges),
        "stand_ins": list(located.stand_ins),
        "joints": posture.source,
        "stamps_ns": {str(side): stamp if posture.is_measured else None for side, stamp in located.stamps_ns.items()},
    }
