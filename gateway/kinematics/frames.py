"""Frames: the manual's transform tree (appendix A.2), and where any frame is in any other, at the joints' own time.

```
virtual_base                              between the head's eyes; x ahead, y left, z up
├─ head_camera_center                     nominal (A.3)
│  ├─ head_left_camera                    of one robot (A.4)
│  └─ head_right_camera                   of one robot
├─ left_base_virtual                      nominal
│  ├─ left_shoulder_base                  frame of the arm's poses (§4.0.1): ours, the manual does not place it
│  └─ left_ee                             by the joints (A.5)
│     └─ left_wrist_camera                of one robot; its left eye, the manual does not say which
│        └─ left_wrist_right_camera       ours: the other eye, by the pair's own calibration (§5.5)
└─ right_base_virtual ...
```

What moves is worked out from joint angles each time and never stored as if it were fixed (A.5); a result carries the
stamp of the joints it was made from. Every fixed edge says where it comes from (A.4): nominal numbers are the same for all
robots of a model, calibrated ones belong to one robot. A nominal stand-in where the manual wants a calibration is allowed
and told: `Located.stand_ins`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum

from msgspec import Struct

from gateway.errors import Code, failure
from gateway.kinematics.solving.chain import ArmChain
from gateway.kinematics.transform import Transform
from gateway.robot.topics import shoulder_frame
from gateway.values import ArmState, Side, ValueRefused

__all__ = [
    "DEVICE_EDGES",
    "MOVING_EDGES",
    "NOMINAL_EDGES",
    "ROOT",
    "FixedEdge",
    "FrameTree",
    "Located",
    "Origin",
    "base_frame",
    "ee_frame",
    "wrist_frame",
]

ROOT = "virtual_base"
"""The robot's only common frame (A.2)."""


def base_frame(side: Side) -> str:
    """Return the name of an arm's nominal mount (A.2)."""
    return f"{side}_base_virtual"


def ee_frame(side: Side) -> str:
    """Return the name of an arm's end effector (A.2)."""
    return f"{side}_ee"


def wrist_frame(side: Side) -> str:
    """Return the name of a wrist camera's optical frame (A.2)."""
    return f"{side}_wrist_camera"


NOMINAL_EDGES = ("virtual_base_T_head_camera_center", *(f"{ROOT}_T_{base_frame(side)}" for side in Side))
"""Fixed by the model, equal on all robots of it; no calibration may change them (A.3)."""

DEVICE_EDGES = (
    "head_camera_center_T_head_left_camera",
    "head_camera_center_T_head_right_camera",
    *(f"{ee_frame(side)}_T_{wrist_frame(side)}" for side in Side),
)
"""Fixed, and calibrated on each robot (A.4)."""

MOVING_EDGES = {f"{base_frame(side)}_T_{ee_frame(side)}": side for side in Side}
"""By forward kinematics (A.5), with the arm whose joints they need."""


class Origin(str, Enum):
    """Where a fixed transform comes from; the first three are those that A.4 asks a file to tell."""

    MECHANICAL_DESIGN = "mechanical_design"
    STEREO_CALIBRATION = "stereo_calibration"
    ARM_CAMERA_CALIBRATION = "arm_camera_calibration"
    ASSUMPTION = "assumption"


class FixedEdge(Struct, frozen=True, kw_only=True):
    """A transform that no joint changes.

    Attributes:
        transform: `parent_T_child`.
        origin: Where it comes from.
        is_of_one_robot: Whether it was calibrated on a single robot and holds for no other (A.4).
        note: What else there is to say, for people.
    """

    transform: Transform
    origin: Origin
    is_of_one_robot: bool
    note: str = ""

    @property
    def is_stand_in(self) -> bool:
        """Whether the manual wants this calibrated on the robot (A.4) and it is not."""
        return self.transform.name in DEVICE_EDGES and not self.is_of_one_robot


class Located(Struct, frozen=True, kw_only=True):
    """Where a frame is in another.

    Attributes:
        transform: `parent_T_child`.
        stamps_ns: Per arm on the way, the stamp of its joints on the robot's clock [ns]; empty for a fixed chain.
        edges: Names of the transforms on the way, as they stand in the tree.
        stand_ins: Those of them that are nominal where the manual wants a calibration of this robot (A.4).
    """

    transform: Transform
    stamps_ns: Mapping[Side, int]
    edges: tuple[str, ...]
    stand_ins: tuple[str, ...]

    @property
    def stamp_ns(self) -> int | None:
        """Stamp of the older joints on the way [ns]; None for a fixed chain."""
        return min(self.stamps_ns.values(), default=None)


