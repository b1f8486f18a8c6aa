"""Judges a bag: is all there, does each message say what its type promises, where is something missing, do the clocks fit.

Every message is read and decoded once. What is not known (topics of others) is counted, not judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Literal

from msgspec import Struct, field

from cdr_types import CdrError, UnknownType, decode, message_type
from cdr_types.messages.geometry_msgs import Pose
from cdr_types.messages.sensor_msgs import JointState
from gateway.recording.bag_reader import Bag, BagTopic
from gateway.recording.delays import WINDOW_NS, Delays, Least, step_ns, widened
from gateway.recording.episodes import Episode, episodes, events
from gateway.recording.topics import CONTACT, EPISODES, EVENTS, GATEWAY, POLICY, STALE_NS, gap_ns, recorded_topics
from gateway.robot.topics import COMMAND_TOPICS, MOTION_STATE_TOPICS, TOPICS, Direction
from gateway.settings.settings import LinkSettings

__all__ = ["Checked", "Finding", "check"]

Level = Literal["error", "warning"]

SLOW_SHARE = 0.9
"""A state that comes at less than this part of its rate is too slow."""
ENOUGH = 20
"""Where fewer messages were to come no rate is judged."""
DRIFT_PPM = 200.0
"""Clocks that go apart by more than this cannot be put together by one offset."""


class Finding(Struct, frozen=True, kw_only=True):
    """Something that is not as it should be: how bad, of which topic (empty for the bag itself), what, and what then helps."""

    level: Level
    topic: str
    message: str
    hint: str = ""


class Watched(Struct):
    """One topic while it is read: count, arrivals and stamps [ns], gaps, and what was wrong with its messages.

    Before its first message `last_ns` is the bag's begin: a state that comes late, or ends early, is missing as in a gap.
    """

    type_name: str
    rate_hz: float
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    worst_ns: int = 0
    worst_at_ns: int = 0
    gaps: int = 0
    stamp_ns: int = 0
    repeated: int = 0
    stamps_back: int = 0
    delays: Delays = field(default_factory=Delays)
    malformed: int = 0
    why: str = ""
    not_finite: int = 0
    short: int = 0


class Checked(Struct, frozen=True, kw_only=True):
    """What came of it: messages read, length [s], rates by topic [Hz], and findings, the worst first."""

    messages: int
    duration_s: float
    rates_hz: dict[str, float]
    findings: list[Finding]

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not any(finding.level == "error" for finding in self.findings)


def check(bag: Bag, on_progress: Callable[[float], None] = lambda share: None) -> Checked:
    """Read a bag and judge it.

    Args:
        bag: Open.
        on_progress: Called now and then with the part that was read, 0..1.
    """
    topics = [topic for topic in bag.topics if not topic.alias_of]
    watched = {
        topic.name: Watched(type_name=topic.type_name, rate_hz=_rate_hz(topic.name), last_ns=bag.begin_ns)
        for topic in topics
    }
    announced = bag.message_count - sum(topic.count for topic in bag.topics if topic.alias_of)
    expected, count = max(announced, 1), 0
    for topic, log_ns, payload in bag.messages(watched):
        if count % 5000 == 0:
            on_progress(min(count / expected, 1.0))
        count += 1
        _watch(watched[topic], log_ns, payload)
    on_progress(1.0)
    findings = [
        *_of_bag(bag, topics, count, announced),
        *_of_episodes(bag, watched[EPISODES].count if EPISODES in watched else 0),
    ]
    for name, one in watched.items():
        if one.count:
            _watch_silence(one, bag.end_ns)
        findings += _of_topic(name, one, bag)
    findings.sort(key=lambda finding: finding.level != "error")
    rates = {
        name: (one.count - 1) * 1e9 / (one.last_ns - one.first_ns)
        for name, one in watched.items()
        if one.count > 1 and one.last_ns > one.first_ns
    }
    return Checked(messages=count, duration_s=bag.duration_s, rates_hz=rates, findings=findings)


def _rate_hz(name: str) -> float:
    """Return the nominal rate of a state, also of a robot with a namespace; 0 where there is none."""
    for known, topic in TOPICS.items():
        if topic.direction is Direction.STATE and name.endswith(known):
            return topic.rate_hz
    return 0.0


def _watch_silence(topic: Watched, until_ns: int) -> None:
    """See how long it was silent [ns]: until its next message, or to the end of the bag."""
    interval_ns = until_ns - topic.last_ns
    if interval_ns > topic.worst_ns:
        topic.worst_ns, topic.worst_at_ns = interval_ns, topic.last_ns
    topic.gaps += interval_ns > gap_ns(topic.rate_hz)


def _watch(topic: Watched, log_ns: int, payload: bytes) -> None:
    _watch_silence(topic, log_ns)
    if not topic.count:
        topic.first_ns = log_ns
    topic.count += 1
    topic.last_ns = log_ns
    try:
        message = decode(payload, message_type(topic.type_name))
    except UnknownType:
        return
    except CdrError as error:
        topic.malformed += 1
        topic.why = topic.why or str(error)
        return
    if isinstance(message, JointState):
        _watch_joints(topic, message, log_ns)
    elif isinstance(message, Pose):
        p, q = message.position, message.orientation
        topic.not_finite += not all(map(math.isfinite, (p.x, p.y, p.z, q.x, q.y, q.z, q.w)))


def _watch_joints(topic: Watched, message: JointState, log_ns: int) -> None:
    stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    if stamp_ns:
        if topic.stamp_ns:
            topic.repeated += stamp_ns == topic.stamp_ns
            topic.stamps_back += stamp_ns < topic.stamp_ns
        topic.stamp_ns = stamp_ns
        topic.delays.add(log_ns, stamp_ns)
    values = (*message.position, *message.velocity, *message.effort)
    topic.not_finite += not all(map(math.isfinite, values))
    topic.short += not message.position


def _of_bag(bag: Bag, topics: list[BagTopic], count: int, announced: int) -> Iterator[Finding]:
    if not count:
        yield Finding(level="error", topic="", message="it holds no message")
        return
    if count != announced:
        message = f"{count} messages can be read, {announced} are announced"
        yield Finding(level="error", topic="", message=message, hint="copy it again, or recover it")
    facts = bag.facts()
    if int(facts.get("lost") or 0):
        message = f"the recorder lost {facts['lost']} messages: its disk was too slow"
        yield Finding(level="error", topic="", message=message, hint="record on a faster disk")
    if facts.get("error"):
        yield Finding(level="warning", topic="", message=f"the recording ended by itself: {facts['error']}")
    if facts and "lost" not in facts:
        message = "the recorder was killed: the last half second may be missing"
        yield Finding(level="warning", topic="", message=message)
    if facts:
        settings = LinkSettings(namespace=facts.get("namespace", ""), model=facts.get("model") or "standard")
        for topic in recorded_topics(settings):
            if topic.is_state and topic.name not in {t.name for t in topics if t.count}:
                message = "nothing of it came, though every robot of this model has it"
                hint = "was the robot on? `ta2 link` tells what is missing"
                yield Finding(level="error", topic=topic.name, message=message, hint=hint)


def _of_episodes(bag: Bag, said: int) -> Iterator[Finding]:
    """Judge what was said of episodes: so many words."""

    def finding(message: str, hint: str = "") -> Finding:
        return Finding(level="warning", topic=EPISODES, message=message, hint=hint)

    if not said:
        return
    unread = said - sum(1 for _ in events(bag))
    if unread:
        yield finding(f"{unread} of {said} messages say nothing of an episode that can be read")
    robots = [topic.name for topic in bag.topics if topic.name not in (CONTACT, EPISODES, EVENTS, GATEWAY, POLICY)]
    before: Episode | None = None
    for episode in episodes(bag):
        name = f"episode {episode.number}"
        if not episode.is_finished:
            yield finding(f"{name} was never stopped: it ends with the bag", "was the recorder killed in it?")
        if next(bag.messages(robots, episode.begin_ns, episode.end_ns), None) is None:
            yield finding(f"{name} is empty: nothing of the robot came in it", "leave it out, or discard it")
        if before is not None and episode.begin_ns < before.end_ns:
            overlap_s = (min(before.end_ns, episode.end_ns) - episode.begin_ns) / 1e9
            yield finding(
                f"{name} begins {overlap_s:.2f} s before the end of episode {before.number}", "cut one of them"
            )
        before = episode if before is None or episode.end_ns > before.end_ns else before


def _of_topic(name: str, topic: Watched, bag: Bag) -> Iterator[Finding]:
    def finding(level: Level, message: str, hint: str = "") -> Finding:
        return Finding(level=level, topic=name, message=message, hint=hint)

    if topic.malformed:
        yield finding("error", f"{topic.malformed} of {topic.count} messages cannot be decoded: {topic.why}")
    if topic.not_finite:
        yield finding("error", f"{topic.not_finite} of {topic.count} messages hold NaN or infinity")
    if topic.short:
        yield finding("error", f"{topic.short} of {topic.count} messages hold no position")
    if topic.gaps:
        worst, at_s = topic.worst_ns / 1e6, (topic.worst_at_ns - bag.begin_ns) / 1e9
        message = f"{topic.gaps} gaps, the longest of {worst:.0f} ms after {at_s:.2f} s"
        is_in_rows = topic.worst_ns > STALE_NS and name.endswith(MOTION_STATE_TOPICS)
        hint = (
            f"rows of a dataset that hold it are not made across more than {STALE_NS / 1e9:g} s" if is_in_rows else ""
        )
        yield finding("warning", message, hint)
    awaited = topic.rate_hz * bag.duration_s
    if awaited >= ENOUGH and topic.count < SLOW_SHARE * awaited:
        rate_hz = topic.count / bag.duration_s
        yield finding("warning", f"{rate_hz:.1f} Hz over the whole bag, {topic.rate_hz:g} Hz are the rule")
    if topic.repeated:
        hint = "a bridge delivers twice: restart the robot's bridge"
        yield finding("warning", f"{topic.repeated} messages have the stamp of the one before", hint)
    is_told = name.endswith(COMMAND_TOPICS)
    was_set = "its sender's clock was set, or another one sent" if is_told else "the robot's clock was set"
    step_ms, drift_ppm = step_ns(topic.delays.least) / 1e6, _drift_ppm(topic.delays.least)
    if topic.stamps_back:
        yield finding("warning", f"{topic.stamps_back} stamps go back: {was_set}")
    elif step_ms:
        yield finding("warning", f"stamps jump by {step_ms:+.0f} ms: {was_set}")
    elif abs(drift_ppm) > DRIFT_PPM:
        whose = "its sender's" if is_told else "the robot's"
        yield finding("warning", f"{whose} clock goes apart from the recorder's by {drift_ppm:.0f} ppm")


def _drift_ppm(least: Least) -> float:
    """Return how fast the smallest delays of the first and of the last whole window go apart; 0 where there are too few."""
    whole = list(widened(least).items())[1:-1]
    if len(whole) < 3:
        return 0.0
    (first, before_ns), (last, after_ns) = whole[0], whole[-1]
    return (after_ns - before_ns) / ((last - first) * WINDOW_NS) * 1e6
