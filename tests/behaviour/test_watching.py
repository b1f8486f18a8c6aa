"""Stop endpoints: while one is registered and not heard, nothing moves, whoever owns the robot."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.core.messages.events import ClientGone, EndpointHeard
from gateway.core.messages.outputs import FrameKind
from gateway.errors import Code
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import (
    DriveChassis,
    Enable,
    LeaveEndpoint,
    Move,
    OpenStream,
    Recover,
    RegisterEndpoint,
    SetGripper,
)
from gateway.robot.topics import CHASSIS_VELOCITY
from gateway.values import Side
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import MS, S
from tests.thoroughness import traces

PERIOD_NS = 300 * MS


def watch(pair: Scene, client: str = "bob", on_silence: OnLoss = OnLoss.HOLD, period_ns: int = PERIOD_NS) -> int:
    """A client watches over the robot; return when it was last heard [ns]."""
    pair.granted(RegisterEndpoint(name=client, timeout_ns=period_ns, on_silence=on_silence), client)
    return pair.now_ns


def hear(pair: Scene, client: str = "bob") -> None:
    """It checks in."""
    pair.receive(EndpointHeard(client_id=client, at_ns=pair.now_ns))


def watched(state: str = "ACTIVE", **options: object) -> tuple[Scene, int]:
    """A scene over which bob watches, last heard now."""
    pair = scene(state)
    heard_ns = watch(pair, **options)  # type: ignore[arg-type]  # as `watch` takes them
    pair.mark()
    return pair, heard_ns


def test_silence_ends_anybodys_motion_within_the_period() -> None:
    """Ann moves, bob watches: his check-ins let her move on, her arms brake a tick after his period is over."""
    pair, _ = watched()
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME, speed=0.1), "ann")
    for _ in range(5):
        hear(pair)
        pair.run(0.25)
    assert pair.state == "ACTIVE" and pair.moved()
    hear(pair)
    last_ns = pair.now_ns
    pair.run_until(lambda: pair.state == "HOLDING", 0.5)
    assert PERIOD_NS <= pair.now_ns - last_ns <= PERIOD_NS + 20 * MS
    assert "'bob' was not heard for 0.31 s (0.3 s is its bound)" in pair.told(Code.MOTION_ENDED)[-1]
    assert pair.told(Code.ENDPOINT_SILENT)
    for refused in (Move(epoch=pair.epoch, targets_rad=HOME), OpenStream(epoch=pair.epoch, side=Side.LEFT)):
        assert pair.refused(refused, "ann").code is Code.ENDPOINT_SILENT
    pair.run(0.5)
    assert pair.engine.owner_id == "ann" and pair.arm_kinds() and pair.state == "HOLDING"


@pytest.mark.parametrize(
    ("state", "held", "paused"),
    [
        ("READ_ONLY", "READ_ONLY", "READ_ONLY"),
        ("IDLE", "IDLE", "IDLE"),
        ("ENABLING", "IDLE", "IDLE"),
        ("at rest", "HOLDING", "IDLE"),
        ("ACTIVE", "HOLDING", "IDLE"),
        ("HOLDING", "HOLDING", "IDLE"),
        ("PAUSED", "PAUSED", "PAUSED"),
        ("OFFLINE", "OFFLINE", "OFFLINE"),
    ],
)
def test_what_an_endpoint_does_in_each_state(state: str, held: str, paused: str) -> None:
    """Its connection ends: held or paused, as it chose; a robot that only rests goes on resting, its lease stays."""
    for on_silence, then in ((OnLoss.HOLD, held), (OnLoss.PAUSE, paused)):
        pair, _ = watched(state, on_silence=on_silence)
        owner = pair.owner
        pair.receive(ClientGone(client_id="bob", at_ns=pair.now_ns))
        pair.step()
        assert pair.state == then and pair.owner == owner
        if state == "ACTIVE" and then == "IDLE":
            pair.goes_down()


def test_an_endpoint_whose_connection_ends_is_silent_at_once() -> None:
    """A process that was killed is not waited for."""
    pair, _ = watched(period_ns=10 * S)
    pair.receive(ClientGone(client_id="bob", at_ns=pair.now_ns))
    pair.step()
    assert pair.state == "HOLDING" and pair.arm_kinds() == {FrameKind.BRAKE}


def test_each_endpoint_is_judged_by_itself() -> None:
    """One that is heard does not speak for another."""
    pair, _ = watched(period_ns=5 * S)
    watch(pair, "eve")
    for _ in range(4):
        hear(pair)
        pair.run(0.1)
    assert pair.state == "HOLDING" and "'eve'" in pair.told(Code.ENDPOINT_SILENT)[-1]


def test_chassis_and_grippers_stand_still_too() -> None:
    """Also while the arms are only held."""
    pair, _ = watched("HOLDING")
    drive = DriveChassis(epoch=pair.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0, expiry_ns=900 * MS)
    pair.granted(drive, "ann")
    pair.run(0.2)
    assert pair.values(CHASSIS_VELOCITY)[-1][0] > 0
    pair.run(0.3)
    assert pair.values(CHASSIS_VELOCITY)[-1][0] == 0
    assert pair.refused(drive, "ann").code is Code.ENDPOINT_SILENT
    assert pair.refused(SetGripper(epoch=pair.epoch, side=Side.LEFT, raw=0.5), "ann").code is Code.ENDPOINT_SILENT


def test_a_late_tick_is_no_silence_of_an_endpoint() -> None:
    """Its check-ins of 140 ms may wait to be read; afterwards it is heard, and was never told to be silent."""
    pair, _ = watched(period_ns=100 * MS)
    pair.run(0.05)
    pair.late_ns = 140 * MS
    pair.step(pair.now_ns + 140 * MS)
    hear(pair)
    pair.run(0.05)
    assert pair.state == "ACTIVE" and not pair.told(Code.ENDPOINT_SILENT)


@settings(max_examples=traces(30), suppress_health_check=list(HealthCheck), deadline=None)
@given(st.lists(st.sampled_from([0, 0, 10, 19, 30, 49, 60, 100, 140, 145, 200]), min_size=1, max_size=40))
def test_no_schedule_of_late_ticks_lets_motion_outlive_an_endpoint(late_ms: list[int]) -> None:
    """Motion ends 250 ms after its period at the latest: what one pause explains is bounded."""
    pair = scene("at rest")
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME, speed=0.05), "ann")
    pair.run(0.1)
    last_ns = watch(pair)
    pair.mark()
    for late in [*late_ms, *[49] * 30]:
        pair.late_ns = late * MS
        pair.step((pair.now_ns // (10 * MS) + 1) * 10 * MS + late * MS)
    moved = [at_ns for at_ns, frame in pair.arm_frames() if frame.kind is FrameKind.MOTION]
    assert max(moved, default=0) <= last_ns + PERIOD_NS + 250 * MS and pair.state != "ACTIVE"


def test_nothing_resumes_by_itself_when_an_endpoint_is_heard_again() -> None:
    """The robot stays held until its owner commands again."""
    pair, _ = watched()
    pair.run(0.5)
    hear(pair)
    pair.run(0.2)
    at_ns = pair.now_ns
    assert pair.state == "HOLDING" and "heard again" in pair.told(Code.ENDPOINT_CHANGED)[-1]
    assert FrameKind.MOTION not in pair.kinds_since(at_ns - 100 * MS)
    hear(pair)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.state == "ACTIVE"


def test_what_goes_on_goes_on_when_an_endpoint_leaves_in_order() -> None:
    """And its end of connection does not matter any more."""
    pair, _ = watched()
    pair.granted(LeaveEndpoint(), "bob")
    pair.receive(ClientGone(client_id="bob", at_ns=pair.now_ns))
    pair.run(0.5)
    assert pair.state == "ACTIVE" and "left in order" in pair.told(Code.ENDPOINT_CHANGED)[-1]


def test_recover_lets_silent_endpoints_go_and_needs_a_reason() -> None:
    """Anybody may; who is heard stays."""
    pair, _ = watched("at rest")
    watch(pair, "eve", period_ns=10 * S)
    pair.run(0.5)
    assert pair.refused(Recover(), "carol").code is Code.ENDPOINT_SILENT
    facts = pair.granted(Recover(reason="his tablet is broken"), "carol")
    assert facts == {"cleared": [], "dismissed": ["bob"]}
    assert "his tablet is broken" in pair.told(Code.ENDPOINT_CHANGED)[-1]
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    assert pair.refused(LeaveEndpoint(), "bob").code is Code.ENDPOINT_UNKNOWN


def test_where_one_is_demanded_nothing_moves_without() -> None:
    """Enabling and driving are refused until one is there, and the last one that leaves ends what moves."""
    pair = scene("IDLE", Scene(demands_endpoint=True))
    drive = DriveChassis(epoch=pair.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0)
    for asked in (Enable(epoch=pair.epoch), drive):
        refusal = pair.refused(asked, "ann")
        assert refusal.code is Code.ENDPOINT_MISSING and "demand_stop_endpoint" in refusal.message
    watch(pair, period_ns=10 * S)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE", 5.0)
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.granted(LeaveEndpoint(), "bob")
    assert pair.state == "HOLDING" and "demand_stop_endpoint" in pair.told(Code.MOTION_ENDED)[-1]


def test_where_one_is_demanded_recover_walks_nothing_without() -> None:
    """A held reference that lost its arm stays where it is until somebody watches again."""
    pair = scene("IDLE", Scene(demands_endpoint=True))
    watch(pair, period_ns=10 * S)
    pair.granted(Enable(epoch=pair.epoch), "ann")
    pair.run_until(lambda: pair.state == "ACTIVE", 5.0)
    pair.granted(LeaveEndpoint(), "bob")
    pair.push(Side.LEFT, 0.5)
    pair.mark()
    pair.granted(Recover(), "ann")
    pair.run(0.5)
    assert pair.state == "HOLDING" and not pair.moved() and not pair.told(Code.WALK)
    watch(pair, period_ns=10 * S)
    pair.granted(Recover(), "ann")
    pair.run(0.1)
    assert pair.moved() and pair.told(Code.WALK)


def test_the_next_daemon_waits_for_a_person_who_says_why() -> None:
    """It knows nobody who was registered: a latch says so, until `recover` with a reason. Who left is forgotten."""
    for leaves in (False, True):
        pair, _ = watched("READ_ONLY")
        assert pair.engine.latches == {}
        if leaves:
            pair.granted(LeaveEndpoint(), "bob")
        pair.restart()
        pair.up()
        pair.run_until(lambda pair=pair: pair.state == "READ_ONLY", 5.0)
        pair.run(1.0)
        epoch = pair.own("ann")
        if not leaves:
            assert pair.refused(Enable(epoch=epoch), "ann").code is Code.LATCHED
            assert pair.refused(Recover(), "ann").code is Code.ENDPOINT_SILENT
            pair.granted(Recover(reason="bob went home"), "ann")
        pair.granted(Enable(epoch=epoch), "ann")
