"""Tests of structs to core values and back."""

from __future__ import annotations

from types import MappingProxyType

import pytest

import gateway
from gateway.api import protocol
from gateway.api.translate import config_hash, describe, to_notice, to_refusal, to_reply, to_request, to_target
from gateway.core.messages import events, outputs
from gateway.errors import Code, Refusal
from gateway.messages import incoming, requests
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.settings.settings import ArmSettings, ChassisSettings, LiftSettings, Settings
from gateway.values import Side
from tests.api import samples
from tests.api.samples import REQUESTS, Q


@pytest.mark.parametrize("request_", REQUESTS, ids=lambda request: type(request).__name__)
def test_a_request_arrives_as_it_was_sent(request_):
    """The engine gets the very values of the client, and beside a chunk the motion through its points."""
    sent = samples.command(request_)
    for encoding in (protocol.MSGPACK, protocol.JSON):
        taken, chunk = to_request(protocol.decode_command(protocol.encode(sent, encoding), encoding).request)
        assert taken == request_
        assert isinstance(getattr(taken, "on_loss", incoming.OnLoss.HOLD), incoming.OnLoss)
        assert isinstance(getattr(taken, "on_limit", incoming.OnLimit.CLIP), incoming.OnLimit)
        assert (chunk is not None) is isinstance(taken, (requests.Follow, requests.CheckFollow))


@pytest.mark.parametrize(
    ("request_", "field", "value"),
    [
        (protocol.Follow(epoch=1, points={}, dt_s=0.1), "points", "0"),
        (protocol.Follow(epoch=1, points={"left": (Q,)}, dt_s=0.1), "left_arm", "1"),
        (protocol.Follow(epoch=1, points={"left": (Q, Q[:6])}, dt_s=0.1), "left_arm[1]", "6"),
    ],
)
def test_points_that_no_motion_leads_through_are_refused_with_arm_and_number(request_, field, value):
    """They are worked out before the engine is asked: WRONG_SHAPE, with what was given."""
    refusal = to_request(request_)
    assert isinstance(refusal, Refusal) and refusal.code is Code.WRONG_SHAPE
    assert (refusal.field, refusal.value) == (field, value)


def test_text_of_clients_is_made_fit_to_be_shown():
    """Control characters would act on a terminal: they are replaced; long reasons are cut, and still stop."""
    taken, _ = to_request(protocol.Take(name="a\x1b[31mb", pid=1, reason="x\ny\u202e"))
    assert taken.name == "a?[31mb" and taken.reason == "x?y?"
    follow = protocol.Follow(epoch=1, points={"left": (Q, Q)}, dt_s=0.1, frames={"left": "a\x07"})
    check, _ = to_request(protocol.CheckFollow(follow=follow))
    assert check.follow.frames == {"left": "a?"}
    stop, _ = to_request(protocol.Stop(reason="é" * 10_000))
    assert isinstance(stop, requests.Stop) and stop.reason == "é" * 256


def test_a_target_is_passed_on_unjudged():
    """Length and finiteness of a target are the core's to judge."""
    target = protocol.Target(epoch=1, seq=2, values=(float("inf"),))
    arrived = to_target(target, "me", 5, 99)
    assert arrived == events.TargetArrived(
        client_id="me", stream_id=5, epoch=1, seq=2, values=(float("inf"),), received_ns=99
    )


def test_a_reply_carries_plain_facts():
    """Facts of any mapping and sequence type become what both encodings know."""
    reply = outputs.Reply(
        client_id="me",
        request_id=4,
        facts={"q_rad": MappingProxyType({Side.LEFT: (1.0, 2.0)}), "clipped": (3,), "code": Code.CANCELLED, "epoch": 1},
    )
    sent = to_reply(reply, after_seq=8)
    for encoding in (protocol.MSGPACK, protocol.JSON):
        back = protocol.decode_reply(protocol.encode(sent, encoding), encoding)
        assert back.facts == {"q_rad": {"left": [1.0, 2.0]}, "clipped": [3], "code": "CANCELLED", "epoch": 1}
        assert back.after_seq == 8 and back.refusal is None and back.request_id == 4


def test_refusals_and_notices_become_plain():
    """Codes and levels become their text, facts a plain map."""
    refusal = Refusal(code=Code.LEASE_HELD, message="m", hint="h")
    assert protocol.refusal_of(to_refusal(refusal)) == refusal
    assert to_reply(outputs.Reply(client_id="a", request_id=1, refusal=refusal), 0).refusal == to_refusal(refusal)
    notice = outputs.Notice(code=Code.WALK, level=outputs.Level.WARNING, message="m", at_ns=3, facts={"a": "b"})
    assert to_notice(notice) == protocol.Notice(code="WALK", level="warning", message="m", at_ns=3, facts={"a": "b"})


def test_the_daemon_describes_what_it_really_runs_with():
    """Facts are those of the settings, not of the defaults."""
    tight = tuple(value * 0.9 for value in JOINT_UPPER_RAD[Side.LEFT])
    lower = {Side.LEFT: (-1.0, 0.0, -2.0, 0.3, -1.0, -1.0, -0.5)}
    arm = ArmSettings(
        v_radps=0.5,
        upper_rad={Side.LEFT: tight, Side.RIGHT: JOINT_UPPER_RAD[Side.RIGHT]},
        lower_rad=lower | {Side.RIGHT: JOINT_LOWER_RAD[Side.RIGHT]},
    )
    ground = {"chassis": ChassisSettings(v_mps=0.2, expiry_ns=10**9), "lift": LiftSettings(v_max=0.5)}
    info = describe(Settings(arm=arm, **ground), socket="/s", pid=7)
    assert (info.chassis_v_mps, info.chassis_w_radps, info.chassis_expiry_ns) == (0.2, 0.5, 10**9)
    assert (info.lift_v_max, info.lift_expiry_ns) == (0.5, 300_000_000)
    assert info.v_radps == 0.5 and info.upper_rad["left"] == tight and info.lower_rad["left"][3] == 0.3
    assert info.joint_names["right"][0] == "r_joint1" and info.pid == 7 and info.socket == "/s"
    assert info.version == gateway.__version__ and info.protocol == protocol.PROTOCOL_VERSION
    assert protocol.decode_info(protocol.encode(info, protocol.JSON), protocol.JSON) == info


def test_the_hash_of_the_settings_changes_with_any_of_them():
    """Two daemons with the same hash run with the same settings."""
    assert config_hash(Settings()) == config_hash(Settings())
    assert config_hash(Settings()) != config_hash(Settings(arm=ArmSettings(v_radps=0.99)))
