"""The supervisor: every trigger in every state does what the behaviour table says, and nothing arms by itself."""

from __future__ import annotations

from itertools import product

import pytest

from gateway.core.supervision.supervisor import ARMED, BASE, STREAMING, TABLE, Action, Cell, State, Supervisor, Trigger
from gateway.errors import CODES, Code

# The transitions of the behaviour table, typed from its text and not from the code: one row per trigger, the columns as
# there. `a / b` splits a column that stands for two states. What the lease does by itself (clocks, owner) and what a
# request is told beyond the table stands there too, but moves nothing: see QUIET_WORDS.
BEHAVIOUR = """
row                         | READ_ONLY / IDLE        | ENABLING            | ACTIVE                    | HOLDING             | PAUSED              | STOPPING            | STALE / OFFLINE
acquire                     | lease, base             | =                   | -                         | lease, clocks end   | lease, clocks end   | lease, then IDLE    | lease
take                        | cut, lease, base        | down                | cut, brake, HOLDING       | lease               | lease               | lease, then IDLE    | lease
release                     | cut, base, [0,0]        | down, [0,0]         | cut, STOPPING, [0,0]      | STOPPING, [0,0]     | down, [0,0]         | =, [0,0]            | cut, 0.0 if owed, base, [0,0]
disable                     | =                       | down                | STOPPING                  | STOPPING            | down                | =                   | cut, 0.0 if owed, base
enable                      | NOT_OWNER / ENABLING    | =                   | ok                        | ok                  | ENABLING            | STOPPING!           | STATE_STALE / NO_LINK
arm motion                  | NOT_ENABLED             | NOT_ENABLED         | ok                        | ACTIVE              | ROBOT_PAUSED        | STOPPING!           | STATE_STALE / NO_LINK
chassis, lift command       | NOT_OWNER / ok          | ok                  | ok                        | ok                  | ROBOT_PAUSED        | STOPPING!           | STATE_STALE / NO_LINK
owner's stop                | cut, ground             | down, ground        | cut, brake, HOLDING, ground    | cut, ground    | cut, ground         | cut, ground         | cut, ground
other's stop                | cut, ground, L          | down, ground, L     | cut, brake, HOLDING, ground, L | cut, ground, L | cut, ground, L      | cut, ground, L      | cut, ground, L
estop                       | down, ground, [0,0], L  | down, ground, [0,0], L | down, ground, [0,0], L | down, ground, [0,0], L | down, ground, [0,0], L | down, ground, [0,0], L | down, ground, [0,0], L
client lost                 | cut, free after 10 s    | down, free after 10 s | cut, brake, HOLDING, 10/60 s | 10/60 s        | 10/60 s             | 10 s                | cut, 10 s
client lost, on_loss = pause| cut, base, free, [0,0]  | down, free, [0,0]   | down, free, [0,0]         | down, free, [0,0]   | down, free, [0,0]   | free, [0,0]         | cut, 0.0 if owed, base, free, [0,0]
stop endpoint silent        | cut                     | down                | cut, brake, HOLDING       | cut                 | =                   | =                   | cut
stop endpoint silent, on_silence = pause| cut           | down                | down                      | down                | =                   | =                   | cut, 0.0 if owed, base
lease free                  | base, [0,0]             | -                   | -                         | unowned             | unowned             | =                   | unowned
60 s                        | -                       | -                   | -                         | down, [0,0]         | down, [0,0]         | =                   | base / =
stale                       | STALE, cut              | STALE, cut, 0.0     | STALE, cut                | STALE, cut          | STALE, cut, 0.0     | STALE, cut, 0.0     | =
fresh                       | =                       | -                   | -                         | -                   | -                   | -                   | base
transport lost              | OFFLINE, cut, silence   | OFFLINE, cut, silence | OFFLINE, cut, silence   | OFFLINE, cut, silence | OFFLINE, cut, silence | OFFLINE, cut, silence | OFFLINE, cut, silence / =
FSM READY                   | =                       | ACTIVE              | =                         | =                   | 0.0                 | =                   | -
FSM 0                       | =                       | =                   | PAUSED                    | PAUSED              | =                   | 0.0 if owed, base   | -
FSM 1                       | =                       | =                   | PAUSED                    | PAUSED              | 0.0                 | =                   | -
FSM from 1 to 0             | =                       | down                | -                         | -                   | -                   | -                   | -
FSM ERROR                   | refuse enable           | down, L             | down, L                   | down, L             | down, L             | down, L             | after our own 1.0
FSM 3-6, unknown value      | refuse enable           | off                 | off                       | off                 | off                 | off                 | -
fsm_state dead              | refuse enable           | down                | PAUSED                    | PAUSED              | =                   | =                   | down / -
VR mode                     | READ_ONLY, cut          | off                 | off                       | off                 | off                 | off                 | -
mode unknown                | refuse enable           | =                   | brake, HOLDING            | =                   | =                   | =                   | -
one arm disabled            | =                       | =                   | brake, HOLDING            | =                   | =                   | =                   | =
no arm enabled              | =                       | down                | down                      | down                | down                | down                | =
one part's state dead       | =                       | down                | brake, HOLDING            | =                   | =                   | =                   | =
tracking error              | -                       | -                   | brake, HOLDING, L         | refuse motion       | -                   | -                   | -
a gap longer than the arms' watchdog | drives        | drives             | brake, HOLDING            | drives             | =                   | =                   | =
foreign token or publisher  | refuse enable           | down, L             | cut, brake, HOLDING, L    | cut, L              | cut, L              | cut, L              | refuse
foreign arm or fsm data     | refuse enable           | 0.0 once, cut, base, L | 0.0 once, cut, base, L | 0.0 once, cut, base, L | 0.0 once, cut, base, L | 0.0 once, cut, base, L | refuse
foreign writer while chassis or lift run | cut, L     | =                   | =                         | =                   | =                   | =                   | =
other gateway armed         | refuse enable           | off                 | off                       | off                 | off                 | off                 | no resume
gate violation              | down, L                 | down, L             | down, L                   | down, L             | down, L             | down, L             | down, L
names in another order      | L                       | down, L             | down, L                   | down, L             | down, L             | down, L             | L, base
enabling takes too long     | -                       | cut, 0.0 if owed, base | -                      | -                   | -                   | -                   | -
at rest                     | -                       | -                   | -                         | -                   | -                   | 0.0                 | -
SIGTERM                     | cut, base, [0,0], exit  | down, [0,0], exit   | brake, STOPPING, [0,0], exit | STOPPING, [0,0], exit | down, [0,0], exit | [0,0], exit         | cut, 0.0 if owed, base, [0,0], exit
a part of the daemon ended  | cut, ground, L          | down, ground, L     | cut, brake, HOLDING, ground, L | cut, ground, L | cut, ground, L      | cut, ground, L      | cut, ground, L
suspend and resume          | cut, free, base, [0,0]  | down, free, [0,0]   | down, free, [0,0]         | down, free, [0,0]   | down, free, [0,0]   | down, free, [0,0]   | cut, free, base, [0,0]
"""  # noqa: E501

