"""The engine's vocabulary: plain frozen values, complete, and safe to keep for a replay."""

from __future__ import annotations

import copy
import inspect
import pickle
from enum import Enum
from typing import get_args

import pytest

from gateway.core.messages import events, outputs, sightings
from gateway.core.messages.held import Held
from gateway.errors import Code
from gateway.messages import incoming, requests
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import ArmState, Side

ARM = ArmState(q_rad=(0.0,) * 7, dq_radps=(), tau_nm=(), stamp_ns=5)
SAMPLES = (
    events.SampleArrived(topic="/left_arm/joint_states", value=ARM, received_ns=1),
    events.SampleRefused(topic="/fsm_state", code=Code.SAMPLE_REFUSED, message="short", received_ns=1),
    events.LinkUp(router_zid="a1", at_ns=1),
    events.LinkDown(at_ns=1),
    events.RouteObserved(topic="/fsm_state", code=Code.ROUTE_DEAD, message="no reader", at_ns=1),
    events.RobotsAnnounced(elsewhere=("bot1",), at_ns=1),
    sightings.ForeignTokens(writers=(), at_ns=1),
    sightings.ForeignData(topic="/api/fsm/enable", zid="", at_ns=1),
    sightings.GatewayTokens(gateways=(), at_ns=1),
    sightings.ClaimShown(claim=1, at_ns=1),
    sightings.Befriended(zid="a1", at_ns=1),
    events.CommandRequested(client_id="c", request_id=1, request=requests.Stop(), received_ns=1),
    events.TargetArrived(client_id="c", stream_id=1, epoch=1, seq=1, values=(0.0,) * 7, received_ns=1),
    events.ClientSeen(client_id="c", at_ns=1),
    events.EndpointHeard(client_id="c", at_ns=1),
    events.ClientGone(client_id="c", at_ns=1),
    events.Suspended(slept_ns=1, at_ns=1),
    events.TakenOver(held=Held(at_ns=1, state="ACTIVE"), at_ns=1),
    events.HeldElsewhere(is_held=True, at_ns=1),
    events.GuardSeen(pid=1, zid="c4", is_linked=True, at_ns=1),
    events.PartEnded(message="m", at_ns=1),
    events.SettingsRead(values={"arm.v_radps": 0.5}, message="m", at_ns=1),
    events.ExitRequested(at_ns=1),
)
"""One of each that the inbox can hold."""
REQUESTS = (
    requests.Acquire(name="n", pid=1),
    requests.Take(name="n", pid=1, reason="r"),
    requests.Release(epoch=1),
    requests.Abandon(epoch=1),
    requests.Enable(epoch=1),
    requests.Disable(epoch=1),
    requests.Move(epoch=1, targets_rad={Side.LEFT: (0.0,) * 7}),
    requests.Follow(epoch=1, points={Side.LEFT: (HOME_Q_RAD[Side.LEFT],) * 2}, dt_s=0.1),
    requests.CheckFollow(
        follow=requests.Follow(epoch=1, points={Side.LEFT: (HOME_Q_RAD[Side.LEFT],) * 2}, dt_s=0.1),
        from_here=False,
    ),
    requests.MovePose(epoch=1, targets={Side.LEFT: (0.0,) * 7}, frames={}),
    requests.OpenStream(epoch=1, side=Side.LEFT, until=incoming.Until(force_n=8.0)),
    requests.CloseStream(epoch=1, stream_id=1),
    requests.Hold(epoch=1, sides=(Side.LEFT,)),
    requests.Cancel(epoch=1, motion_id=1),
    requests.SetGripper(epoch=1, side=Side.LEFT, raw=0.5),
    requests.SetPayload(epoch=1, side=Side.LEFT, mass_kg=0.3),
    requests.Weigh(epoch=1, side=Side.LEFT, q_rad=(), up_nm=(), down_nm=(), noise_nm=()),
    requests.DriveChassis(epoch=1, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0),
    requests.StopChassis(epoch=1),
    requests.DriveLift(epoch=1, velocity=0.1),
    requests.StopLift(epoch=1),
    requests.DisableLift(epoch=1),
    requests.Stop(),
    requests.Estop(),
    requests.Recover(),
    requests.RegisterEndpoint(name="n", timeout_ns=1),
    requests.LeaveEndpoint(),
)
"""One of each that a client can ask."""


