"""What is drawn, as Rerun has it: the body of the collision model, frames, hands, joints over time, and what was told.

All is in `virtual_base` [m] (manual A.2). The body is capsules at the measured joints, grippers wide open, the lift at its top:
nobody publishes where it is (§4.12). A hand has two places: by the model (`left_ee`), and by the robot itself (`measured`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from gateway.kinematics.collision import CollisionModel, Posture
from gateway.kinematics.frames import ROOT, FrameTree
from gateway.robot.topics import shoulder_frame
from gateway.values import ARM_DOF, ArmState, Side, Vector

__all__ = ["Scene"]

CHEST = f"{ROOT}/chest"
COLOURS = {Side.LEFT: (80, 150, 220), Side.RIGHT: (230, 150, 60), None: (150, 150, 150)}
AXES = ((220, 60, 60), (60, 180, 60), (70, 90, 230))  # colours of x, y and z
AXIS_M, MEASURED_M = 0.05, 0.09  # lengths of axes
NOWHERE = rr.Transform3D(quaternion=rr.Quaternion(xyzw=[0.0] * 4))  # no place to Rerun: nothing in it is shown
LEVELS = {"warning": "WARN"}  # where our word for a level is not Rerun's in capitals

Vectors = Mapping[Side, Vector]
Hands = Mapping[Side, tuple[Vector, Vector]]


class Scene:
    """Draws a robot, its frames and its hull, into a stream; what does not change is drawn at once."""

    def __init__(self, stream: rr.RecordingStream, tree: FrameTree, body: CollisionModel) -> None:
        self._stream, self._tree, self._body = stream, tree, body
        self._drawn: set[str] = set()
        names = [capsule.name for capsule in body.capsules]
        self._pairs = {frozenset({names[i], names[j]}): number for number, (i, j, *_) in enumerate(body.pairs)}
        stream.send_blueprint(_arrangement())
        stream.log(ROOT, rr.ViewCoordinates.FLU, static=True)  # x forward, y left, z up (A.1)
        for frame in tree.frames:
            self._log_axes(self._path(frame), AXIS_M)
            if tree.edge(frame) is not None:
                self._place(frame, {}, static=True)
        shoulders = [tree.locate(ROOT, shoulder_frame(side)).transform for side in Side]
        middle_m = np.mean([shoulder.p_m for shoulder in shoulders], axis=0)
        stream.log(CHEST, rr.Transform3D(translation=middle_m, mat3x3=shoulders[0].rotation), static=True)
        self._measured = {side: f"{self._path(shoulder_frame(side))}/measured" for side in Side}
        self._hands = {*self._measured.values(), *(self._path(f"{side}_ee") for side in Side)}
        self._drawn = set(self._hands)  # what may move, at first too: an arm that is not known is nowhere
        for side in Side:
            self._log_axes(self._measured[side], MEASURED_M)
            for kind, width in (("measured", 1.5), ("setpoint", 0.7)):
                lines = rr.SeriesLines(names=[f"{kind} {n + 1}" for n in range(ARM_DOF)], widths=[width] * ARM_DOF)
                stream.log(f"joints/{side}/{kind}", lines, static=True)
            stream.log(f"hands/{side}", rr.SeriesLines(names=[f"{side} {axis}" for axis in "xyz"]), static=True)

    def show(self, at_ns: int, joints: Vectors, told: Vectors, hands: Hands, nearest: Collection[str] = ()) -> None:
        """Draw an instant [ns] from whatever beginning; of an arm that is not known there nothing stays to be seen.

        Joints as measured and as told, shape (7,) each [rad]; measured hands in their shoulder frames, position [m] and
        quaternion xyzw; names of the two parts of the body that are nearest to each other, none where nobody says it.
        """
        self._go_to(at_ns)
        before, self._drawn = self._drawn, set()
        states = {side: ArmState(q_rad=q, dq_radps=(), tau_nm=(), stamp_ns=0) for side, q in joints.items()}
        for side, q_rad in joints.items():
            self._draw(f"joints/{side}/measured", rr.Scalars(q_rad))
            self._place(f"{side}_ee", states)
        for side, q_rad in told.items():
            self._draw(f"joints/{side}/setpoint", rr.Scalars(q_rad))
        for side, (p_m, quat_xyzw) in hands.items():
            self._draw(f"hands/{side}", rr.Scalars(p_m))
            self._draw(self._measured[side], _transform(p_m, quat_xyzw))
        if len(joints) == len(Side):
            self._show_body(self._body.posture(joints), self._pairs.get(frozenset(nearest)))
        for path in before - self._drawn:  # Rerun would show for ever what it was told last
            self._stream.log(path, NOWHERE if path in self._hands else rr.Clear(recursive=False))

    def tell(self, at_ns: int, level: str, text: str) -> None:
        """Add a line to the text log; its level is `info`, `warning` or `error`."""
        self._go_to(at_ns)
        self._stream.log("events", rr.TextLog(text, level=LEVELS.get(level, level.upper())))

    def picture(self, at_ns: int, views: Mapping[str, npt.NDArray[np.uint8]]) -> None:
        """Show pictures of the cameras by name (§5.2), RGB, shape (height, width, 3); as JPEG of half their size."""
        self._go_to(at_ns)
        for name, rgb in views.items():
            self._stream.log(f"cameras/{name}", rr.Image(np.ascontiguousarray(rgb[::2, ::2])).compress(75))

    def _go_to(self, at_ns: int) -> None:
        self._stream.set_time("time", duration=np.timedelta64(at_ns, "ns"))

    def _path(self, frame: str) -> str:
        parent = self._tree.parent(frame)
        return frame if parent is None else f"{self._path(parent)}/{frame}"

    def _place(self, frame: str, states: Mapping[Side, ArmState], *, static: bool = False) -> None:
        place = self._tree.locate(self._tree.parent(frame) or ROOT, frame, states).transform
        self._draw(self._path(frame), _transform(place.p_m, place.quat_xyzw), static=static)

    def _draw(self, path: str, what: rr.AsComponents, *, static: bool = False) -> None:
        self._stream.log(path, what, static=static)
        self._drawn.add(path)

    def _log_axes(self, path: str, length_m: float) -> None:
        arrows = rr.Arrows3D(vectors=length_m * np.eye(3), colors=AXES, radii=0.002)
        self._stream.log(f"{path}/axes", arrows, static=True)

    def _show_body(self, posture: Posture, pair: int | None) -> None:
        capsules = self._body.capsules
        body = rr.Capsules3D(
            lengths=[math.sqrt(square) for *_, square in posture.segments],
            radii=[capsule.radius_m for capsule in capsules],
            translations=[segment[:3] for segment in posture.segments],
            quaternions=[_along(u, v, w) for _, _, _, u, v, w, _ in posture.segments],
            colors=[COLOURS[capsule.side] for capsule in capsules],
            fill_mode="TransparentFillMajorWireframe",
            labels=[capsule.name for capsule in capsules],
            show_labels=False,
        )
        self._draw(f"{CHEST}/body", body)
        near = [] if pair is None else [posture.told(pair)]
        lines = [[one.first_m, one.second_m] for one in near]
        self._draw(f"{CHEST}/nearest", rr.LineStrips3D(lines, colors=[(255, 40, 40)], radii=0.004))
        for one in near:
            self._draw("gap", rr.Scalars(one.gap_m))


def _transform(p_m: npt.ArrayLike, quat_xyzw: npt.ArrayLike) -> rr.Transform3D:
    return rr.Transform3D(translation=np.asarray(p_m), quaternion=rr.Quaternion(xyzw=np.asarray(quat_xyzw)))


def _along(x: float, y: float, z: float) -> Vector:
    """Return the quaternion xyzw that turns the z axis, along which Rerun's capsules lie, to a direction."""
    length = math.sqrt(x * x + y * y + z * z)
    if length + z < 1e-9:  # straight down, or no direction at all
        return 1.0, 0.0, 0.0, 0.0
    norm = math.sqrt(2.0 * length * (length + z))
    return 0.0 - y / norm, x / norm, 0.0, (length + z) / norm


def _arrangement() -> rrb.Blueprint:
    joints = [rrb.TimeSeriesView(origin=f"joints/{side}", name=f"{side} joints [rad]") for side in Side]
    hands = rrb.TimeSeriesView(origin="hands", name="hands in their shoulder frames [m]")
    gap = rrb.TimeSeriesView(origin="gap", name="nearest parts of the body [m]")
    camera = rrb.Spatial2DView(origin="cameras/head_left_eye", name="camera")
    robot, events = rrb.Spatial3DView(origin=ROOT, name="robot"), rrb.TextLogView(origin="events", name="events")
    right = rrb.Vertical(*joints, rrb.Tabs(hands, gap, camera))
    views = rrb.Horizontal(rrb.Vertical(robot, events, row_shares=[3, 1]), right, column_shares=[3, 2])
    return rrb.Blueprint(
        views, rrb.TimePanel(timeline="time", state="collapsed"), rrb.SelectionPanel(state="collapsed")
    )
