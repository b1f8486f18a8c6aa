"""The supervisor: which state the gateway is in, and what each event does there. A table, not a ladder of ifs.

Rules it obeys
    * The table below is the project's behaviour table, cell by cell. A cell says where to go, what to do, and whether the
      event is refused. `SAME` means: nothing.
    * Conditions of the robot (stale, FSM, mode, ...) are levels: the engine fires their trigger on every tick while they
      hold, so every cell that a level can reach twice is idempotent.
    * Latches stand beside the state. They refuse motion and `enable`; only `recover` clears them; FAULT and ESTOP are
      merely how a latched state is shown.
    * Nothing here knows how an action is carried out (`body.py`), what a condition looks like (`conditions.py`) or who
      asked (`handler.py`).

Words of the actions: see `Action`. `down` = CUT + BASE + ZERO: motions end, arm streams go off with the state, heartbeat
0.0 is repeated until FSM 0 is seen. `off` = CUT + BASE + SILENCE: the same without any 0.0, because the FSM is not ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from msgspec import Struct

from gateway.errors import Code

__all__ = [
    "ARMED",
    "BASE",
    "END_CODE",
    "LATCH_CODE",
    "STREAMING",
    "TABLE",
    "Action",
    "Cell",
    "State",
    "Supervisor",
    "Trigger",
]


class State(str, Enum):
    """Where the gateway is (DESIGN §4)."""

    OFFLINE = "OFFLINE"
    READ_ONLY = "READ_ONLY"
    IDLE = "IDLE"
    ENABLING = "ENABLING"
    ACTIVE = "ACTIVE"
    HOLDING = "HOLDING"
    PAUSED = "PAUSED"
    STOPPING = "STOPPING"
    STALE = "STALE"

    def __str__(self) -> str:
        """Return the bare name."""
        return self.value


ARMED = frozenset({State.ENABLING, State.ACTIVE, State.HOLDING, State.STOPPING})
"""States in which heartbeat 1.0 may be sent."""

STREAMING = frozenset({State.ENABLING, State.ACTIVE, State.HOLDING, State.PAUSED, State.STOPPING})
"""States in which arm frames are sent (STALE: constant ones at rest, for a short while)."""


class Trigger(str, Enum):
    """Everything that can move the supervisor: a row of the table each."""

    ACQUIRE = "acquire"
    TAKE = "take"
    RELEASE = "release"
    DISABLE = "disable"
    ENABLE = "enable"
    ARM_MOTION = "arm motion"
    GROUND_COMMAND = "chassis, lift command"
    OWNER_STOP = "owner's stop"
    OTHER_STOP = "other's stop"
    ESTOP = "estop"
    CLIENT_LOST = "client lost"
    CLIENT_LOST_PAUSE = "client lost, on_loss = pause"
    LEASE_FREE = "lease free"
    ENDPOINT_SILENT = "stop endpoint silent"
    ENDPOINT_SILENT_PAUSE = "stop endpoint silent, on_silence = pause"
    HOLD_OVER = "60 s"
    STALE = "stale"
    FRESH = "fresh"
    TRANSPORT_LOST = "transport lost"
    FSM_READY = "FSM READY"
    FSM_PAUSE = "FSM 0"
    FSM_SLOW_START = "FSM 1"
    FSM_FELL = "FSM from 1 to 0"
    FSM_ERROR = "FSM ERROR"
    FSM_FOREIGN = "FSM 3-6, unknown value"
    FSM_DEAD = "fsm_state dead"
    VR_MODE = "VR mode"
    MODE_UNKNOWN = "mode unknown"
    ARM_DISABLED = "one arm disabled"
    NO_ARM = "no arm enabled"
    PART_DEAD = "one part's state dead"
    TRACKING = "tracking error"
    LONG_GAP = "a gap longer than the arms' watchdog"
    FOREIGN_TOKEN = "foreign token or publisher"
    FOREIGN_DATA = "foreign arm or fsm data"
    FOREIGN_BESIDE_DRIVE = "foreign writer while chassis or lift run"
    OTHER_GATEWAY = "other gateway armed"
    GATE_VIOLATION = "gate violation"
    JOINT_ORDER = "names in another order"
    ENABLE_TIMEOUT = "enabling takes too long"
    AT_REST = "at rest"
    EXIT = "SIGTERM"
    SUSPENDED = "suspend and resume"
    PART_ENDED = "a part of the daemon ended"


class Action(str, Enum):
    """What a cell asks the body to do."""

    CUT = "cut"
    """End all motions and streams of targets; running arm streams brake; chassis zeros, lift [0,1] where they ran."""
    ZERO = "zero"
    """Repeat heartbeat 0.0 at 20 Hz until FSM 0 is seen, at most 2 s."""
    ZERO_IF_OWED = "zero if owed"
    """The same, only if a 1.0 of ours was out and no FSM 0 was seen since."""
    ZERO_ONCE = "zero once"
    """One 0.0, only if owed; ends a running repetition (not an e-stop's)."""
    SILENCE = "silence"
    """No heartbeat of either kind any more: the FSM is not ours."""
    LATCH = "latch"
    """Add the trigger's cause to the latches."""
    GROUND_CUT = "ground cut"
    """What a cut does to chassis and lift; the arms go on."""
    GROUND_STOP = "ground stop"
    """Chassis zeros for at least 1 s and lift [0,1], whoever drove them: an explicit stop."""
    LIFT_OFF = "lift off"
    """Lift [0,0]: stop, then servo off."""
    FREE = "free"
    """The lease becomes free."""


BASE = "BASE"
"""Destination: OFFLINE without transport, else STALE without fresh state, else READ_ONLY (VR or unowned), else IDLE."""


class Cell(Struct, frozen=True, kw_only=True):
    """One cell of the table.

    Attributes:
        to: A state, BASE, or None to stay.
        do: Actions in order.
        refuse: Code with which a request is refused; None when it is not.
    """

    to: State | str | None = None
    do: tuple[Action, ...] = ()
    refuse: Code | None = None


A, S = Action, State
SAME = Cell()
DOWN = Cell(to=BASE, do=(A.CUT, A.ZERO))
DOWN_LATCH = Cell(to=BASE, do=(A.CUT, A.ZERO, A.LATCH))
DOWN_LIFT_OFF = Cell(to=BASE, do=(A.CUT, A.ZERO, A.LIFT_OFF))
DOWN_FREE = Cell(to=BASE, do=(A.CUT, A.ZERO, A.LIFT_OFF, A.FREE))
OFF = Cell(to=BASE, do=(A.CUT, A.SILENCE))
CUT = Cell(do=(A.CUT,))
CUT_LATCH = Cell(do=(A.CUT, A.LATCH))
GROUND_CUT = Cell(do=(A.GROUND_CUT,))
LATCH_ONLY = Cell(do=(A.LATCH,))
BRAKE = Cell(to=S.HOLDING, do=(A.CUT,))
BRAKE_LATCH = Cell(to=S.HOLDING, do=(A.CUT, A.LATCH))
STOP_FIRST = Cell(to=S.STOPPING, do=(A.CUT,))
STOP_FIRST_LIFT_OFF = Cell(to=S.STOPPING, do=(A.CUT, A.LIFT_OFF))
LIFT_OFF = Cell(do=(A.LIFT_OFF,))
PAUSE = Cell(to=S.PAUSED, do=(A.CUT, A.ZERO))
GO_BASE = Cell(to=BASE)
OWED = Cell(to=BASE, do=(A.CUT, A.ZERO_IF_OWED))
OWED_LIFT_OFF = Cell(to=BASE, do=(A.CUT, A.ZERO_IF_OWED, A.LIFT_OFF))
BASE_LIFT_OFF = Cell(to=BASE, do=(A.CUT, A.LIFT_OFF))
BASE_FREE = Cell(to=BASE, do=(A.CUT, A.LIFT_OFF, A.FREE))
STOP_GROUND = Cell(do=(A.CUT, A.GROUND_STOP))
STOP_GROUND_LATCH = Cell(do=(A.CUT, A.GROUND_STOP, A.LATCH))
ESTOP = Cell(to=BASE, do=(A.CUT, A.GROUND_STOP, A.ZERO, A.LIFT_OFF, A.LATCH))


def refuse(code: Code) -> Cell:
    """Return the cell that refuses with `code`."""
    return Cell(refuse=code)


QUIET = (S.OFFLINE, S.STALE)
RESTING = (S.READ_ONLY, S.IDLE)


def _row(
    resting: Cell,
    enabling: Cell,
    active: Cell,
    holding: Cell,
    paused: Cell,
    stopping: Cell,
    quiet: Cell,
) -> Mapping[State, Cell]:
    """Return a row in the order of the columns of the behaviour table."""
    return {
        **dict.fromkeys(RESTING, resting),
        S.ENABLING: enabling,
        S.ACTIVE: active,
        S.HOLDING: holding,
        S.PAUSED: paused,
        S.STOPPING: stopping,
        **dict.fromkeys(QUIET, quiet),
    }


NOT_ENABLED = refuse(Code.NOT_ENABLED)
IS_STOPPING = refuse(Code.STOPPING)
IS_PAUSED = refuse(Code.ROBOT_PAUSED)
IS_STALE = refuse(Code.STATE_STALE)
ENABLE_HERE = Cell(to=S.ENABLING)
FOREIGN = Cell(to=BASE, do=(A.CUT, A.ZERO_ONCE, A.LATCH))

# columns:                        READ_ONLY, IDLE    ENABLING      ACTIVE        HOLDING       PAUSED        STOPPING      STALE, OFFLINE
TABLE: Mapping[Trigger, Mapping[State, Cell]] = {
    Trigger.ACQUIRE:           _row(GO_BASE,           SAME,         SAME,         SAME,         SAME,         SAME,         SAME),
    Trigger.TAKE:              _row(Cell(to=BASE, do=(A.CUT,)), DOWN, BRAKE,       SAME,         SAME,         SAME,         SAME),
    Trigger.RELEASE:           _row(BASE_LIFT_OFF,     DOWN_LIFT_OFF, STOP_FIRST_LIFT_OFF, STOP_FIRST_LIFT_OFF, DOWN_LIFT_OFF, LIFT_OFF, OWED_LIFT_OFF),
    Trigger.DISABLE:           _row(SAME,              DOWN,         STOP_FIRST,   STOP_FIRST,   DOWN,         SAME,         OWED),
    Trigger.ENABLE:            {**_row(ENABLE_HERE,    SAME,         SAME,         SAME,         ENABLE_HERE,  IS_STOPPING,  IS_STALE),
                                S.READ_ONLY: refuse(Code.NOT_OWNER), S.OFFLINE: refuse(Code.NO_LINK)},
    Trigger.ARM_MOTION:        {**_row(NOT_ENABLED,    NOT_ENABLED,  SAME,         Cell(to=S.ACTIVE), IS_PAUSED, IS_STOPPING, IS_STALE),
                                S.OFFLINE: refuse(Code.NO_LINK)},
    Trigger.GROUND_COMMAND:    {**_row(SAME,           SAME,         SAME,         SAME,         IS_PAUSED,    IS_STOPPING,  IS_STALE),
                                S.READ_ONLY: refuse(Code.NOT_OWNER), S.OFFLINE: refuse(Code.NO_LINK)},
    Trigger.OWNER_STOP:        _row(STOP_GROUND,       Cell(to=BASE, do=(A.CUT, A.GROUND_STOP, A.ZERO)),
                                    Cell(to=S.HOLDING, do=(A.CUT, A.GROUND_STOP)), STOP_GROUND, STOP_GROUND, STOP_GROUND, STOP_GROUND),
    Trigger.OTHER_STOP:        _row(STOP_GROUND_LATCH, Cell(to=BASE, do=(A.CUT, A.GROUND_STOP, A.ZERO, A.LATCH)),
                                    Cell(to=S.HOLDING, do=(A.CUT, A.GROUND_STOP, A.LATCH)),
                                    STOP_GROUND_LATCH, STOP_GROUND_LATCH, STOP_GROUND_LATCH, STOP_GROUND_LATCH),
    Trigger.ESTOP:             _row(ESTOP,             ESTOP,        ESTOP,        ESTOP,        ESTOP,        ESTOP,        ESTOP),
    Trigger.CLIENT_LOST:       _row(CUT,               DOWN,         BRAKE,        SAME,      SAME,         SAME,         CUT),
    Trigger.CLIENT_LOST_PAUSE: _row(BASE_FREE,         DOWN_FREE,    DOWN_FREE,    DOWN_FREE,    DOWN_FREE,
                                    Cell(do=(A.LIFT_OFF, A.FREE)), Cell(to=BASE, do=(A.CUT, A.ZERO_IF_OWED, A.LIFT_OFF, A.FREE))),
    Trigger.ENDPOINT_SILENT:   _row(CUT,               DOWN,         BRAKE,        CUT,          SAME,         SAME,         CUT),
    Trigger.ENDPOINT_SILENT_PAUSE: _row(CUT,           DOWN,         DOWN,         DOWN,         SAME,         SAME,         OWED),
    Trigger.LEASE_FREE:        _row(Cell(to=BASE, do=(A.LIFT_OFF,)), SAME, SAME,   SAME,         SAME,         SAME,         SAME),
    Trigger.HOLD_OVER:         {**_row(SAME,           SAME,         SAME,         DOWN_LIFT_OFF, DOWN_LIFT_OFF, SAME,       SAME), S.STALE: GO_BASE},
    Trigger.STALE:             {**_row(Cell(to=S.STALE, do=(A.CUT,)), Cell(to=S.STALE, do=(A.CUT, A.ZERO)), Cell(to=S.STALE, do=(A.CUT,)),
                                    Cell(to=S.STALE, do=(A.CUT,)), Cell(to=S.STALE, do=(A.CUT, A.ZERO)),
                                    Cell(to=S.STALE, do=(A.CUT, A.ZERO)), SAME)},
    Trigger.FRESH:             _row(SAME,              SAME,         SAME,         SAME,         SAME,         SAME,         GO_BASE),
    Trigger.TRANSPORT_LOST:    {**dict.fromkeys(State, Cell(to=S.OFFLINE, do=(A.CUT, A.SILENCE))), S.OFFLINE: SAME},
    Trigger.FSM_READY:         _row(SAME,              Cell(to=S.ACTIVE), SAME,    SAME,         Cell(do=(A.ZERO,)), SAME,   SAME),
    Trigger.FSM_PAUSE:         _row(SAME,              SAME,         PAUSE,        PAUSE,        SAME,         Cell(to=BASE, do=(A.ZERO_IF_OWED,)), SAME),
    Trigger.FSM_SLOW_START:    _row(SAME,              SAME,         PAUSE,        PAUSE,        Cell(do=(A.ZERO,)), SAME,   SAME),
    Trigger.FSM_FELL:          _row(SAME,              DOWN,         SAME,         SAME,         SAME,         SAME,         SAME),
    Trigger.FSM_ERROR:         _row(SAME,              DOWN_LATCH,   DOWN_LATCH,   DOWN_LATCH,   DOWN_LATCH,   DOWN_LATCH,   SAME),
    Trigger.FSM_FOREIGN:       _row(SAME,              OFF,          OFF,          OFF,          OFF,          OFF,          SAME),
    Trigger.FSM_DEAD:          {**_row(SAME,           DOWN,         PAUSE,        PAUSE,        SAME,         SAME,         SAME), S.STALE: DOWN},
    Trigger.VR_MODE:           _row(Cell(to=BASE, do=(A.CUT,)), OFF,   OFF,          OFF,          OFF,          OFF,          SAME),
    Trigger.MODE_UNKNOWN:      _row(SAME,              SAME,         BRAKE,        SAME,         SAME,         SAME,         SAME),
    Trigger.ARM_DISABLED:      _row(SAME,              SAME,         BRAKE,        SAME,         SAME,         SAME,         SAME),
    Trigger.NO_ARM:            _row(SAME,              DOWN,         DOWN,         DOWN,         DOWN,         DOWN,         SAME),
    Trigger.PART_DEAD:         _row(SAME,              DOWN,         BRAKE,        SAME,         SAME,         SAME,         SAME),
    Trigger.TRACKING:          _row(SAME,              SAME,         BRAKE_LATCH,  SAME,         SAME,         SAME,         SAME),
    Trigger.LONG_GAP:          _row(GROUND_CUT,        GROUND_CUT,   BRAKE,        GROUND_CUT,       SAME,         SAME,         SAME),
    Trigger.FOREIGN_TOKEN:     _row(SAME,              DOWN_LATCH,   BRAKE_LATCH,  CUT_LATCH,    CUT_LATCH,    CUT_LATCH,    SAME),
    Trigger.FOREIGN_DATA:      _row(SAME,              FOREIGN,      FOREIGN,      FOREIGN,      FOREIGN,      FOREIGN,      SAME),
    Trigger.FOREIGN_BESIDE_DRIVE: _row(CUT_LATCH,      SAME,         SAME,         SAME,         SAME,         SAME,         SAME),
    Trigger.OTHER_GATEWAY:     _row(SAME,              OFF,          OFF,          OFF,          OFF,          OFF,          SAME),
    Trigger.GATE_VIOLATION:    dict.fromkeys(State, DOWN_LATCH),
    Trigger.JOINT_ORDER:       _row(LATCH_ONLY,        DOWN_LATCH,   DOWN_LATCH,   DOWN_LATCH,   DOWN_LATCH,   DOWN_LATCH,   Cell(to=BASE, do=(A.LATCH,))),
    Trigger.ENABLE_TIMEOUT:    _row(SAME,              OWED,         SAME,         SAME,         SAME,         SAME,         SAME),
    Trigger.AT_REST:           _row(SAME,              SAME,         SAME,         SAME,         SAME,         Cell(do=(A.ZERO,)), SAME),
    Trigger.EXIT:              _row(BASE_LIFT_OFF,     DOWN_LIFT_OFF, STOP_FIRST_LIFT_OFF, STOP_FIRST_LIFT_OFF, DOWN_LIFT_OFF, LIFT_OFF, OWED_LIFT_OFF),
    Trigger.PART_ENDED:        _row(STOP_GROUND_LATCH, Cell(to=BASE, do=(A.CUT, A.GROUND_STOP, A.ZERO, A.LATCH)),
                                    Cell(to=S.HOLDING, do=(A.CUT, A.GROUND_STOP, A.LATCH)),
                                    STOP_GROUND_LATCH, STOP_GROUND_LATCH, STOP_GROUND_LATCH, STOP_GROUND_LATCH),
    Trigger.SUSPENDED:         _row(BASE_FREE,         DOWN_FREE,    DOWN_FREE,    DOWN_FREE,    DOWN_FREE,    DOWN_FREE,    BASE_FREE),
}  # fmt: skip
"""Row by trigger, cell by state: BEHAVIOUR, Transitions."""

LATCH_CODE: dict[Trigger, Code] = {
    Trigger.ESTOP: Code.ESTOP,
    Trigger.OTHER_STOP: Code.STOPPED_BY_OTHER,
    Trigger.FSM_ERROR: Code.FSM_ERROR,
    Trigger.TRACKING: Code.TRACKING_ERROR,
    Trigger.FOREIGN_TOKEN: Code.FOREIGN_WRITER,
    Trigger.FOREIGN_DATA: Code.FOREIGN_WRITER,
    Trigger.FOREIGN_BESIDE_DRIVE: Code.FOREIGN_WRITER,
    Trigger.GATE_VIOLATION: Code.GATE_VIOLATION,
    Trigger.JOINT_ORDER: Code.JOINT_ORDER,
    Trigger.PART_ENDED: Code.GATEWAY_BROKEN,
}
"""Cause under which a trigger latches."""

END_CODE: dict[Trigger, Code] = {
    **LATCH_CODE,
    Trigger.OTHER_STOP: Code.STOPPED,
    Trigger.OWNER_STOP: Code.STOPPED,
    Trigger.TAKE: Code.LEASE_LOST,
    Trigger.RELEASE: Code.STOPPED,
    Trigger.DISABLE: Code.STOPPED,
    Trigger.CLIENT_LOST: Code.CLIENT_LOST,
    Trigger.CLIENT_LOST_PAUSE: Code.CLIENT_LOST,
    Trigger.ENDPOINT_SILENT: Code.ENDPOINT_SILENT,
    Trigger.ENDPOINT_SILENT_PAUSE: Code.ENDPOINT_SILENT,
    Trigger.HOLD_OVER: Code.CLIENT_LOST,
    Trigger.STALE: Code.STATE_STALE,
    Trigger.TRANSPORT_LOST: Code.NO_LINK,
    Trigger.FSM_PAUSE: Code.ROBOT_PAUSED,
    Trigger.FSM_SLOW_START: Code.ROBOT_PAUSED,
    Trigger.FSM_FELL: Code.ROBOT_PAUSED,
    Trigger.FSM_DEAD: Code.FSM_UNKNOWN,
    Trigger.FSM_FOREIGN: Code.FSM_BUSY,
    Trigger.VR_MODE: Code.MODE_VR,
    Trigger.MODE_UNKNOWN: Code.MODE_UNKNOWN,
    Trigger.ARM_DISABLED: Code.ARM_DISABLED,
    Trigger.NO_ARM: Code.NO_ARM_ENABLED,
    Trigger.PART_DEAD: Code.PART_LOST,
    Trigger.OTHER_GATEWAY: Code.OTHER_GATEWAY,
    Trigger.ENABLE_TIMEOUT: Code.ENABLE_TIMEOUT,
    Trigger.EXIT: Code.EXITING,
    Trigger.LONG_GAP: Code.TICK_LATE,
    Trigger.SUSPENDED: Code.SUSPENDED,
}
"""Code with which motions and streams of targets end, or an enabling fails, when a trigger cuts them."""


class Supervisor:
    """Holds the state and the latches; moves only by the table."""

    def __init__(self, latches: Mapping[Code, str]) -> None:
        self.state = State.OFFLINE
        self.since_ns = 0
        """When the present state was entered [ns]."""
        self.came_from = State.OFFLINE
        """The state before the present one."""
        self.latches: dict[Code, str] = dict(latches)
        self.stopper = ""
        """Who left the stop that is latched, where that was one client alone; empty for others, and after a restart."""

    @property
    def shown(self) -> str:
        """What a person should read: ESTOP or FAULT when latched, else the state."""
        if Code.ESTOP in self.latches:
            return "ESTOP"
        return "FAULT" if self.latches else self.state.value

    def cell(self, trigger: Trigger) -> Cell:
        """Return what the trigger would do now, without doing it."""
        return TABLE[trigger][self.state]

    def move(self, to: State, now_ns: int) -> bool:
        """Enter a state; return whether it is another one than before."""
        if to is self.state:
            return False
        self.came_from, self.state, self.since_ns = self.state, to, now_ns
        return True

    def latch(self, code: Code, message: str) -> bool:
        """Add a cause; return whether it is new. The first message of a cause is kept."""
        if code in self.latches:
            return False
        self.latches[code] = message
        return True

    def clear(self) -> bool:
        """Clear all causes; return whether there were any. Only `recover` calls this."""
        had_any = bool(self.latches)
        self.latches.clear()
        self.stopper = ""
        return had_any