COLUMNS = (
    (State.READ_ONLY, State.IDLE), (State.ENABLING,), (State.ACTIVE,), (State.HOLDING,), (State.PAUSED,),
    (State.STOPPING,), (State.STALE, State.OFFLINE),
)  # fmt: skip
QUIET_WORDS = {
    "=", "-", "ok", "exit",
    "lease", "clocks end", "then IDLE", "unowned", "10 s", "10/60 s", "free after 10 s",  # the lease's own clocks
    "refuse", "refuse enable", "refuse motion", "no resume", "after our own 1.0",  # asked where they matter
}  # fmt: skip
"""Words that move nothing by themselves."""
ACTIONS = {
    "cut": {Action.CUT},
    "brake": {Action.CUT},
    "down": {Action.CUT, Action.ZERO},
    "off": {Action.CUT, Action.SILENCE},
    "silence": {Action.SILENCE},
    "0.0": {Action.ZERO},
    "0.0 if owed": {Action.ZERO_IF_OWED},
    "0.0 once": {Action.ZERO_ONCE},
    "[0,0]": {Action.LIFT_OFF},
    "ground": {Action.GROUND_STOP},
    "drives": {Action.GROUND_CUT},
    "L": {Action.LATCH},
    "free": {Action.FREE},
    "STOPPING": {Action.CUT},
    "PAUSED": {Action.CUT, Action.ZERO},
}
"""What each word asks for. STOPPING begins by braking; PAUSED is held as HOLDING is, with 0.0 until FSM 0 is seen."""
PLACES = {
    **{word: BASE for word in ("base", "down", "off")},
    **{state.value: state for state in (State.ENABLING, State.ACTIVE, State.HOLDING, State.STOPPING)},
    **{state.value: state for state in (State.PAUSED, State.STALE, State.OFFLINE)},
    "READ_ONLY": BASE,  # the base in VR mode
}
"""Where each word leads."""
REFUSALS = {
    **{code.value: code for code in (Code.NOT_OWNER, Code.NOT_ENABLED, Code.ROBOT_PAUSED, Code.STATE_STALE)},
    "NO_LINK": Code.NO_LINK,
    "STOPPING!": Code.STOPPING,
}


