"""What is drawn, as Rerun has it: the body of the collision model, frames, hands, joints over time, and what was told.

All is in `virtual_base` [m] (manual A.2). The body is capsules at the measured joints, grippers wide open, the lift at its top:
nobody publishes where it is (§4.12). A hand has two places: by the model (`left_ee`), and by the robot itself (`measured`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.frames import ROOT, FrameTree
from gateway.robot.topics import shoulder_frame
from gateway.values import ARM_DOF, ArmState, Side, Vector

__all__ = ["Moment", "Scene"]

CHEST = f"{ROOT}/chest"
COLOURS = {Side.LEFT: (80, 150, 220), Side.RIGHT: (230, 150, 60), None: (150, 150, 150)}
AXES = ((220, 60, 60), (60, 180, 60), (70, 90, 230))
"""Colours of x, y and z."""
AXIS_M, MEASURED_M = 0.05, 0.09
LEVELS = {"warning": "WARN"}
"""Where our word for a level is not Rerun's in capitals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """What is shown of one instant; an arm of which something is not known is missing there.

    Attributes:
        at_ns: On the scene's clock [ns].
        q_rad: Measured joints, shape (7,) each [rad].
        q_ref_rad: Setpoints of joints, likewise.
        hands: Measured poses in the shoulder frames: position [m], quaternion xyzw.
        pair: Names of the two parts of the body that are nearest to each other; None where nobody says it.
        gap_m: Their distance [m].
    """

    at_ns: int
    q_rad: Mapping[Side, Vector]
    q_ref_rad: Mapping[Side, Vector]
    hands: Mapping[Side, tuple[Vector, Vector]]
    pair: tuple[str, str] | None = None
    gap_m: float | None = None


class Scene:
    """Draws into a stream; what does not change is drawn at once.

    Args:
        stream: Where to.
        tree: Frames of this robot.
        body: Its hull.
        timeline: Name of the clock.
        is_since_1970: Whether its times count from 1970; else from some beginning, as a monotonic clock does.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        tree: FrameTree,
        body: CollisionModel,
        timeline: str,
        *,
        is_since_1970: bool = False,
    ) -> None:
        self._stream, self._tree, self._body = stream, tree, body
        self._timeline, self._is_since_1970 = timeline, is_since_1970
        names = [capsule.name for capsule in body.capsules]
        self._pairs = {frozenset({names[i], names[j]}): number for number, (i, j, *_) in enumerate(body.pairs)}
        stream.send_blueprint(_arrangement(timeline))
        stream.log(ROOT, rr.ViewCoordinates.FLU, static=True)  # x forward, y left, z up (A.1)
        for frame in tree.frames:
            self._log_axes(self._path(frame), AXIS_M)
            if tree.edge(frame) is not None:
                self._place(frame, {}, static=True)
        shoulders = [tree.locate(ROOT, shoulder_frame(side)).transform for side in Side]
        middle_m = np.mean([shoulder.p_m for shoulder in shoulders], axis=0)
        stream.log(CHEST, rr.Transform3D(translation=middle_m, mat3x3=shoulders[0].rotation), static=True)
        for side in Side:
            self._log_axes(self._measured(side), MEASURED_M)
            for kind, width in (("measured", 1.5), ("setpoint", 0.7)):
                lines = rr.SeriesLines(names=[f"{kind} {n + 1}" for n in range(ARM_DOF)], widths=[width] * ARM_DOF)
                stream.log(f"joints/{side}/{kind}", lines, static=True)
            stream.log(f"hands/{side}", rr.SeriesLines(names=[f"{side} {axis}" for axis in "xyz"]), static=True)

    def show(self, moment: Moment) -> None:
        """Draw an instant; the body where the joints of both arms are known."""
        self._go_to(moment.at_ns)
        log = self._stream.log
        states = {side: ArmState(q_rad=q, dq_radps=(), tau_nm=(), stamp_ns=0) for side, q in moment.q_rad.items()}
        for side, q_rad in moment.q_rad.items():
            log(f"joints/{side}/measured", rr.Scalars(q_rad))
            self._place(f"{side}_ee", states)
        for side, q_rad in moment.q_ref_rad.items():
            log(f"joints/{side}/setpoint", rr.Scalars(q_rad))
        for side, (p_m, quat_xyzw) in moment.hands.items():
            log(f"hands/{side}", rr.Scalars(p_m))
            log(self._measured(side), _transform(p_m, quat_xyzw))
        if moment.gap_m is not None:
            log("gap", rr.Scalars(moment.gap_m))
        if len(moment.q_rad) == len(Side):
            self._show_body(moment)

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
        if self._is_since_1970:
            self._stream.set_time(self._timeline, timestamp=np.datetime64(at_ns, "ns"))
        else:
            self._stream.set_time(self._timeline, duration=np.timedelta64(at_ns, "ns"))

    def _path(self, frame: str) -> str:
        """Return the entity of a frame, below that of its parent."""
        parent = self._tree.parent(frame)
        return frame if parent is None else f"{self._path(parent)}/{frame}"

    def _measured(self, side: Side) -> str:
        return f"{self._path(shoulder_frame(side))}/measured"

    def _place(self, frame: str, states: Mapping[Side, ArmState], *, static: bool = False) -> None:
        """Draw where a frame is in its parent."""
        place = self._tree.locate(self._tree.parent(frame) or ROOT, frame, states).transform
        self._stream.log(self._path(frame), _transform(place.p_m, place.quat_xyzw), static=static)

    def _log_axes(self, path: str, length_m: float) -> None:
        self._stream.log(
            f"{path}/axes", rr.Arrows3D(vectors=length_m * np.eye(3), colors=AXES, radii=0.002), static=True
        )

    def _show_body(self, moment: Moment) -> None:
        posture, capsules = self._body.posture(moment.q_rad), self._body.capsules
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
        number = None if moment.pair is None else self._pairs.get(frozenset(moment.pair))
        nearest = None if number is None else posture.told(number)
        line = [] if nearest is None else [[nearest.first_m, nearest.second_m]]
        self._stream.log(f"{CHEST}/body", body)
        self._stream.log(f"{CHEST}/nearest", rr.LineStrips3D(line, colors=[(255, 40, 40)], radii=0.004))


