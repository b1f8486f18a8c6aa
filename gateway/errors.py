"""Everything that can go wrong, with stable codes: one table for core, wire, client and docs.

```
GatewayError                      code, message, field, value, bound, unit, hint
├─ ConfigError                    a setting is unknown, malformed or looser than the robot allows
├─ Refused                        the request was understood and not allowed; nothing moved
│  ├─ Rejected                    the input itself is wrong: shape, finiteness, range, unknown id
│  ├─ NotReady                    the robot or the gateway is not in a state for it
│  │  └─ Stale                    the robot's state is too old (retryable)
│  ├─ LeaseError                  somebody else owns the robot, or the epoch is old
│  └─ NotPermitted                the role of this user does not allow it
├─ MotionEnded                    an accepted motion did not reach its goal
│  ├─ Aborted · Cancelled · Superseded
├─ ProtocolError                  one side of the local API spoke nonsense
├─ Disconnected                   no daemon at the socket (retryable)
├─ GatewayTimeout                 also a TimeoutError
├─ OutcomeUnknown                 the reply was lost: the command may or may not have run
└─ InternalError                  a bug in the gateway
```

The codes themselves are in `codes.py`. In the core a refusal is a value (`Refusal`); the client turns its code back into
the class of the table below (`to_exception`). Messages carry value, bound, unit and source; the hint says what to do next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gateway.codes import Code

__all__ = [
    "CODES",
    "STOP_UNKNOWN",
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
    "NotPermitted",
    "NotReady",
    "OutcomeUnknown",
    "ProtocolError",
    "Refusal",
    "Refused",
    "Rejected",
    "Stale",
    "Superseded",
    "failure",
    "to_exception",
]

STOP_UNKNOWN = "use the physical emergency stop: nobody knows whether the robot has stopped"
"""The only hint that counts when a stop may not have stopped the robot."""


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
    """Base of every error this package raises on purpose; every attribute of its refusal can be read from it too."""

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

    @property
    def retryable(self) -> bool:
        """Whether the same request may succeed later without a person's help; nothing here retries by itself."""
        info = CODES.get(self.refusal.code)
        return info is not None and info.retryable

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