def expected() -> dict[tuple[str, State], set[str]]:
    """Read the text above: per row and state the words of its cell."""
    cells: dict[tuple[str, State], set[str]] = {}
    _, *rows = BEHAVIOUR.strip().splitlines()
    for line in rows:
        row, *columns = (part.strip() for part in line.split("|"))
        for text, states in zip(columns, COLUMNS, strict=True):
            halves = text.split(" / ") if " / " in text else [text] * len(states)
            for state, half in zip(states, halves, strict=True):
                # `[0,0]` is one word although it has a comma
                cells[row, state] = {w.strip() for w in half.replace("[0,0]", "off!").split(",")}
                cells[row, state] = {"[0,0]" if w == "off!" else w for w in cells[row, state]}
    return cells


EXPECTED = expected()
LEVELS = [
    Trigger.STALE, Trigger.TRANSPORT_LOST, Trigger.FSM_READY, Trigger.FSM_PAUSE, Trigger.FSM_SLOW_START,
    Trigger.FSM_FELL, Trigger.FSM_ERROR, Trigger.FSM_FOREIGN, Trigger.FSM_DEAD, Trigger.VR_MODE, Trigger.MODE_UNKNOWN,
    Trigger.ARM_DISABLED, Trigger.NO_ARM, Trigger.PART_DEAD, Trigger.TRACKING, Trigger.FOREIGN_TOKEN,
    Trigger.FOREIGN_DATA, Trigger.FOREIGN_BESIDE_DRIVE, Trigger.OTHER_GATEWAY, Trigger.JOINT_ORDER, Trigger.AT_REST,
]  # fmt: skip
"""Conditions of the robot: fired again on every tick while they hold."""
RESTS = (State.OFFLINE, State.STALE, State.READ_ONLY, State.IDLE)
"""What BASE can mean."""


def ends_in(trigger: Trigger, state: State) -> tuple[State, ...]:
    """The states in which a trigger can leave the supervisor."""
    to = TABLE[trigger][state].to
    return RESTS if to == BASE else (state if to is None else State(to),)


# ------------------------------------------------------------------------------------------------------- the table


def test_every_row_of_the_behaviour_table_is_a_trigger_and_every_trigger_has_a_row():
    """No trigger without a rule, no rule without a trigger, and a cell for every state."""
    assert {row for row, _ in EXPECTED} == {trigger.value for trigger in Trigger} == {key.value for key in TABLE}
    assert all(set(row) == set(State) for row in TABLE.values())


@pytest.mark.parametrize("trigger", list(Trigger), ids=lambda trigger: trigger.value)
def test_each_cell_does_what_the_behaviour_table_says(trigger):
    """Destination, actions and refusal of every state, against the text (BEHAVIOUR, Transitions)."""
    for state in State:
        words = EXPECTED[trigger.value, state]
        assert words <= {*QUIET_WORDS, *ACTIONS, *PLACES, *REFUSALS}, f"{trigger.value} in {state}: {words}"
        cell = TABLE[trigger][state]
        places = {PLACES[word] for word in words if word in PLACES}
        refusals = {REFUSALS[word] for word in words if word in REFUSALS}
        actions = set().union(*(ACTIONS[word] for word in words if word in ACTIONS))
        assert ({cell.to} - {None}, {cell.refuse} - {None}) == (places, refusals), f"{trigger.value} in {state}"
        assert set(cell.do) == actions, f"{trigger.value} in {state}"


