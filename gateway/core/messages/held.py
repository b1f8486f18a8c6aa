"""What a process that commands the robot shows to the one that may have to go on in its place: plain frozen values.

The daemon writes one into shared memory on every tick, for its guard; a guard that holds hands one to the next daemon.
It says what is on the wire and how it moves, never who asked for it: whoever goes on holds, and obeys nobody's old wish.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, field

from gateway.values import Side, Vector

__all__ = ["Held", "HeldArm"]


class HeldArm(Struct, frozen=True, kw_only=True):
    """The last setpoint of an arm's running stream, and how it moves.

    Attributes:
        topic: Command topic on which it was sent.
        values: The setpoint, shape (7,): joints [rad], or position [m] and quaternion xyzw.
        rate: Its velocity: shape (7,) [rad/s], or linear [m/s] and angular [rad/s] of a pose, shape (6,).
        acceleration: Its acceleration, of the same shape per second again.
    """

    topic: str
    values: Vector
    rate: Vector
    acceleration: Vector


class Held(Struct, frozen=True, kw_only=True):
    """What is on the wire at one instant.

    Attributes:
        at_ns: The tick that wrote it [ns].
        state: Supervisor state by value, e.g. `ACTIVE`.
        epoch: Lease epoch, for the record.
        beat: What the heartbeat does: `silent`, `one` or `zero`.
        is_owed: Whether a 1.0 was out and no FSM 0 was seen since.
        is_estop: Whether an e-stop is latched that the robot may not have heard.
        last_frame_ns: When the newest setpoint left [ns]; 0 when no arm is streamed.
        arms: The arms that are streamed.
        grippers: Last value of each gripper that is streamed.
        has_chassis: Whether the chassis is driven, or being stopped.
        has_lift: Whether the lift is driven, held, or being stopped.
        latches: Causes that are latched, by name: a latch of the last tick may not have reached the disk.
    """

    at_ns: int
    state: str
    epoch: int = 0
    beat: str = "silent"
    is_owed: bool = False
    is_estop: bool = False
    last_frame_ns: int = 0
    arms: Mapping[Side, HeldArm] = field(default_factory=dict)
    grippers: Mapping[Side, float] = field(default_factory=dict)
    has_chassis: bool = False
    has_lift: bool = False
    latches: tuple[str, ...] = ()

    @property
    def is_sending(self) -> bool:
        """Whether anything is on the wire."""
        return bool(self.arms) or self.beat != "silent" or self.has_chassis or self.has_lift

    @property
    def is_silent(self) -> bool:
        """Whether nothing is on the wire and nothing is owed: nobody would have to go on."""
        return not (self.is_sending or self.is_owed or self.is_estop)
