"""BEHAVIOUR, Transitions: every cell, with engine and robot together.

The table below is the behaviour table's, typed from its text: one row per event, one cell per state, in words that say
what must be *seen*. `-` marks cells that cannot occur. Chassis and lift commands have a file of their
own (`test_driving.py`).
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gateway.core.messages.events import ExitRequested, Suspended
from gateway.core.messages.outputs import FrameKind, Reply
from gateway.core.messages.sightings import ForeignData, ForeignTokens, Gateway, GatewayTokens, Means, Writer
from gateway.errors import Code
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import Acquire, Disable, Enable, Estop, Move, Recover, Release, Stop, Take
from gateway.robot.topics import CHASSIS_VELOCITY, CURRENT_MODE, FSM_ENABLE, FSM_STATE, arm_state
from gateway.values import Side
from tests.behaviour.scene import HOME, LEAN, Scene, scene
from tests.pair import MS, S

COLUMNS = ("READ_ONLY", "VR", "IDLE", "ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE", "OFFLINE")

TABLE = """
event          | READ_ONLY      | VR              | IDLE            | ENABLING       | ACTIVE              | HOLDING       | PAUSED            | STOPPING       | STALE                | OFFLINE
take           | IDLE           | =               | =               | down           | hold                | =             | =                 | stops to IDLE  | =                    | =
release        | -              | free, nothing   | free, nothing   | free, down     | free, stops first   | free, stops first | free, down    | free, stops    | free, 0.0, silent    | free, nothing
disable        | -              | nothing         | nothing         | down           | stops first         | stops first   | down              | stops          | 0.0, silent          | nothing
enable         | NOT_OWNER      | MODE_VR         | ENABLING        | ok, =          | ok, =               | ok, =         | ENABLING          | STOPPING!      | STATE_STALE          | NO_LINK
arm motion     | NOT_OWNER      | MODE_VR         | NOT_ENABLED     | NOT_ENABLED    | ok, moves           | ok, moves     | ROBOT_PAUSED      | STOPPING!      | STATE_STALE          | NO_LINK
owner's stop   | -              | ground          | ground          | ground, down   | ground, hold        | ground, =     | ground, =         | ground, stops  | ground, =            | ground
other's stop   | ground, L      | ground, L       | ground, L       | ground, L, down | ground, L, hold    | ground, L, =  | ground, L, =      | ground, L, stops | ground, L, =       | ground, L
estop          | ground, L, down | ground, L, 0.0 | ground, L, down | ground, L, down | ground, L, down    | ground, L, down | ground, L, down | ground, L, down | ground, L, 0.0, silent | ground, L
recover        | ok, nothing    | ok, nothing     | ok, nothing     | ok, =          | ok, =               | ok, =         | ok, =             | ok, stops      | STATE_STALE          | NO_LINK
client lost    | -              | nothing         | nothing         | down           | hold                | =             | =                 | stops          | =                    | =
lost, pause    | -              | free, nothing   | free, nothing   | free, down     | free, down          | free, down    | free, down        | free, stops    | free, 0.0, silent    | free, nothing
stale          | STALE, nothing | STALE, nothing  | STALE, nothing  | STALE, 0.0     | STALE, falls silent, last word | STALE, keeps, last word | STALE, 0.0, keeps | STALE, 0.0     | =                    | =
transport lost | OFFLINE        | OFFLINE         | OFFLINE         | OFFLINE        | OFFLINE             | OFFLINE       | OFFLINE           | OFFLINE        | OFFLINE              | =
FSM READY      | nothing        | nothing         | nothing         | ACTIVE         | =                   | =             | 0.0, PAUSED       | gives up       | -                    | -
FSM 0          | nothing        | nothing         | nothing         | down           | pauses              | pauses        | =                 | 0.0, silent    | -                    | -
FSM 1          | nothing        | nothing         | nothing         | =              | pauses              | pauses        | 0.0, PAUSED       | gives up       | -                    | -
FSM ERROR      | nothing        | nothing         | nothing         | L, 0.0, silent | L, 0.0, silent      | L, 0.0, silent | L, 0.0, silent   | L, 0.0, silent | L, silent            | -
FSM 3          | nothing        | nothing         | nothing         | off            | off                 | off           | off               | off            | -                    | -
FSM 9          | nothing        | nothing         | nothing         | off            | off                 | off           | off               | off            | -                    | -
fsm dead       | nothing        | nothing         | nothing         | 0.0, silent    | pauses              | pauses        | =                 | stops          | -                    | -
VR mode        | nothing        | =               | READ_ONLY, nothing | off         | off                 | off           | off               | off            | silent               | -
mode unknown   | nothing        | nothing         | nothing         | =              | hold                | =             | =                 | stops          | -                    | -
arm disabled   | nothing        | nothing         | nothing         | left silent, =  | left silent, hold  | left silent, = | left silent, =   | left silent, stops | -                | -
no arm         | nothing        | nothing         | nothing         | down           | down                | down          | down              | down           | -                    | -
part dead      | nothing        | nothing         | nothing         | down           | hold                | =             | =                 | stops          | -                    | -
tracking error | -              | -               | -               | -              | L, gives way        | =             | =                 | stops          | -                    | -
SIGTERM        | nothing, exit  | nothing, exit   | nothing, exit   | down, exit     | stops first, exit   | stops first, exit | down, exit    | stops, exit    | 0.0, silent, exit    | nothing, exit
suspend        | nothing        | free, nothing   | free, nothing   | free, down     | free, down          | free, down    | free, down        | free, down     | free, silent         | free, nothing
foreign token  | nothing        | nothing         | nothing         | down, L        | L, hold             | L, =          | L, =              | L, stops       | =                    | =
foreign data   | nothing        | nothing         | nothing         | L, base, 0.0 once | L, base, 0.0 once | L, base, 0.0 once | L, base, nothing | L, base, 0.0 once | silent       | nothing
other gateway  | nothing        | nothing         | nothing         | off            | off                 | off           | off               | off            | silent               | nothing
joint order    | L, nothing     | L, nothing      | L, nothing      | L, down        | L, down             | L, down       | L, down           | L, down        | L, silent            | -
"""  # noqa: E501


# ------------------------------------------------------------------------------------------------------- the events

Event = Callable[[Scene], Reply | None]


def _ask(request: Callable[[Scene], object], client: str = "ann") -> Event:
    return lambda pair: pair.ask(request(pair), client)


def _steps_until(pair: Scene, is_so: Callable[[], bool], seconds: float = 3.5) -> None:
    """Go on, and judge from the tick in which it is so."""
    until_ns = pair.now_ns + round(seconds * S)
    while not is_so():
        assert pair.now_ns < until_ns, f"never happened; {pair.state}, {pair.last_words()}"
        pair.mark_ns = pair.now_ns + 1
        pair.step()


def _stale(pair: Scene) -> None:
    pair.is_deaf = True
    if pair.state not in {"STALE", "OFFLINE"}:
        _steps_until(pair, lambda: pair.state == "STALE")


def _fsm(value: int) -> Event:
    """A value of the FSM, held. In STALE it is all that arrives."""

    def event(pair: Scene) -> None:
        pair.robot.inject({"fault": "fsm_value", "value": value}, pair.now_ns)
        if pair.state == "STALE":
            pair.is_deaf, pair.topics = False, (FSM_STATE,)
        _steps_until(pair, lambda: pair.heard[FSM_STATE].value == value)
        heard = pair.heard[FSM_STATE]
        _steps_until(pair, lambda: pair.heard[FSM_STATE] is not heard or heard.received_ns == pair.now_ns)

    return event


def _mode(fault: dict[str, object] | None, **changes: object) -> Event:
    """What `/api/current_mode` says changes, and the sample that says so arrives now."""

    def event(pair: Scene) -> None:
        for name in ("left", "right") if fault is None else ("",):
            pair.robot.inject(fault or {"fault": "arm_disabled", "side": name}, pair.now_ns)
        pair.tell_mode(**changes)
        pair.step()

    return event


def _dead(topic: str, seconds: float) -> Event:
    """A topic falls silent; judged from the tick in which it is too old. ENABLING is kept from ending meanwhile."""

    def event(pair: Scene) -> None:
        pair.topics = tuple(t for t in pair.topics if t != topic)
        if pair.state == "ENABLING":
            pair.robot.inject({"fault": "fsm_value", "value": 1}, pair.now_ns)
        _steps_until(pair, lambda: pair.now_ns - pair.heard[topic].received_ns > seconds * S)
        if pair.state != "ENABLING":
            pair.robot.clear("fsm_value")

    return event


def _tracking(pair: Scene) -> None:
    """An arm is held, and in motion left behind; at rest it is pushed away in steps that the store believes."""
    pair.robot.inject({"fault": "blocked", "side": "left"}, pair.now_ns)
    if pair.state == "ACTIVE":
        _steps_until(pair, lambda: pair.state != "ACTIVE")
        return
    for _ in range(5):
        pair.robot.arms[Side.LEFT].q_rad = pair.robot.arms[Side.LEFT].q_rad + 0.08
        pair.run(0.05)


def _joint_order(pair: Scene) -> None:
    pair.robot.inject({"fault": "wrong_names", "topic": arm_state(Side.LEFT), "duration_s": 0.2}, pair.now_ns)
    pair.is_deaf, pair.topics = False, LEAN if pair.state != "STALE" else (arm_state(Side.LEFT),)
    _steps_until(pair, lambda: Code.JOINT_ORDER in pair.engine.latches)


def _lost_with_pause(pair: Scene) -> None:
    pair.granted(Acquire(name="ann", pid=42, on_loss=OnLoss.PAUSE), "ann")
    pair.mark()
    _lost(pair)


def _lost(pair: Scene) -> None:
    pair.kill("ann")
    pair.step()


def _down(pair: Scene) -> None:
    if pair.is_up:
        pair.down()
    pair.step()


def _tell(event: object) -> Event:
    def tell(pair: Scene) -> None:
        pair.receive(event)
        pair.step()

    return tell


WRITER = Writer(topic=FSM_ENABLE, zid="b", means=Means.TOKEN)


def _sent(pair: Scene) -> None:
    pair.receive(ForeignData(topic=FSM_ENABLE, zid="b", at_ns=pair.now_ns))
    pair.step()


EVENTS: dict[str, Event] = {
    "take": _ask(lambda _: Take(name="bob", pid=7, reason="test"), "bob"),
    "release": _ask(lambda p: Release(epoch=p.epoch)),
    "disable": _ask(lambda p: Disable(epoch=p.epoch)),
    "enable": _ask(lambda p: Enable(epoch=p.epoch)),
    "arm motion": _ask(lambda p: Move(epoch=p.epoch, targets_rad=HOME)),
    "owner's stop": _ask(lambda _: Stop()),
    "other's stop": _ask(lambda _: Stop(), "bob"),
    "estop": _ask(lambda _: Estop(), "bob"),
    "recover": _ask(lambda _: Recover(), "bob"),
    "client lost": _lost,
    "lost, pause": _lost_with_pause,
    "stale": _stale,
    "transport lost": _down,
    "FSM READY": _fsm(2),
    "FSM 0": _fsm(0),
    "FSM 1": _fsm(1),
    "FSM ERROR": _fsm(-1),
    "FSM 3": _fsm(3),
    "FSM 9": _fsm(9),
    "fsm dead": _dead(FSM_STATE, 0.5),
    "VR mode": _mode({"fault": "vr_mode"}, api=False),
    "mode unknown": _dead(CURRENT_MODE, 3.0),
    "arm disabled": _mode({"fault": "arm_disabled", "side": "left"}, arm_enabled={Side.LEFT: False, Side.RIGHT: True}),
    "no arm": _mode(None, arm_enabled={Side.LEFT: False, Side.RIGHT: False}),
    "part dead": _dead(arm_state(Side.LEFT), 0.1),
    "tracking error": _tracking,
    "SIGTERM": _tell(ExitRequested(at_ns=0)),
    "suspend": _tell(Suspended(slept_ns=S, at_ns=0)),
    "joint order": _joint_order,
    "foreign token": _tell(ForeignTokens(writers=(WRITER,), at_ns=0)),
    "foreign data": _sent,
    "other gateway": _tell(GatewayTokens(gateways=(Gateway(zid="b", is_armed=True),), at_ns=0)),
}
"""What happens, and from when on it is judged: the tick in which the gateway can know of it."""


# ------------------------------------------------------------------------------------------------------- the words


def _drives(pair: Scene) -> None:
    assert [f.values for f in pair.first_tick() if f.topic == CHASSIS_VELOCITY] == [(0.0, 0.0, 0.0)]


def _zero_at_once(pair: Scene) -> None:
    assert [f.values for f in pair.first_tick() if f.topic == FSM_ENABLE] == [(0.0,)]


def _nothing(pair: Scene) -> None:
    pair.run(0.3)
    assert pair.arm_frames() == [] and pair.beats == [], f"{pair.arm_kinds()}, {pair.beats}"


def _silent(pair: Scene) -> None:
    pair.run(0.3)
    assert pair.arm_frames() == [] and 1.0 not in pair.beats and pair.state in {"IDLE", "READ_ONLY", "STALE"}


def _falls_silent(pair: Scene) -> None:
    pair.run(0.75)
    assert pair.arm_frames() == [] and pair.beats == []


def _keeps(pair: Scene) -> None:
    """Constant hold frames, for at most 0.8 s."""
    pair.run(1.5)
    for side in Side:
        frames = pair.arm_frames(side)
        assert {f.kind for _, f in frames} == {FrameKind.HOLD} and len({f.values for _, f in frames}) == 1
        assert 790 * MS <= frames[-1][0] - frames[0][0] <= 800 * MS
    assert 1.0 not in pair.beats


def _last_word(pair: Scene) -> None:
    """0.0 for 0.3 s, once it may resume no more."""
    pair.run(0.6)
    after_ns = [at_ns - pair.mark_ns for at_ns in pair.beats_at_ns]
    assert set(pair.beats) == {0.0} and 780 * MS <= after_ns[0] and 250 * MS <= after_ns[-1] - after_ns[0] <= 300 * MS


def _goes_on(pair: Scene) -> None:
    if pair.was == "ENABLING":
        pair.run(0.2)
        assert pair.state in {"ENABLING", "ACTIVE", "HOLDING"} and set(pair.beats) == {1.0} and pair.streaming
        return
    pair.stays()


def _moves(pair: Scene) -> None:
    pair.run(0.05)
    assert pair.state == "ACTIVE" and FrameKind.MOTION in pair.arm_kinds()


def _left_silent(pair: Scene) -> None:
    pair.run(0.05)
    assert pair.arm_frames(Side.LEFT) == [] and (pair.was in {"READ_ONLY", "IDLE"} or pair.arm_frames(Side.RIGHT))


def _exits(pair: Scene) -> None:
    from_ns = pair.mark_ns
    pair.run_until(lambda: pair.done, 5.0)
    assert pair.now_ns - from_ns < 5 * S and 1.0 not in pair.beats[-1:]


def _gives_up(pair: Scene) -> None:
    """0.0 for 2 s that nobody hears, then the base, and a word about it."""
    pair.run_until(lambda: pair.state == "IDLE", 3.5)
    pair.run(0.1)
    zeros_at = [at for at, value in zip(pair.beats_at_ns, pair.beats, strict=True) if value == 0.0]
    assert 1950 * MS <= zeros_at[-1] - zeros_at[0] <= 2000 * MS and len(pair.told(Code.STOP_NOT_EFFECTIVE)) == 1


def _at_base(pair: Scene) -> None:
    assert pair.state in {"IDLE", "READ_ONLY"}


def _zero_once(pair: Scene) -> None:
    pair.run(0.4)
    assert pair.arm_frames() == [] and pair.beats == [0.0]


def _free(pair: Scene) -> None:
    assert pair.owner is None


WORDS: dict[str, Callable[[Scene], None]] = {
    "=": _goes_on,
    "nothing": _nothing,
    "silent": _silent,
    "falls silent": _falls_silent,
    "keeps": _keeps,
    "last word": _last_word,
    "0.0": _zero_at_once,
    "ground": _drives,
    "free": _free,
    "moves": _moves,
    "left silent": _left_silent,
    "exit": _exits,
    "down": Scene.goes_down,
    "off": Scene.goes_off,
    "hold": Scene.brakes_and_holds,
    "gives way": Scene.brakes_and_gives_way,
    "pauses": Scene.pauses,
    "stops": Scene.stops_first,
    "gives up": _gives_up,
    "base": _at_base,
    "0.0 once": _zero_once,
    "stops first": Scene.stops_first,
}
LATCHED = {
    "other's stop": Code.STOPPED_BY_OTHER,
    "estop": Code.ESTOP,
    "FSM ERROR": Code.FSM_ERROR,
    "tracking error": Code.TRACKING_ERROR,
    "joint order": Code.JOINT_ORDER,
    "foreign token": Code.FOREIGN_WRITER,
    "foreign data": Code.FOREIGN_WRITER,
}


def cells() -> list[tuple[str, str, list[str]]]:
    """Return (row, state, words) of every cell that can occur."""
    found = []
    for line in TABLE.strip().splitlines()[1:]:
        row, *columns = (part.strip() for part in line.split("|"))
        for state, text in zip(COLUMNS, columns, strict=True):
            if text != "-":
                found.append((row, state, [word.strip() for word in text.split(",")]))
    return found


CELLS = cells()


def _build(row: str, state: str) -> Scene:
    """Return the scene of a cell. What lasts too short for a slow event is prepared for it."""
    pair = Scene()
    if row == "mode unknown" and state in {"ENABLING", "ACTIVE", "STOPPING"}:
        pair.before_last = lambda: _age_mode(pair, 2.9 if state == "ENABLING" else 2.45)
    return scene(state, pair)


def _age_mode(pair: Scene, seconds: float) -> None:
    pair.topics = tuple(topic for topic in pair.topics if topic != CURRENT_MODE)
    pair.run_until(lambda: pair.now_ns - pair.heard[CURRENT_MODE].received_ns > seconds * S)


@pytest.mark.parametrize(("row", "state", "words"), CELLS, ids=[f"{row}-{state}" for row, state, _ in CELLS])
def test_cell(row: str, state: str, words: list[str]) -> None:
    """BEHAVIOUR, Transitions, cell by cell."""
    pair = _build(row, state)
    reply = EVENTS[row](pair)
    if row == "take":
        assert pair.owner == "bob"
    elif "free" not in words and state != "READ_ONLY":
        assert pair.owner == "ann"
    for word in words:
        if word == "ok":
            assert reply.refusal is None
        elif word == "L":
            assert set(pair.engine.latches) == {LATCHED[row]}
        elif word in WORDS:
            WORDS[word](pair)
        elif word == "stops to IDLE":
            pair.stops_first()
            assert pair.state == "IDLE"
        elif word in COLUMNS:
            assert pair.state == word
        else:
            assert reply.refusal is not None and reply.refusal.code is Code(word.removesuffix("!"))
            assert reply.refusal.message
            _nothing_changes(pair)


def _nothing_changes(pair: Scene) -> None:
    assert pair.state == pair.was and not pair.moved()


def test_every_event_is_judged_in_every_state_or_said_to_be_impossible() -> None:
    """The table has a row for every event here and a cell for every state."""
    assert {row for row, _, _ in CELLS} == set(EVENTS)
    assert {state for _, state, _ in CELLS} == set(COLUMNS)