def test_the_unions_are_the_samples_of_this_file():
    """A new event or request must be added here, and so to every rule below."""
    assert set(get_args(events.Event)) == {type(event) for event in SAMPLES}
    assert set(get_args(requests.Request)) == {type(request) for request in REQUESTS}


def test_everything_defined_is_exported_and_nothing_else():
    """`from gateway.core.messages.events import X` works for each class of the vocabulary, wherever it is defined."""
    assert sorted(events.__all__) == events.__all__
    assert all(hasattr(events, name) for name in events.__all__)
    own = {
        name for name, thing in vars(events).items() if inspect.isclass(thing) and thing.__module__ == events.__name__
    }
    assert own <= set(events.__all__)


@pytest.mark.parametrize("value", [*SAMPLES, *REQUESTS], ids=lambda value: type(value).__name__)
def test_an_event_cannot_be_changed_and_survives_the_inbox_log(value):
    """Frozen, slotted, built by keyword; a copy through the log is equal to it."""
    names = list(type(value).__annotations__)
    if names:
        with pytest.raises(AttributeError):
            setattr(value, names[0], getattr(value, names[0]))
        with pytest.raises(TypeError):
            type(value)(*(getattr(value, name) for name in names))
    assert not hasattr(value, "__dict__")
    assert pickle.loads(pickle.dumps(value)) == value
    assert copy.deepcopy(value) == value


@pytest.mark.parametrize("event", SAMPLES, ids=lambda event: type(event).__name__)
def test_every_event_says_when_it_happened(event):
    """Ages come from arrival: one integer instant of the monotonic clock, `received_ns` or `at_ns`."""
    instants = [name for name in type(event).__annotations__ if name in ("received_ns", "at_ns")]
    assert len(instants) == 1 and isinstance(getattr(event, instants[0]), int)


@pytest.mark.parametrize("request_", [r for r in REQUESTS if not hasattr(r, "epoch")], ids=lambda r: type(r).__name__)
def test_only_what_moves_nothing_and_stops_need_no_epoch(request_):
    """Everything else is the owner's (DESIGN §5); stop, estop, recover and a mere check are anybody's."""
    assert isinstance(
        request_,
        (
            requests.Acquire,
            requests.Take,
            requests.Stop,
            requests.Estop,
            requests.Recover,
            requests.CheckFollow,
            requests.RegisterEndpoint,
            requests.LeaveEndpoint,
        ),
    )


def test_defaults_are_the_cautious_ones():
    """Hold on loss, reject at limits, absolute targets, one sample, nothing remembered."""
    assert requests.Acquire(name="n", pid=1).on_loss is incoming.OnLoss.HOLD
    assert requests.Take(name="n", pid=1, reason="r").on_loss is incoming.OnLoss.HOLD
    move = requests.Move(epoch=1, targets_rad={})
    assert (move.relative, move.speed, move.tolerance_rad, move.on_limit) == (False, 1.0, None, incoming.OnLimit.REJECT)
    assert requests.OpenStream(epoch=1, side=Side.LEFT).on_limit is incoming.OnLimit.REJECT
    sample = SAMPLES[0]
    assert (sample.stamp_ns, sample.count, sample.duplicates, sample.worst_gap_ns) == (None, 1, 0, 0)
    assert outputs.Remembered() == outputs.Remembered(epoch=0, latches={})
    assert outputs.Reply(client_id="c", request_id=1).refusal is None


@pytest.mark.parametrize("kind", [incoming.OnLoss, incoming.OnLimit, outputs.FrameKind, outputs.Level])
def test_enumerations_travel_as_their_lower_case_names(kind: type[Enum]):
    """Wire, log and state file show the same words; they never change."""
    assert [member.value for member in kind] == [member.name.lower() for member in kind]
    assert all(isinstance(member, str) for member in kind)


def test_the_gates_kinds_of_frames_are_seven():
    """The gate's table of permissions is written for exactly these."""
    assert [kind.name for kind in outputs.FrameKind] == ["MOTION", "ECHO", "BRAKE", "HOLD", "WALK", "BEAT", "STOP"]
