"""What the outside may see of the body model and of what it does. Part of the snapshot; import the names from `snapshot.py`."""

from __future__ import annotations

from msgspec import Struct

from gateway.values import Vector

__all__ = ["ContactView", "ModelView", "SlowingView", "SpacingView", "TouchView"]


class ModelView(Struct, frozen=True, kw_only=True):
    """How far FK(joint_states) and `current_ee_pose` of an arm are apart: whether it may be moved by the body model.

    Attributes:
        state: `agrees`, `differs`, or `unknown` while too little has been compared; only the first is a yes.
        reason: Why, with figures.
        pairs: How many comparisons this is of.
        position_m: Median distance over the last seconds [m]; None without comparisons.
        angle_rad: Median angle [rad]; None without comparisons.
        lag_ns: By how much later than it seems the pose was measured, as far as motion tells [ns]; 0 without any.
    """

    state: str
    reason: str
    pairs: int
    position_m: float | None
    angle_rad: float | None
    lag_ns: int


class ContactView(Struct, frozen=True, kw_only=True):
    """What pulls at an arm, estimated from the efforts of its motors; never a safety function.

    Attributes:
        state: `known` or `unknown`.
        code: Why it is unknown: `NO_EFFORTS`, `MODEL_UNKNOWN`, `MODEL_DIFFERS`, `PART_STALE`, `NOT_CONVERGED` or
            `BROKEN`; empty else.
        reason: The same in words.
        basis: Where masses, friction and scale come from: `nominal`, or the file that they were identified to.
        torque_nm: External torques, shape (7,) [N·m]: what pushes towards positive positions is positive; empty when unknown.
        torque_sd_nm: Their standard deviations, shape (7,) [N·m].
        frame: In whose axes force and moment are, e.g. `left_shoulder_base`; empty when unknown.
        point: Frame at whose origin they act, e.g. `left_ee`.
        wrench: Force x, y, z [N] and moment x, y, z [N·m] that the surroundings put on the hand; None for a component that
            this posture does not feel.
        wrench_sd: Their standard deviations; None likewise.
        unknown: Directions of force [N] and moment [N·m] that this posture does not feel, unit vectors of shape (6,).
        sigmas: By how many standard deviations the clearest joint is pulled.
        age_ns: Age of the newest joints [ns].
        load_kg: Mass of what the hand was said to hold, which is no part of all this [kg]; 0 for nothing.
        load_com_m: Its centre of mass in the frame of the end effector (`left_ee`, `right_ee`), shape (3,) [m]; empty likewise.
    """

    state: str
    code: str = ""
    reason: str = ""
    basis: str = ""
    torque_nm: Vector = ()
    torque_sd_nm: Vector = ()
    frame: str = ""
    point: str = ""
    wrench: tuple[float | None, ...] = ()
    wrench_sd: tuple[float | None, ...] = ()
    unknown: tuple[Vector, ...] = ()
    sigmas: float = 0.0
    age_ns: int = 0
    load_kg: float = 0.0
    load_com_m: Vector = ()


class TouchView(Struct, frozen=True, kw_only=True):
    """A touch that ended what moved an arm; estimated as `ContactView` is, never a safety function.

    Attributes:
        number: Of all touches since the daemon began, from 1 on.
        side: Of the arm that was touched.
        at_ns: When (daemon clock) [ns].
        force_n: With what force the hand was pushed, along `direction` if there is one [N].
        sd_n: Its standard deviation [N].
        threshold_n: At what force it was to end [N].
        direction: Unit vector in the axes of `frame`; empty for any.
        wrench: Force [N] and moment [N·m] on the hand; None for a component that this posture does not feel.
        frame: In whose axes direction, wrench and place are: the arm's shoulder frame (manual §4.0.1).
        p_m: Where the hand was measured [m].
        is_own: Whether section [model] of the configuration asked for it, and not who moved the arm.
        back_id: Number of the motion that leads the hand back; 0 for none.
    """

    number: int
    side: str
    at_ns: int
    force_n: float
    sd_n: float
    threshold_n: float
    direction: Vector
    wrench: tuple[float | None, ...]
    frame: str
    p_m: Vector
    is_own: bool
    back_id: int


class SpacingView(Struct, frozen=True, kw_only=True):
    """How near parts of the body are to each other, as measured, and whether arms are kept apart.

    Attributes:
        on: Whether setpoints are kept from bringing parts nearer than the margin.
        why: Why not; empty while they are.
        gap_m: Free distance of the nearest pair, negative inside each other [m]; None while it is off.
        first: Name of one part of that pair, e.g. `left_palm`; empty while it is off.
        second: Name of the other.
        margin_m: What has to stay free [m].
        held: Arms whose targets are not followed on because of it: `left`, `right`.
    """

    on: bool
    why: str
    gap_m: float | None
    first: str
    second: str
    margin_m: float
    held: tuple[str, ...]


class SlowingView(Struct, frozen=True, kw_only=True):
    """How near a singularity an arm is whose poses are streamed, in the direction in which it goes.

    Attributes:
        on: Whether its poses are followed slower near singularities.
        why: Why not; empty while they are.
        speed_ratio: Part of the speed limits that is left, linear and angular alike; 1 while nothing is slowed.
        held: Whether that is what holds it back: it goes as fast as it may.
        joint: The joint that would be fastest at the full limits, 1 to 7; 0 while nothing moves, and while it is off.
        joint_radps: How fast that would be [rad/s]; 0 likewise.
        bound_radps: How fast it may be [rad/s].
    """

    on: bool
    why: str
    speed_ratio: float
    held: bool
    joint: int
    joint_radps: float
    bound_radps: float
