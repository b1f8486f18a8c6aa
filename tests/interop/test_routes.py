"""Routes of the real bridge that die, get lost or multiply, each made to happen, and what our tokens prevent (wire.md 3.1)."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from tests.interop.bridge_process import demand

demand(module=True)

from cdr_types.keys import topic_to_key
from gateway.errors import Code
from gateway.sim.robot.manual import FSM_ENABLE, STATE_TOPICS, Side, arm_state_topic
from tests.e2e.system import wait_for
from tests.interop.apart import LEASE_S, Apart, Host

pytestmark = [pytest.mark.e2e, pytest.mark.interop]

LEFT = arm_state_topic(Side.LEFT)
RIGHT = arm_state_topic(Side.RIGHT)
FAST = [topic for topic, (_, rate_hz) in STATE_TOPICS.items() if rate_hz >= 20]
DISCOVERY_S = 3.5
"""A node that comes is found by the bridge within a tenth of a second, at times only after three seconds (wire.md 4.1)."""


LONG_LEASE_S = 8.0
"""Longer than a node of ours needs to start on a busy machine."""


@pytest.fixture
def apart(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Apart]:
    """A robot in pieces."""
    made = Apart(tmp_path, getattr(request, "param", LEASE_S))
    yield made
    made.close()


def listener_ends(host: Host) -> None:
    """Somebody's `ros2 topic echo` is over."""
    host.node.close()


def host_is_off(host: Host) -> None:
    """The host's bridge is killed."""
    host.kill()


WAYS = pytest.mark.parametrize("goes", [listener_ends, host_is_off])


def elapsed_since(begin_s: float, seconds: float) -> Callable[[], bool]:
    """Return whether so much time is over."""
    return lambda: time.monotonic() - begin_s > seconds


@WAYS
def test_somebody_elses_subscriber_that_goes_ends_nothing_of_ours(apart: Apart, goes: Callable[[Host], None]) -> None:
    """With our token in the route's list it is never empty: no silence, nothing observed, on no topic."""
    ears = apart.ears(has_tokens=True)
    host = apart.host(LEFT)
    wait_for(lambda: ears.age_s(LEFT) < 0.1 and host.hears(), "state here and there")
    wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "all fast topics")
    wait_for(lambda: not any("".join(ears.codes(topic)[-1:]) for topic in FAST), "the end of what was observed before")
    ears.mark()
    goes(host)
    wait_for(elapsed_since(time.monotonic(), LEASE_S + 2.0), "the end of every lease", 20.0)
    assert max(ears.worst_s(topic) for topic in FAST) < 0.5
    assert not any(ears.codes(topic) for topic in FAST)


@WAYS
def test_without_our_token_the_same_ends_our_state_which_is_told_and_cured(
    apart: Apart, goes: Callable[[Host], None]
) -> None:
    """The bridge drops its reader although we subscribe: ROUTE_DEAD on that topic alone, declared again, state again."""
    ears = apart.ears(has_tokens=False)
    host = apart.host(LEFT)
    wait_for(lambda: ears.age_s(LEFT) < 0.1 and host.hears(), "state here and there")
    wait_for(lambda: ears.age_s(RIGHT) < 0.1, "the other arm")
    ears.mark()
    goes(host)
    wait_for(lambda: ears.age_s(LEFT) > 0.4, "the death of the route", LEASE_S + 5.0)
    wait_for(lambda: Code.ROUTE_DEAD.value in ears.codes(LEFT), "the diagnosis", 5.0)
    wait_for(lambda: ears.age_s(LEFT) < 0.1, "state again", 10.0)
    wait_for(lambda: ears.codes(LEFT)[-1] == "", "the end of the finding", 5.0)
    assert not any(ears.codes(RIGHT)) and ears.worst_s(RIGHT) < 0.5


def test_a_node_that_leaves_in_order_and_comes_back_is_heard_as_soon_as_it_is_there(apart: Apart) -> None:
    """The silence is the fault itself and what discovery takes; told as lost meanwhile, and over when samples come."""
    ears = apart.ears(has_tokens=True)
    wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "state")
    ears.mark()
    apart.end_node()
    wait_for(lambda: Code.ROUTE_LOST.value in ears.codes(LEFT), "the diagnosis", 5.0)
    apart.start_node()
    with apart.control():
        back = time.monotonic()
        wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "state again", DISCOVERY_S)
        print(f"\nnode back: state {time.monotonic() - back:.2f} s later")
    wait_for(lambda: ears.codes(LEFT)[-1] == "", "the end of the finding", 5.0)


def test_a_bridge_that_is_restarted_is_heard_again_without_anybodys_doing(apart: Apart) -> None:
    """Session, subscriptions and tokens are declared again by zenoh itself, on every topic."""
    ears = apart.ears(has_tokens=True)
    wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "state")
    apart.kill_bridge()
    wait_for(lambda: not ears.link.is_up, "the loss of the transport", 3.0)
    apart.start_bridge()
    back = time.monotonic()
    wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "state again", DISCOVERY_S + 1.0)
    print(f"\nbridge back: state {time.monotonic() - back:.2f} s later")


@pytest.mark.parametrize("apart", [LONG_LEASE_S], indirect=True, ids=["long lease"])
@pytest.mark.parametrize("has_tokens", [True, False], ids=["our tokens", "no tokens"])
def test_a_node_killed_and_restarted_within_its_lease_is_lost_when_the_lease_ends(
    apart: Apart, has_tokens: bool
) -> None:
    """The dead participant's end takes the routes of the new node with it: ROUTE_LOST until an orderly restart.

    With our tokens the state goes on, and only the commands are lost: nothing but the tokens of the bridge shows it.
    """
    ears = apart.ears(has_tokens=has_tokens)
    wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "state")
    # State may come before: with our tokens the bridge makes its readers without knowing the node.
    wait_for(lambda: ears.link.readiness()[FSM_ENABLE] == "ready", "the bridge to know the node")
    apart.end_node(signal.SIGKILL)
    apart.start_node()
    wait_for(lambda: ears.age_s(LEFT) > 0.3, "the silence of the dead node", 5.0)
    wait_for(lambda: ears.age_s(LEFT) < 0.1, "state of the new node", LONG_LEASE_S)
    ears.mark()
    lost = FSM_ENABLE if has_tokens else LEFT
    wait_for(lambda: Code.ROUTE_LOST.value in [code for _, code in ears.told(lost)], "the loss", LONG_LEASE_S + 6.0)
    with apart.control() as control:
        assert control.ask("ping")["ok"], "the new node lives"
    assert ears.link.is_up and (ears.worst_s(LEFT) < 0.5) is has_tokens
    wait_for(lambda: "not announced" in ears.link.readiness()[FSM_ENABLE], "the words for it", 6.0)
    apart.end_node()
    apart.start_node()
    wait_for(lambda: all(ears.age_s(topic) < 0.2 for topic in FAST), "state after an orderly restart", 10.0)
    wait_for(lambda: ears.told(lost)[-1][1] == "", "the end of the finding", 5.0)


def test_state_that_comes_several_times_is_counted_and_skipped(apart: Apart) -> None:
    """Restarts beyond the lease while nobody holds a token: every later subscriber gets each sample two or three times.

    We count what a plain subscriber beside us is given.
    """
    key = topic_to_key(LEFT)
    session = apart.session()
    heard: list[bytes] = []

    def hear(sample: zenoh.Sample) -> None:
        heard.append(sample.payload.to_bytes())

    keeper = session.declare_subscriber(key, hear)
    tokens = f"@/*/@ros2_lv/MP/{key.replace('/', '§')}/**"
    for _ in range(6):  # seldom it takes more than two
        wait_for(lambda: len(heard) > 20, "state")
        apart.end_node(signal.SIGKILL)
        wait_for(
            lambda: not list(session.liveliness().get(tokens, timeout=1.0)), "the end of the lease", LEASE_S + 10.0
        )
        apart.start_node()
        keeper.undeclare()
        heard.clear()
        keeper = session.declare_subscriber(key, hear)
        wait_for(lambda: len(heard) > 100, "state")
        if len(heard) > 1.9 * len(set(heard)):
            break
    ears = apart.ears(has_tokens=True)
    wait_for(lambda: ears.samples[LEFT] > 0, "state here")
    ears.mark()
    heard.clear()
    wait_for(lambda: ears.samples[LEFT] > 600, "a second and more")
    times = 1.0 + ears.duplicates[LEFT] / ears.samples[LEFT]
    given = len(heard) / len(set(heard))
    print(f"\n{times:.2f} times, {given:.2f} beside, {ears.samples} {ears.duplicates}")
    assert given > 1.9, "the bridge does not send it several times, so nothing is proved"
    assert times == pytest.approx(given, abs=0.05)