def _transform(p_m: npt.ArrayLike, quat_xyzw: npt.ArrayLike) -> rr.Transform3D:
    return rr.Transform3D(translation=np.asarray(p_m), quaternion=rr.Quaternion(xyzw=np.asarray(quat_xyzw)))


def _along(x: float, y: float, z: float) -> Vector:
    """Return the quaternion xyzw that turns the z axis, along which Rerun's capsules lie, to a direction."""
    length = math.sqrt(x * x + y * y + z * z)
    if length + z < 1e-9:  # straight down, or no direction at all
        return 1.0, 0.0, 0.0, 0.0
    norm = math.sqrt(2.0 * length * (length + z))
    return 0.0 - y / norm, x / norm, 0.0, (length + z) / norm


def _arrangement(timeline: str) -> rrb.Blueprint:
    series = [rrb.TimeSeriesView(origin=f"joints/{side}", name=f"{side} joints [rad]") for side in Side]
    more = (
        rrb.TimeSeriesView(origin="hands", name="hands in their shoulder frames [m]"),
        rrb.TimeSeriesView(origin="gap", name="nearest parts of the body [m]"),
        rrb.Spatial2DView(origin="cameras/head_left_eye", name="camera"),
    )
    robot = rrb.Spatial3DView(origin=ROOT, name="robot")
    left = rrb.Vertical(robot, rrb.TextLogView(origin="events", name="events"), row_shares=[3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*series, rrb.Tabs(*more)), column_shares=[3, 2]),
        rrb.TimePanel(timeline=timeline, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )
