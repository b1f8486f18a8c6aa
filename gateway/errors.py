"""Everything that can go wrong, with stable codes: one table for core, wire, client and docs.

```
GatewayError                      code, message, field, value, bound, unit, hint
├─ ConfigError                    a setting is unknown, malformed or looser than the robot allows
├─ Refused                        the request was understood and not allowed; nothing moved
│  ├─ Rejected                    the input itself is wrong: shape, finiteness, range, unknown id
│  ├─ NotReady                    the robot or the gateway is not in a state for it
│  │  └─ Stale                    the robot's state is too old (retryable)
│  └─ LeaseError                  somebody else owns the robot, or the epoch is old
├─ MotionEnded                    an accepted motion did not reach its goal
│  ├─ Aborted · Cancelled · Superseded
├─ ProtocolError                  one side of the local API spoke nonsense
├─ Disconnected                   no daemon at the socket (retryable)
├─ GatewayTimeout                 also a TimeoutError
├─ OutcomeUnknown                 the reply was lost: the command may or may not have run
└─ InternalError                  a bug in the gateway
```

In the core a refusal is a value (`Refusal`); the client turns its code back into the class of the table
below (`to_exception`). Messages carry value, bound, unit and source; the hint says what to do next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

__all__ = [
    "CODES",
    "Aborted",
    "Cancelled",
    "Code",
    "CodeInfo",
    "ConfigError",
    "Disconnected",
    "GatewayError",
    "GatewayTimeout",
    "InternalError",
    "LeaseError",
    "MotionEnded",
    "NotReady",
    "OutcomeUnknown",
    "ProtocolError",
    "Refusal",
    "Refused",
    "Rejected",
    "Stale",
    "Superseded",
    "to_exception",
]


class Code(str, Enum):
    """Stable code of a refusal, an end of motion, a latch or a notice. The value never changes."""

    # the input
    BAD_REQUEST = "BAD_REQUEST"
    UNSUPPORTED_VERSION = "UNSUPPORTED_VERSION"
    WRONG_SHAPE = "WRONG_SHAPE"
    NOT_FINITE = "NOT_FINITE"
    OUT_OF_RANGE = "OUT_OF_RANGE"
    UNKNOWN_MOTION = "UNKNOWN_MOTION"
    UNKNOWN_STREAM = "UNKNOWN_STREAM"
    # the lease
    NOT_OWNER = "NOT_OWNER"
    LEASE_HELD = "LEASE_HELD"
    LEASE_STALE = "LEASE_STALE"
    LEASE_LOST = "LEASE_LOST"
    TAKEOVER_BRAKING = "TAKEOVER_BRAKING"
    # the robot and the gateway's state
    NO_LINK = "NO_LINK"
    STATE_STALE = "STATE_STALE"
    PART_STALE = "PART_STALE"
    MODE_UNKNOWN = "MODE_UNKNOWN"
    MODE_VR = "MODE_VR"
    WRONG_CONTROL_MODE = "WRONG_CONTROL_MODE"
    ARM_DISABLED = "ARM_DISABLED"
    NO_ARM_ENABLED = "NO_ARM_ENABLED"
    NOT_ENABLED = "NOT_ENABLED"
    FSM_BUSY = "FSM_BUSY"
    FSM_ERROR = "FSM_ERROR"
    FSM_UNKNOWN = "FSM_UNKNOWN"
    LATCHED = "LATCHED"
    LATCH_PERSISTS = "LATCH_PERSISTS"
    STOPPING = "STOPPING"
    ROBOT_PAUSED = "ROBOT_PAUSED"
    ENABLE_TIMEOUT = "ENABLE_TIMEOUT"
    START_OUTSIDE_LIMITS = "START_OUTSIDE_LIMITS"
    OTHER_GATEWAY = "OTHER_GATEWAY"
    EXITING = "EXITING"
    # how a motion or a stream ends
    STREAM_ENDED = "STREAM_ENDED"
    CANCELLED = "CANCELLED"
    SUPERSEDED = "SUPERSEDED"
    STOPPED = "STOPPED"
    CLIENT_LOST = "CLIENT_LOST"
    PART_LOST = "PART_LOST"
    SETTLE_TIMEOUT = "SETTLE_TIMEOUT"
    PLAN_FAILED = "PLAN_FAILED"
    TARGET_EXPIRED = "TARGET_EXPIRED"
    # latches
    ESTOP = "ESTOP"
    STOPPED_BY_OTHER = "STOPPED_BY_OTHER"
    TRACKING_ERROR = "TRACKING_ERROR"
    FOREIGN_WRITER = "FOREIGN_WRITER"
    GATE_VIOLATION = "GATE_VIOLATION"
    JOINT_ORDER = "JOINT_ORDER"
    STATE_LOST = "STATE_LOST"
    # notices
    STOP_NOT_EFFECTIVE = "STOP_NOT_EFFECTIVE"
    STOP_UNDELIVERED = "STOP_UNDELIVERED"
    START_AT_LIMIT = "START_AT_LIMIT"
    TICK_LATE = "TICK_LATE"
    SUSPENDED = "SUSPENDED"
    SAMPLE_REFUSED = "SAMPLE_REFUSED"
    STATE_DUPLICATED = "STATE_DUPLICATED"
    ROUTE_DEAD = "ROUTE_DEAD"
    ROUTE_LOST = "ROUTE_LOST"
    HEARTBEAT_NOT_EFFECTIVE = "HEARTBEAT_NOT_EFFECTIVE"
    STATE_CHANGED = "STATE_CHANGED"
    LEASE_CHANGED = "LEASE_CHANGED"
    LATCH_CHANGED = "LATCH_CHANGED"
    LINK_UP = "LINK_UP"
    LINK_DOWN = "LINK_DOWN"
    ROBOT_RESTARTED = "ROBOT_RESTARTED"
    LOSS_STAGE = "LOSS_STAGE"
    MOTION_ENDED = "MOTION_ENDED"
    WALK = "WALK"
    # the daemon's start
    BAD_CONFIG = "BAD_CONFIG"
    # the client's side
    DISCONNECTED = "DISCONNECTED"
    TIMEOUT = "TIMEOUT"
    OUTCOME_UNKNOWN = "OUTCOME_UNKNOWN"
    INTERNAL = "INTERNAL"

    def __str__(self) -> str:
        """Return the bare code."""
        return self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why a request was not carried out: a value in the core, an exception in the client.

    Attributes:
        code: Stable code.
        message: One sentence with value, bound, unit and source (manual §).
        field: Which input, e.g. `left_arm[3]`; empty when none is to blame.
        value: The offending value as text; empty when none.
        bound: The bound as text, e.g. `[0.25, 2.20]`; empty when none.
        unit: Unit of value and bound; empty when none.
        hint: What to do next.
    """

    code: Code
    message: str
    field: str = ""
    value: str = ""
    bound: str = ""
    unit: str = ""
    hint: str = ""


class GatewayError(Exception):
    """Base of every error this package raises on purpose.

    Args:
        refusal: Code, message and facts; every attribute of it can be read from the exception too.
    """

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal)
        self.refusal = refusal

    @property
    def code(self) -> Code:
        """Stable code."""
        return self.refusal.code

    @property
    def message(self) -> str:
        """One sentence with value, bound, unit and source."""
        return self.refusal.message

    @property
    def hint(self) -> str:
        """What to do next."""
        return self.refusal.hint

    @property
    def field(self) -> str:
        """Which input is to blame, or empty."""
        return self.refusal.field

    @property
    def value(self) -> str:
        """The offending value as text, or empty."""
        return self.refusal.value

    @property
    def bound(self) -> str:
        """The bound as text, or empty."""
        return self.refusal.bound

    @property
    def unit(self) -> str:
        """Unit of value and bound, or empty."""
        return self.refusal.unit

    def __str__(self) -> str:
        """Return `CODE: message -> hint`."""
        text = f"{self.refusal.code}: {self.refusal.message}"
        return f"{text} -> {self.refusal.hint}" if self.refusal.hint else text


class ConfigError(GatewayError):
    """A setting is unknown, malformed or looser than the robot's hard limits."""


class Refused(GatewayError):
    """The request was understood and not allowed; nothing moved."""


class Rejected(Refused):
    """The input itself is wrong: shape, finiteness, range, unknown id."""


class NotReady(Refused):
    """The robot or the gateway is not in a state for the request."""


class Stale(NotReady):
    """The robot's state is too old to act on; try again when it is back."""


class LeaseError(Refused):
    """Somebody else owns the robot, or the caller's epoch is old."""


class MotionEnded(GatewayError):
    """An accepted motion did not reach its goal."""


class Aborted(MotionEnded):
    """The motion was ended by a fault, a stop or a loss; the arm braked and holds."""


class Cancelled(MotionEnded):
    """The owner cancelled the motion; the arm braked and holds."""


class Superseded(MotionEnded):
    """A later motion of the owner took the arm over."""


class ProtocolError(GatewayError):
    """One side of the local API sent something the other cannot read."""


class Disconnected(GatewayError):
    """No daemon answers at the socket; try again when it runs."""


class GatewayTimeout(GatewayError, TimeoutError):
    """A wait ended without its event; the state of the robot is in the message."""


class OutcomeUnknown(GatewayError):
    """The reply was lost: the command may or may not have run. Look at the state before repeating it."""


class InternalError(GatewayError):
    """A bug in the gateway. Nothing invalid left it; please report the message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeInfo:
    """What a code means to a caller.

    Attributes:
        error: Exception class that the client raises for it.
        hint: Default remedy, used when the refusal carries none of its own.
        retryable: Whether the same request may succeed later without a person's help.
    """

    error: type[GatewayError]
    hint: str = ""
    retryable: bool = False


REBOOT = "in the robot's system configuration, save, apply, reboot (manual §2.3)"
"""How every setting of the robot's own takes effect."""

CODES: dict[Code, CodeInfo] = {
    Code.BAD_REQUEST: CodeInfo(error=Rejected, hint="see the protocol in gateway/api/protocol.py"),
    Code.UNSUPPORTED_VERSION: CodeInfo(error=ProtocolError, hint="install the same release for client and daemon"),
    Code.WRONG_SHAPE: CodeInfo(error=Rejected, hint="give exactly the number of values named in the message"),
    Code.NOT_FINITE: CodeInfo(error=Rejected, hint="remove NaN and infinity from the input"),
    Code.OUT_OF_RANGE: CodeInfo(error=Rejected, hint="stay inside the bound, or ask for on_limit='clip'"),
    Code.UNKNOWN_MOTION: CodeInfo(error=Rejected, hint="use the id of a motion that was accepted by this daemon"),
    Code.UNKNOWN_STREAM: CodeInfo(error=Rejected, hint="open a stream first"),
    Code.NOT_OWNER: CodeInfo(error=LeaseError, hint="take the lease with control() first"),
    Code.LEASE_HELD: CodeInfo(error=LeaseError, hint="wait until it is free, or take(reason=...)", retryable=True),
    Code.LEASE_STALE: CodeInfo(error=LeaseError, hint="acquire the lease again; this epoch is over"),
    Code.LEASE_LOST: CodeInfo(error=LeaseError, hint="somebody took the robot over; acquire again when it is free"),
    Code.TAKEOVER_BRAKING: CodeInfo(error=LeaseError, hint="wait until the arms are at rest", retryable=True),
    Code.NO_LINK: CodeInfo(error=Stale, hint="check power, cable and address of the robot (tcp 9000)", retryable=True),
    Code.STATE_STALE: CodeInfo(error=Stale, hint="wait for fresh state; see `ta2 topics`", retryable=True),
    Code.PART_STALE: CodeInfo(error=Stale, hint="wait for this part's state; see `ta2 topics`", retryable=True),
    Code.MODE_UNKNOWN: CodeInfo(error=NotReady, hint="wait for /api/current_mode (about 1 Hz)", retryable=True),
    Code.MODE_VR: CodeInfo(error=NotReady, hint=f"set API mode {REBOOT}"),
    Code.WRONG_CONTROL_MODE: CodeInfo(error=NotReady, hint=f"set the arm's control mode {REBOOT}"),
    Code.ARM_DISABLED: CodeInfo(error=NotReady, hint=f"enable the arm {REBOOT}"),
    Code.NO_ARM_ENABLED: CodeInfo(error=NotReady, hint=f"enable an arm {REBOOT}"),
    Code.NOT_ENABLED: CodeInfo(error=NotReady, hint="call enable() first"),
    Code.FSM_BUSY: CodeInfo(
        error=NotReady, hint="wait for FSM PAUSE (0); somebody may be driving the robot", retryable=True
    ),
    Code.FSM_ERROR: CodeInfo(error=NotReady, hint="clear the fault at the robot, then recover()"),
    Code.FSM_UNKNOWN: CodeInfo(error=NotReady, hint="wait for /fsm_state (20 Hz); see `ta2 topics`", retryable=True),
    Code.LATCHED: CodeInfo(error=NotReady, hint="make sure the robot is safe, then recover()"),
    Code.LATCH_PERSISTS: CodeInfo(error=NotReady, hint="remove the cause named in the message, then recover() again"),
    Code.STOPPING: CodeInfo(error=NotReady, hint="wait until the arms are at rest", retryable=True),
    Code.ROBOT_PAUSED: CodeInfo(error=NotReady, hint="look why the robot paused (physical stop?), then enable()"),
    Code.ENABLE_TIMEOUT: CodeInfo(error=NotReady, hint="see what was missing in the message", retryable=True),
    Code.START_OUTSIDE_LIMITS: CodeInfo(error=NotReady, hint="move the joint back inside by hand or in VR mode"),
    Code.OTHER_GATEWAY: CodeInfo(error=NotReady, hint="stop the other gateway first (manual §3.3.2)"),
    Code.EXITING: CodeInfo(error=NotReady, hint="the daemon is going down; start it again"),
    Code.STREAM_ENDED: CodeInfo(error=Aborted, hint="open a new stream; it starts where the arm is held"),
    Code.CANCELLED: CodeInfo(error=Cancelled, hint="the arm holds where it braked; command a new motion"),
    Code.SUPERSEDED: CodeInfo(error=Superseded, hint="wait for the motion that took the arm over"),
    Code.STOPPED: CodeInfo(error=Aborted, hint="stop() was called; command a new motion when it is safe"),
    Code.CLIENT_LOST: CodeInfo(error=Aborted, hint="the keepalive of the client stopped; command a new motion"),
    Code.PART_LOST: CodeInfo(error=Aborted, hint="see the notices for the part that was lost"),
    Code.SETTLE_TIMEOUT: CodeInfo(error=Aborted, hint="look for load or contact, or ask for a wider tolerance"),
    Code.PLAN_FAILED: CodeInfo(error=Aborted, hint="please report the message"),
    Code.TARGET_EXPIRED: CodeInfo(error=Aborted, hint="send targets more often than their expiry", retryable=True),
    Code.TICK_LATE: CodeInfo(
        error=Aborted,
        hint="this host was too busy for the control loop: give it SCHED_FIFO or less load",
        retryable=True,
    ),
    Code.ESTOP: CodeInfo(error=NotReady, hint="make sure the robot is safe, then recover()"),
    Code.STOPPED_BY_OTHER: CodeInfo(error=NotReady, hint="ask who stopped the robot, then recover()"),
    Code.TRACKING_ERROR: CodeInfo(error=Aborted, hint="look for contact or overload, then recover()"),
    Code.FOREIGN_WRITER: CodeInfo(error=NotReady, hint="stop the robot's other commander (manual §3.3.2), recover()"),
    Code.GATE_VIOLATION: CodeInfo(error=InternalError, hint="please report the message; recover() when it is safe"),
    Code.JOINT_ORDER: CodeInfo(error=NotReady, hint="not a robot we know: joint names differ from manual §4.0.3"),
    Code.STATE_LOST: CodeInfo(
        error=NotReady, hint="see why the robot was last stopped, make sure it is safe, recover()"
    ),
    Code.STOP_NOT_EFFECTIVE: CodeInfo(
        error=NotReady, hint="use the physical emergency stop: the robot is not in PAUSE"
    ),
    Code.STOP_UNDELIVERED: CodeInfo(error=NotReady, hint="use the physical emergency stop: the robot is out of reach"),
    Code.BAD_CONFIG: CodeInfo(error=ConfigError, hint="correct the setting; `ta2 config --show` prints all of them"),
    Code.DISCONNECTED: CodeInfo(error=Disconnected, hint="start the daemon with `ta2 run`", retryable=True),
    Code.TIMEOUT: CodeInfo(
        error=GatewayTimeout, hint="look at the state (`ta2 status`), then wait longer", retryable=True
    ),
    Code.OUTCOME_UNKNOWN: CodeInfo(error=OutcomeUnknown, hint="look at the state before repeating the command"),
    Code.INTERNAL: CodeInfo(error=InternalError, hint="please report the message"),
}
"""Every code that can reach a caller. Codes that are only notices (no request can fail with them) are not here."""


def to_exception(refusal: Refusal) -> GatewayError:
    """Return the exception for a refusal: the class of its code, with the default hint filled in.

    Args:
        refusal: As the core made it, or as it came over the wire.

    Returns:
        An instance, not raised. Codes without a class of their own give `InternalError`.
    """
    info = CODES.get(refusal.code, CodeInfo(error=InternalError))
    if not refusal.hint:
        refusal = replace(refusal, hint=info.hint)
    return info.error(refusal)