def test_actions_come_in_the_order_in_which_they_must_be_done():
    """Motions end before anything else; the lift's [0,0] follows its [0,1]; nothing is done twice."""
    for trigger, state in product(Trigger, State):
        do = TABLE[trigger][state].do
        assert len(set(do)) == len(do)
        assert Action.CUT not in do[1:], f"{trigger.value} in {state}"
        if {Action.GROUND_STOP, Action.LIFT_OFF} <= set(do):
            assert do.index(Action.GROUND_STOP) < do.index(Action.LIFT_OFF)


def test_what_is_refused_does_nothing_else():
    """A refusal has a code that a caller understands, with a remedy, and moves nothing."""
    refused = [cell for row in TABLE.values() for cell in row.values() if cell.refuse is not None]
    assert refused
    for cell in refused:
        assert (cell.to, cell.do) == (None, ()) and CODES[cell.refuse].hint


@pytest.mark.parametrize("trigger", [Trigger.OWNER_STOP, Trigger.OTHER_STOP, Trigger.ESTOP], ids=lambda t: t.value)
def test_a_stop_is_never_refused_and_always_stops_the_ground(trigger):
    """In every state: motions end, chassis zeros, lift (BEHAVIOUR, stopping and losing)."""
    for state in State:
        cell = TABLE[trigger][state]
        assert cell.refuse is None and {Action.CUT, Action.GROUND_STOP} <= set(cell.do)


def test_an_estop_pauses_the_robot_from_every_state():
    """0.0, lift [0,1] then [0,0], and a latch, whatever was going on."""
    assert set(TABLE[Trigger.ESTOP].values()) == {
        Cell(to=BASE, do=(Action.CUT, Action.GROUND_STOP, Action.ZERO, Action.LIFT_OFF, Action.LATCH))
    }


def test_vr_mode_does_not_end_an_estops_zeros():
    """`estop` does send 0.0 in VR mode; at rest there is no other heartbeat that the cell could have to end."""
    assert Action.SILENCE not in TABLE[Trigger.VR_MODE][State.IDLE].do
    assert Action.SILENCE not in TABLE[Trigger.VR_MODE][State.READ_ONLY].do


@pytest.mark.parametrize(
    "trigger",
    [
        Trigger.RELEASE, Trigger.DISABLE, Trigger.ESTOP, Trigger.CLIENT_LOST_PAUSE, Trigger.HOLD_OVER, Trigger.EXIT,
        Trigger.SUSPENDED, Trigger.JOINT_ORDER,
    ],
    ids=lambda trigger: trigger.value,
)  # fmt: skip
def test_what_would_end_holding_ends_the_hold_of_a_stall_too(trigger):
    """Nothing is held on after it, and fresh state leads to the base (BEHAVIOUR, stale): a hold without an end is none."""
    assert TABLE[trigger][State.HOLDING].to in {BASE, State.STOPPING}
    assert TABLE[trigger][State.STALE].to == BASE


def test_only_enable_arms_and_only_a_motion_resumes():
    """A reconnect, a fresh state, a new owner or an FSM that is READY never re-arm (DESIGN §8.7)."""
    ways = {(trigger, state, to) for trigger, state in product(Trigger, State) for to in ends_in(trigger, state)}
    into = {(t, s, to) for t, s, to in ways if to in {State.ENABLING, State.ACTIVE} and to is not s}
    assert into == {
        (Trigger.ENABLE, State.IDLE, State.ENABLING),
        (Trigger.ENABLE, State.PAUSED, State.ENABLING),
        (Trigger.FSM_READY, State.ENABLING, State.ACTIVE),
        (Trigger.ARM_MOTION, State.HOLDING, State.ACTIVE),
    }
    held = {State.HOLDING, State.PAUSED, State.STOPPING}
    assert {s for _, s, to in ways if to in held and to is not s} <= {State.ACTIVE, State.HOLDING}