class NotPermitted(Refused):
    """The role of this user does not allow the request; a stop is allowed to every role."""


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
    Code.BAD_REQUEST: CodeInfo(error=Rejected, hint="mend what the message names"),
    Code.UNSUPPORTED_VERSION: CodeInfo(error=ProtocolError, hint="install the same release for client and daemon"),
    Code.WRONG_SHAPE: CodeInfo(error=Rejected, hint="give exactly the number of values named in the message"),
    Code.NOT_FINITE: CodeInfo(error=Rejected, hint="remove NaN and infinity from the input"),
    Code.WRONG_FRAME: CodeInfo(
        error=Rejected, hint="give the arm's own frame: left_shoulder_base or right_shoulder_base"
    ),
    Code.GOAL_TOO_NEAR: CodeInfo(
        error=Rejected, hint="give a goal that leaves the bound between the parts, or move the other arm away first"
    ),
    Code.OUT_OF_RANGE: CodeInfo(error=Rejected, hint="stay inside the bound, or ask for on_limit='clip'"),
    Code.JUMP_TOO_FAR: CodeInfo(error=Rejected, hint="start where the arm is held, or move there first"),
    Code.TOO_FAST: CodeInfo(error=Rejected, hint="ask for stretch, the factor by which it becomes slower"),
    Code.TOO_LATE: CodeInfo(error=Rejected, hint="send the chunk before the time of its last point has passed"),
    Code.CANNOT_JOIN: CodeInfo(
        error=Rejected, hint="start slower or nearer to the arm, and leave time to join: some 0.5 s", retryable=True
    ),
    Code.UNKNOWN_MOTION: CodeInfo(error=Rejected, hint="use the id of a motion that was accepted by this daemon"),
    Code.UNKNOWN_STREAM: CodeInfo(error=Rejected, hint="open a stream first"),
    Code.NOT_OWNER: CodeInfo(error=LeaseError, hint="take the lease with control() first"),
    Code.LEASE_HELD: CodeInfo(error=LeaseError, hint="wait until it is free, or take(reason=...)", retryable=True),
    Code.LEASE_STALE: CodeInfo(error=LeaseError, hint="acquire the lease again; this epoch is over"),
    Code.LEASE_LOST: CodeInfo(error=LeaseError, hint="acquire again when it is free: somebody took the robot over"),
    Code.TAKEOVER_BRAKING: CodeInfo(error=LeaseError, hint="wait until the arms are at rest", retryable=True),
    Code.NOT_PERMITTED: CodeInfo(
        error=NotPermitted, hint="ask an admin; roles stand in the gateway's local.roles_file"
    ),
    Code.NO_LINK: CodeInfo(error=Stale, hint="check power, cable and address of the robot (tcp 9000)", retryable=True),
    Code.STATE_STALE: CodeInfo(error=Stale, hint="wait for fresh state; see `ta2 topics`", retryable=True),
    Code.PART_STALE: CodeInfo(error=Stale, hint="wait for this part's state; see `ta2 topics`", retryable=True),
    Code.MODE_UNKNOWN: CodeInfo(error=NotReady, hint="wait for /api/current_mode (about 1 Hz)", retryable=True),
    Code.MODE_VR: CodeInfo(error=NotReady, hint=f"set API mode {REBOOT}"),
    Code.WRONG_CONTROL_MODE: CodeInfo(
        error=NotReady, hint=f"move it in its own mode (move_to, move_pose), or set that {REBOOT}"
    ),
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
    Code.ENABLE_TIMEOUT: CodeInfo(
        error=NotReady, hint="mend what was missing (in the message), then enable() again", retryable=True
    ),
    Code.START_OUTSIDE_LIMITS: CodeInfo(error=NotReady, hint="move the joint back inside by hand or in VR mode"),
    Code.CHASSIS_DISABLED: CodeInfo(error=NotReady, hint=f"enable the chassis {REBOOT}"),
    Code.LIFT_DISABLED: CodeInfo(error=NotReady, hint=f"enable the lift servo {REBOOT}"),
    Code.NO_LIFT: CodeInfo(error=NotReady, hint="set `model` in section [robot] if it has a lift (manual §1.2)"),
    Code.OTHER_GATEWAY: CodeInfo(error=NotReady, hint="stop the other gateway first (manual §3.3.2)"),
    Code.HELD_BY_GUARD: CodeInfo(
        error=NotReady, hint="wait some seconds: the hold is taken over, or ends by itself", retryable=True
    ),
    Code.MODEL_OFF: CodeInfo(error=NotReady, hint="set `check = true` in section [model] of the configuration"),
    Code.MODEL_UNKNOWN: CodeInfo(
        error=NotReady, hint="wait for joints and poses of the arm (manual §4.8); see `ta2 topics`", retryable=True
    ),
    Code.MODEL_DIFFERS: CodeInfo(
        error=NotReady,
        hint="correct the model: run `ta2 identify`, name its file in `calibration` of section [model], or a URDF in `urdf`",
    ),
    Code.CANNOT_WEIGH: CodeInfo(error=NotReady, hint="move the arm clear, elbow bent, and wait until it rests"),
    Code.UNGUARDED: CodeInfo(
        error=NotReady,
        hint="set the arm to joint mode in the robot's web page, or `self_collision = false` in section [model]",
    ),
    Code.CONTACT_UNKNOWN: CodeInfo(error=NotReady, hint="mend what the message names, or wait", retryable=True),
    Code.ENDPOINT_SILENT: CodeInfo(error=NotReady, hint="see after the watcher; if it is gone, recover(reason='...')"),
    Code.ENDPOINT_MISSING: CodeInfo(error=NotReady, hint="start `ta2 stop-endpoint` where somebody sees the robot"),
    Code.ENDPOINT_UNKNOWN: CodeInfo(error=NotReady, hint="call stop_endpoint() again"),
    Code.TOO_MANY_ENDPOINTS: CodeInfo(error=NotReady, hint="stop one of them; silent ones: recover(reason='...')"),
    Code.EXITING: CodeInfo(error=NotReady, hint="start the daemon again: it is going down"),
    Code.STREAM_ENDED: CodeInfo(error=Aborted, hint="open a new stream; it starts where the arm is held"),
    Code.CANCELLED: CodeInfo(error=Cancelled, hint="command a new motion: the arm holds where it braked"),
    Code.SUPERSEDED: CodeInfo(error=Superseded, hint="wait for the motion that took the arm over"),
    Code.STOPPED: CodeInfo(error=Aborted, hint="command a new motion when it is safe: stop() was called"),
    Code.CLIENT_LOST: CodeInfo(error=Aborted, hint="command a new motion: the keepalive of the client had stopped"),
    Code.PART_LOST: CodeInfo(error=Aborted, hint="look at `ta2 why` for the lost part, then command a new motion"),
    Code.SETTLE_TIMEOUT: CodeInfo(error=Aborted, hint="look for load or contact, or ask for a wider tolerance"),
    Code.PATH_TOLERANCE: CodeInfo(error=Aborted, hint="look for contact or overload, or ask for a wider tolerance"),
    Code.GOAL_TOLERANCE: CodeInfo(error=Aborted, hint="look for load or contact, or ask for more time or tolerance"),
    Code.UNDERRUN: CodeInfo(
        error=Aborted, hint="send the next chunk before this one ends, or end it at rest", retryable=True
    ),
    Code.COLLISION_AHEAD: CodeInfo(
        error=Aborted, hint="move around the parts named, slower past them, or move the other arm away first"
    ),
    Code.CONTACT: CodeInfo(error=Aborted, hint="see its `touch`, and move away from what was touched"),
    Code.NO_STRAIGHT_WAY: CodeInfo(
        error=Aborted,
        hint="use move_pose(), which lets the joints go as they like; or go slower, turned otherwise or by way of another pose",
    ),
    Code.PLAN_FAILED: CodeInfo(
        error=Aborted,
        hint="ask again from rest, slower, or by way of another pose; if there is no plan then either, report the message",
    ),
    Code.TARGET_EXPIRED: CodeInfo(error=Aborted, hint="send targets more often than their expiry", retryable=True),
    Code.TICK_LATE: CodeInfo(error=Aborted, hint="give this host SCHED_FIFO or less load", retryable=True),
    Code.ESTOP: CodeInfo(error=NotReady, hint="make sure the robot is safe, then recover()"),
    Code.STOPPED_BY_OTHER: CodeInfo(error=NotReady, hint="ask who stopped the robot, then recover()"),
    Code.TRACKING_ERROR: CodeInfo(error=Aborted, hint="look for contact or overload, then recover()"),
    Code.FOREIGN_WRITER: CodeInfo(error=NotReady, hint="stop the robot's other commander (manual §3.3.2), recover()"),
    Code.GATE_VIOLATION: CodeInfo(error=InternalError, hint="report the message; recover() when it is safe"),
    Code.JOINT_ORDER: CodeInfo(
        error=NotReady, hint="check that this is a TeleAvatar 2 (joint order of manual §4.0.3), then recover()"
    ),
    Code.GATEWAY_BROKEN: CodeInfo(error=InternalError, hint="report the trace in its log; recover() when it is safe"),
    Code.STATE_LOST: CodeInfo(
        error=NotReady, hint="see why the robot was last stopped, make sure it is safe, recover()"
    ),
    Code.STOP_NOT_EFFECTIVE: CodeInfo(error=NotReady, hint="use the physical emergency stop: it is not in PAUSE"),
    Code.STOP_UNDELIVERED: CodeInfo(error=NotReady, hint="use the physical emergency stop: the robot is out of reach"),
    Code.TRACKING_STALL: CodeInfo(
        error=NotReady,
        hint="look for contact, overload or a pressed stop at the arm; then `ta2 topics` for the command's route",
    ),
    Code.SAMPLE_REFUSED: CodeInfo(
        error=Stale,
        hint="see what is wrong with the robot's state in the message; restart the node that sends it",
        retryable=True,
    ),
    Code.HEARTBEAT_NOT_EFFECTIVE: CodeInfo(
        error=NotReady, hint="release a pressed stop at the robot; else see `ta2 topics` and restart the robot's bridge"
    ),
    Code.ROUTE_SUSPECT: CodeInfo(error=NotReady, hint="see `ta2 topics`; restart its bridge or the silent node"),
    Code.OTHER_NAMESPACE: CodeInfo(
        error=NotReady,
        hint="set the robot's namespace in section [robot], or with `ta2 run --namespace`; see `ta2 link`",
    ),
    Code.TWO_ROBOTS: CodeInfo(
        error=NotReady, hint="stop one of them, or give their bridges namespaces; see `ta2 link`", retryable=True
    ),
    Code.CLIPPED_BY_ROBOT: CodeInfo(
        error=NotReady,
        hint="command a goal that this robot reaches: it clips beyond its own limits in silence (manual §4.10)",
    ),
    Code.IK_REFUSED: CodeInfo(
        error=NotReady,
        hint="command a pose that the robot's IK can solve: nearer, away from singularities (manual §4.10)",
    ),
    Code.SINGULARITY_NEAR: CodeInfo(
        error=NotReady,
        hint="wait until the arm is past it, or move around it (elbow stretched, upper arm straight out to the side)",
    ),
    Code.STREAM_LATE: CodeInfo(error=NotReady, hint="give this host SCHED_FIFO or less load", retryable=True),
    Code.BAD_CONFIG: CodeInfo(error=ConfigError, hint="correct the setting; `ta2 config --show` prints all of them"),
    Code.FOREIGN_CALIBRATION: CodeInfo(
        error=ConfigError, hint="use the calibration of this very robot; never copy one (manual A.4, A.6)"
    ),
    Code.DISCONNECTED: CodeInfo(error=Disconnected, hint="start the daemon with `ta2 run`", retryable=True),
    Code.NO_RECORDER: CodeInfo(error=NotReady, hint="start one on this host: `ta2 record --out DIR`", retryable=True),
    Code.TIMEOUT: CodeInfo(error=GatewayTimeout, hint="look (`ta2 status`), then wait longer", retryable=True),
    Code.OUTCOME_UNKNOWN: CodeInfo(error=OutcomeUnknown, hint="look at the state before repeating the command"),
    Code.POLICY_FAILED: CodeInfo(error=Aborted, hint="see its log: most often it does not know what --map shows it"),
    Code.INTERNAL: CodeInfo(error=InternalError, hint="report the message: this is a bug of the gateway"),
}
"""Every code that can reach a caller. Codes that are only notices (no request can fail with them) are not here."""


def to_exception(refusal: Refusal) -> GatewayError:
    """Return the exception for a refusal, not raised: the class of its code, else `InternalError`; hint filled in."""
    info = CODES.get(refusal.code, CodeInfo(error=InternalError))
    if not refusal.hint:
        refusal = replace(refusal, hint=info.hint)
    return info.error(refusal)


def failure(
    code: Code, message: str, *, field: str = "", value: str = "", bound: str = "", unit: str = "", hint: str = ""
) -> GatewayError:
    """Return the exception for a `Refusal` of these attributes, not raised."""
    return to_exception(
        Refusal(code=code, message=message, field=field, value=value, bound=bound, unit=unit, hint=hint)
    )