class FrameTree:
    """All frames of one robot.

    Args:
        edges: Fixed transforms, in any order; with the two moving ones they must make one tree under `virtual_base`.
        arms: Forward kinematics of both.

    Raises:
        ValueRefused: A frame has two parents, an edge hangs in the air, or the moving edges have nothing to hang on.
    """

    def __init__(self, edges: Iterable[FixedEdge], arms: Mapping[Side, ArmChain]) -> None:
        self._arms = arms
        self._fixed: dict[str, FixedEdge] = {}
        self._parents: dict[str, str] = {ee_frame(side): base_frame(side) for side in Side}
        for edge in edges:
            child = edge.transform.child
            if child in self._parents or child == ROOT:
                raise ValueRefused(f"{child} has two places: {edge.transform.name} is one too many")
            self._parents[child] = edge.transform.parent
            self._fixed[child] = edge
        for frame in self._parents:
            self._ancestors(frame)
        for side in Side:
            if shoulder_frame(side) not in self._fixed:
                raise ValueRefused(
                    f"{shoulder_frame(side)} is missing: poses of the {side} arm are given in it (§4.0.1)"
                )

    def _ancestors(self, frame: str) -> list[str]:
        """Return the frame and all above it, the root last."""
        path = [frame]
        while path[-1] != ROOT:
            parent = self._parents.get(path[-1])
            if parent is None or parent in path:
                raise ValueRefused(f"{frame} does not hang on {ROOT}: nothing places {path[-1]}")
            path.append(parent)
        return path

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames, parents before children, siblings in the order of the edges."""
        found = [ROOT]
        for frame in found:
            found += self.children(frame)
        return tuple(found)

    def children(self, frame: str) -> tuple[str, ...]:
        """Return the frames that hang on one."""
        return tuple(child for child, parent in self._parents.items() if parent == frame)

    def parent(self, frame: str) -> str | None:
        """Return the frame that one hangs on; None for the root."""
        return self._parents.get(frame)

    def edge(self, frame: str) -> FixedEdge | None:
        """Return what fixes a frame in its parent; None for the root and for what joints move."""
        return self._fixed.get(frame)

    def _known(self, frame: str) -> list[str]:
        if frame != ROOT and frame not in self._parents:
            raise failure(
                Code.WRONG_FRAME,
                f"there is no frame {frame!r} (manual A.2)",
                field="frame",
                value=frame,
                hint=f"one of {', '.join(self.frames)}",
            )
        return self._ancestors(frame)

    def sides_between(self, parent: str, child: str) -> tuple[Side, ...]:
        """Return the arms whose joints lie between two frames.

        Raises:
            Rejected: WRONG_FRAME, there is no such frame.
        """
        up, down = self._way(parent, child)
        return tuple(side for side in Side if ee_frame(side) in (*up, *down))

    def _way(self, parent: str, child: str) -> tuple[list[str], list[str]]:
        """Return the frames to climb from `parent`, and those to climb from `child`, to where they meet, exclusive."""
        above_parent, above_child = self._known(parent), self._known(child)
        while above_parent and above_child and above_parent[-1] == above_child[-1]:
            above_parent.pop()
            above_child.pop()
        return above_parent, above_child

    def locate(self, parent: str, child: str, joints: Mapping[Side, ArmState] | None = None) -> Located:
        """Return where `child` is in `parent`.

        Args:
            parent: Name of a frame.
            child: Name of another, or the same.
            joints: Measured joints of the arms on the way; others are not looked at. Their stamps go into the result.

        Raises:
            Rejected: WRONG_FRAME, there is no such frame.
            Stale: PART_STALE, the joints of an arm on the way are not there.
        """
        known = joints or {}
        up, down = self._way(parent, child)
        transform = Transform.still(parent)
        for step in up:
            transform = transform @ self._placed(step, known).inverse
        for step in reversed(down):
            transform = transform @ self._placed(step, known)
        steps = (*up, *reversed(down))
        return Located(
            transform=transform,
            stamps_ns={side: known[side].stamp_ns for side in Side if ee_frame(side) in steps},
            edges=tuple(f"{self._parents[step]}_T_{step}" for step in steps),
            stand_ins=tuple(
                edge.transform.name
                for step in steps
                if (edge := self._fixed.get(step)) is not None and edge.is_stand_in
            ),
        )

    def _placed(self, frame: str, joints: Mapping[Side, ArmState]) -> Transform:
        """Return a frame in its parent."""
        edge = self._fixed.get(frame)
        if edge is not None:
            return edge.transform
        side = MOVING_EDGES[f"{self._parents[frame]}_T_{frame}"]
        state = joints.get(side)
        if state is None:
            raise failure(Code.PART_STALE, f"no joints of the {side} arm: {frame} moves with them (manual A.5)")
        shoulder = shoulder_frame(side)
        placed = self._arms[side].forward(state.q_rad)
        reach = Transform.of(f"{shoulder}_T_{frame}", p_m=placed.p_m, rotation=placed.rows)
        return self._fixed[shoulder].transform @ reach