def test_no_way_out_of_the_armed_states_leaves_the_heartbeat_undecided():
    """Every end of 1.0 is followed by 0.0 or by a deliberate silence; STALE remembers what is owed."""
    says = {Action.ZERO, Action.ZERO_IF_OWED, Action.ZERO_ONCE, Action.SILENCE}
    for trigger, state in product(Trigger, sorted(ARMED)):
        leaves = [to for to in ends_in(trigger, state) if to not in ARMED]
        if not leaves or leaves == [State.STALE]:
            continue
        assert says & set(TABLE[trigger][state].do), f"{trigger.value} in {state}"


@pytest.mark.parametrize("trigger", LEVELS, ids=lambda trigger: trigger.value)
def test_a_condition_that_lasts_moves_the_state_only_once(trigger):
    """Levels are fired on every tick: where they have led, they lead nowhere else."""
    for state in State:
        for there in ends_in(trigger, state):
            if there is not state:
                assert TABLE[trigger][there].to in {None, BASE, there}, f"{trigger.value}: {state} -> {there}"


def test_arm_frames_are_streamed_wherever_1_0_may_be_and_while_paused():
    """DESIGN §4: hold frames in PAUSED, but no 1.0; nothing in the states of rest."""
    assert ARMED == {State.ENABLING, State.ACTIVE, State.HOLDING, State.STOPPING}
    assert STREAMING == ARMED | {State.PAUSED}


# -------------------------------------------------------------------------------------------------- the supervisor


def test_a_supervisor_starts_offline_with_what_was_latched_before():
    """A restart of the daemon clears no latch (DESIGN §8.7), and its own dictionary is not the caller's."""
    remembered = {Code.TRACKING_ERROR: "0.4 rad off"}
    supervisor = Supervisor(remembered)
    remembered.clear()
    assert (supervisor.state, supervisor.came_from, supervisor.since_ns) == (State.OFFLINE, State.OFFLINE, 0)
    assert supervisor.latches == {Code.TRACKING_ERROR: "0.4 rad off"}


def test_a_move_remembers_where_from_and_since_when_and_staying_is_no_move():
    """A level that is fired again must not start the clocks of a state anew."""
    supervisor = Supervisor({})
    assert supervisor.move(State.IDLE, 5)
    assert supervisor.move(State.ENABLING, 7)
    assert not supervisor.move(State.ENABLING, 9)
    assert (supervisor.state, supervisor.came_from, supervisor.since_ns) == (State.ENABLING, State.IDLE, 7)


def test_asking_for_a_cell_changes_nothing():
    """What a trigger would do can be looked up without doing it."""
    supervisor = Supervisor({})
    assert supervisor.cell(Trigger.ENABLE).refuse is Code.NO_LINK
    supervisor.move(State.IDLE, 1)
    assert supervisor.cell(Trigger.ENABLE).to is State.ENABLING
    assert supervisor.state is State.IDLE


def test_latches_stand_beside_the_state_and_go_only_all_together():
    """FAULT and ESTOP are how a latched state is shown; the first message of a cause is kept; clearing clears all."""
    supervisor = Supervisor({})
    supervisor.move(State.HOLDING, 1)
    assert (supervisor.shown, supervisor.clear()) == ("HOLDING", False)
    assert supervisor.latch(Code.STOPPED_BY_OTHER, "bob")
    assert not supervisor.latch(Code.STOPPED_BY_OTHER, "carol")
    assert supervisor.latches == {Code.STOPPED_BY_OTHER: "bob"}
    assert supervisor.shown == "FAULT"
    assert supervisor.latch(Code.ESTOP, "dave")
    assert supervisor.shown == "ESTOP" and supervisor.state is State.HOLDING
    assert supervisor.clear()
    assert (supervisor.latches, supervisor.shown) == ({}, "HOLDING")


def test_a_state_prints_as_its_bare_name():
    """Messages and snapshots say HOLDING, not State.HOLDING."""
    assert [f"{state}" for state in State] == [state.value for state in State] == [state.name for state in State]
