"""What is known of the robot: the latest value of each state topic and everything that follows from arrival times.

Every consumer asks here; nobody keeps timers of his own. The rules:

* Ages come from the local monotonic arrival only. The robot's stamps are compared with each other, never with a clock
  of ours: steps of either wall clock change nothing.
* A sample that is not believed (refused by the codec, a repeated or earlier stamp, an implausible jump of an arm) is
  counted and changes neither value nor age, so a part whose samples are all bad goes stale by itself.
* Nothing is refused for ever: two samples in a row that are behind but go on between themselves are a robot whose
  clock was set back; a jump that lasts, far beyond the part's death, is the new truth.
* *Seedable* is stricter than fresh: queued states have fresh receive times, but their stamp lag gives them away. And no
  stream starts from one sample alone: those of the last moments must say the same.

It does not know the supervisor's states, zenoh, CDR or limits of motion.
"""

from __future__ import annotations

from collections import deque
from itertools import combinations
from operator import le

from gateway.core.messages.events import SampleArrived, SampleRefused, StateValue
from gateway.core.robot_state.arrival import Meter, Recent
from gateway.core.robot_state.jumps import JOINTS, POSES, JumpGuard, Kind, Posture
from gateway.errors import Code
from gateway.messages.snapshot import TopicView
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, MOTION_STATE_TOPICS, STATE_TOPICS, arm_state, ee_pose
from gateway.settings.settings import EnableSettings
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Side, Vector

__all__ = ["Store"]

MS = 1_000_000
S = 1_000_000_000

LAG_BUCKET_NS = 6 * S
"""The least lag is kept for ten of these: a clock slewed by 500 ppm moves 30 ms meanwhile, less than is allowed."""
NAMES_WRONG_NS = 1 * S
MISNAMED_NS = 50 * MS
"""Of an arm's samples all must have other names for so long [ns]: where a connection comes back, zenoh may bring a few of
another topic's."""

AGREED_NS = 50 * MS
"""A stream starts where all samples of the last so long [ns] say that the arm is."""
AGREED_LEAST = 3
"""Fewer samples do not agree: they may be one."""
AGREED_JOINTS, AGREED_POSES = (0.02,) * 7, (0.01, 0.05)
"""How far they may be apart [rad; m and rad]: noise, and a slow hand (0.4 rad/s). A jump that is small enough to be plausible
is 0.1 rad or 0.1 m beyond noise; whoever moves an arm faster is not ready to have it started."""


class _Latest:
    """An arm's believed joints, or poses, of the last moments, and how far they may be apart."""

    __slots__ = ("_bounds", "_kind", "_samples", "_stale_ns")

    def __init__(self, kind: Kind, bounds: Vector, stale_ns: int) -> None:
        self._kind, self._bounds, self._stale_ns = kind, bounds, stale_ns
        self._samples: deque[tuple[int, Vector]] = deque()

    def add(self, received_ns: int, values: Vector) -> None:
        """Take a believed sample; those from before a silence say nothing of now."""
        if self._samples and received_ns - self._samples[-1][0] > self._stale_ns:
            self._samples.clear()
        self._samples.append((received_ns, values))
        while len(self._samples) > AGREED_LEAST and received_ns - self._samples[0][0] > AGREED_NS:
            self._samples.popleft()

    def is_agreed(self, since_ns: int) -> bool:
        """Return whether there are enough, none of before that time, and they say the same."""
        if len(self._samples) < AGREED_LEAST or self._samples[0][0] < since_ns:
            return False
        pairs = combinations([values for _, values in self._samples], 2)
        return all(all(map(le, self._kind.steps(a, b), self._bounds)) for a, b in pairs)


class _SeedWindow:
    """Since when an arm's samples have been coming without a gap and without queueing.

    Lag is arrival (our clock) minus stamp (the robot's); its offset means nothing, its distance from the least lag of
    the last 60 s does. When a sample with much less lag shows that those before it were old, they leave the window,
    too: a backlog that drains cannot pass for a live stream even when nothing was known before it.
    """

    __slots__ = (
        "_lags",
        "_newest_ns",
        "_not_before_ns",
        "_settings",
        "_since_ns",
        "_stamp_ns",
        "_worst_lag_ns",
    )

    def __init__(self, settings: EnableSettings) -> None:
        self._settings = settings
        self._newest_ns = self._stamp_ns = self._worst_lag_ns = self._not_before_ns = 0
        self._since_ns: int | None = None
        self.forget_lag()

    def restart(self, not_before_ns: int) -> None:
        """Start anew with samples that arrive from then on; what is known about the lag stays."""
        self._since_ns, self._not_before_ns = None, not_before_ns

    def forget_lag(self) -> None:
        """Start anew: another transport, another robot, or its clock was set."""
        self._since_ns = None
        self._lags = Recent(min, LAG_BUCKET_NS)

    def add(self, received_ns: int, stamp_ns: int) -> None:
        """Take a believed sample."""
        if stamp_ns < self._stamp_ns:
            self.forget_lag()
        lag_ns, gap_ns = received_ns - stamp_ns, received_ns - self._newest_ns
        self._lags.add(received_ns, lag_ns)
        bound_ns = self._lags.extreme(received_ns, lag_ns) + self._settings.seed_lag_ns
        if lag_ns > bound_ns or received_ns < self._not_before_ns:
            self._since_ns = None
        elif self._since_ns is None or gap_ns > self._settings.stale_ns or self._worst_lag_ns > bound_ns:
            self._since_ns, self._worst_lag_ns = received_ns, lag_ns
        else:
            self._worst_lag_ns = max(self._worst_lag_ns, lag_ns)
        self._newest_ns, self._stamp_ns = received_ns, stamp_ns

    @property
    def since_ns(self) -> int | None:
        """Since when samples have been timely [ns]; None when the newest was not."""
        return self._since_ns

    def is_full(self) -> bool:
        """Return whether the window is long enough, up to the newest sample."""
        return self._since_ns is not None and self._newest_ns - self._since_ns >= self._settings.seed_ns


class _Track:
    """One state topic."""

    __slots__ = (
        "_behind_ns",
        "_stamp_ns",
        "live_ns",
        "meter",
        "misnamed_ns",
        "received_ns",
        "refused_ns",
        "value",
        "why_refused",
    )

    def __init__(self) -> None:
        self.meter = Meter()
        self.value: StateValue | None = None
        self.received_ns: int | None = None  # arrival of the value
        self.live_ns: int | None = None  # the same; None since a reset
        self.why_refused = ""
        self.refused_ns: int | None = None  # arrival of the newest sample that was not believed
        self.misnamed_ns: int | None = None  # arrival of the first of those with other names, while no other one comes
        self._stamp_ns: int | None = None  # newest stamp that was in order
        self._behind_ns: int | None = None  # stamp of the sample before, when that one was behind

    def forget(self) -> None:
        """Keep the value for display; it is not fresh, and its stamp says nothing about the next one."""
        self.live_ns = self._stamp_ns = self._behind_ns = self.misnamed_ns = None

    def refuse(self, why: str, at_ns: int, count: int = 1) -> None:
        self.meter.refused += count
        self.why_refused, self.refused_ns = why, at_ns

    def within(self, now_ns: int, limit_ns: int) -> bool:
        return self.live_ns is not None and now_ns - self.live_ns <= limit_ns

    def in_order(self, stamp_ns: int) -> bool:
        """Return whether a sample may be used: a repeated or earlier stamp may not.

        A late sample stands alone. A second one in a row that is behind, but ahead of the first, means that the
        robot's clock was set back: its samples are used from then on, whatever the step.
        """
        last_ns, behind_ns = self._stamp_ns, self._behind_ns
        self._behind_ns = stamp_ns if last_ns is not None and stamp_ns < last_ns else None
        if last_ns is None or stamp_ns > last_ns or (behind_ns is not None and behind_ns < stamp_ns < last_ns):
            self._stamp_ns, self._behind_ns = stamp_ns, None
            return True
        return False


class Store:
    """The robot as last seen. The settings say how old a state may be and what seeding takes."""

    def __init__(self, settings: EnableSettings) -> None:
        self._settings = settings
        self._tracks = {topic: _Track() for topic in STATE_TOPICS}
        self._arms = {side: self._tracks[arm_state(side)] for side in Side}
        self._poses = {side: self._tracks[ee_pose(side)] for side in Side}
        self._fsm = self._tracks[FSM_STATE]
        self._mode = self._tracks[CURRENT_MODE]
        self._seeds = {arm_state(side): _SeedWindow(settings) for side in Side}
        self._latest = {
            **{arm_state(side): _Latest(JOINTS, AGREED_JOINTS, settings.stale_ns) for side in Side},
            **{ee_pose(side): _Latest(POSES, AGREED_POSES, settings.stale_ns) for side in Side},
        }
        self._guards = {
            **{arm_state(side): JumpGuard(JOINTS, settings) for side in Side},
            **{ee_pose(side): JumpGuard(POSES, settings) for side in Side},
        }
        self._link_ns: int | None = None  # newest fast sample on this transport
        self._names_wrong: SampleRefused | None = None

    def receive(self, event: SampleArrived | SampleRefused, now_ns: int) -> str:
        """Take what the link says about one state topic; an arrival stamped after `now_ns` counts as now.

        Returns:
            How far an arm has jumped, when a jump that lasted is believed from now on; empty otherwise.
        """
        track = self._tracks[event.topic]
        if isinstance(event, SampleRefused):
            track.refuse(event.message, min(event.received_ns, now_ns), event.count)
            if event.code is Code.JOINT_ORDER and event.topic in self._seeds:
                track.misnamed_ns = event.received_ns if track.misnamed_ns is None else track.misnamed_ns
                if event.received_ns - track.misnamed_ns >= MISNAMED_NS:
                    self._names_wrong = event
            return ""
        track.misnamed_ns = None
        received_ns = min(event.received_ns, now_ns)
        track.meter.add(event, received_ns)
        why = self._why_not(track, event, received_ns)
        if why:
            track.refuse(why, received_ns)
            return ""
        track.value = event.value
        track.received_ns = track.live_ns = received_ns
        if event.topic in MOTION_STATE_TOPICS:
            self._link_ns = max(received_ns, self._link_ns or received_ns)
        guard = self._guards.get(event.topic)
        return f"{event.topic}: {guard.jumped}" if guard is not None and guard.jumped else ""

    def reset(self) -> None:
        """Forget freshness and stamp lags: the transport was lost, or the robot restarted. Values stay for display."""
        self._link_ns = None
        for track in self._tracks.values():
            track.forget()
        for seed in self._seeds.values():
            seed.forget_lag()
        for guard in self._guards.values():
            guard.believe(None)

    def disturb(self, now_ns: int) -> None:
        """Start seeding anew: this process stood still until now, so what it finds waiting may be old."""
        for seed in self._seeds.values():
            seed.restart(now_ns)

    def value(self, topic: str) -> StateValue | None:
        """Return the last believed value of a topic, however old; None before the first."""
        return self._tracks[topic].value

    def arm(self, side: Side) -> ArmState | None:
        """Return the last measured joints of an arm, however old."""
        return value if isinstance(value := self._arms[side].value, ArmState) else None

    def pose(self, side: Side) -> EePose | None:
        """Return the last measured end-effector pose of an arm, however old."""
        return value if isinstance(value := self._poses[side].value, EePose) else None

    @property
    def fsm_raw(self) -> int | None:
        """The last `/fsm_state`, however old."""
        return value if isinstance(value := self._fsm.value, int) else None

    def age_ns(self, topic: str, now_ns: int) -> int | None:
        """Return the age of a topic's value for views and messages; None before the first, a reset changes nothing.

        Whether a value may be used is asked with `is_fresh`, `part_fresh`, `fsm`, `mode` and `seedable`.
        """
        received_ns = self._tracks[topic].received_ns
        return None if received_ns is None else now_ns - received_ns

    def link_age_ns(self, now_ns: int) -> int | None:
        """Return the age of the newest fast state topic for views and messages; None before the first sample."""
        return min((a for t in MOTION_STATE_TOPICS if (a := self.age_ns(t, now_ns)) is not None), default=None)

    def is_fresh(self, now_ns: int) -> bool:
        """Return whether the newest fast state topic came over this transport and is young enough."""
        return self._link_ns is not None and now_ns - self._link_ns <= self._settings.stale_ns

    def part_fresh(self, side: Side, now_ns: int, needs_pose: bool) -> bool:
        """Return whether an arm's joints, and its `current_ee_pose` where needed, are young enough."""
        stale_ns = self._settings.stale_ns
        pose_ok = not needs_pose or self._poses[side].within(now_ns, stale_ns)
        return pose_ok and self._arms[side].within(now_ns, stale_ns)

    def fsm(self, now_ns: int) -> int | None:
        """Return `/fsm_state` (manual §4.11.1); None when unknown: older than 0.5 s, or of before a reset."""
        return self.fsm_raw if self._fsm.within(now_ns, self._settings.fsm_valid_ns) else None

    @property
    def fsm_received_ns(self) -> int | None:
        """When it arrived, for those who demand one newer than an instant; None when not since a reset."""
        return self._fsm.live_ns

    def mode(self, now_ns: int) -> CurrentMode | None:
        """Return `/api/current_mode` (manual §4.11.2); None when unknown: older than 3 s, or of before a reset."""
        value, valid = self._mode.value, self._mode.within(now_ns, self._settings.mode_valid_ns)
        return value if valid and isinstance(value, CurrentMode) else None

    @property
    def mode_received_ns(self) -> int | None:
        """When it arrived, for those who demand one newer than an instant; None when not since a reset."""
        return self._mode.live_ns

    def seedable(self, side: Side, now_ns: int, needs_pose: bool = False) -> bool:
        """Return whether a stream may start from this arm's measured state after a stall, a reconnect or a pause.

        It may after 0.3 s of samples without a gap of 100 ms whose stamp lag stayed within 100 ms of the least lag, while
        the last of them agree. Poses carry no stamp: where they are needed the last of them must have come within that time.
        """
        seed = self._seeds[arm_state(side)]
        is_ready = self.part_fresh(side, now_ns, needs_pose) and seed.is_full()
        return is_ready and self.agreed(side, needs_pose, seed.since_ns or 0)

    def agreed(self, side: Side, needs_pose: bool = False, since_ns: int = 0) -> bool:
        """Return whether an arm's latest believed joints, and poses where needed, say the same, however old they are."""
        topics = (arm_state(side), ee_pose(side)) if needs_pose else (arm_state(side),)
        return all(self._latest[topic].is_agreed(since_ns) for topic in topics)

    def timely_since_ns(self) -> int | None:
        """Return since when arms' samples have come without queueing [ns]: whatever arrived before may be old."""
        starts = [seed.since_ns for seed in self._seeds.values() if seed.since_ns is not None]
        return min(starts, default=None)

    def name_order_wrong(self, now_ns: int) -> str | None:
        """Return what was wrong with the joint names of an arm within the last second, or None (manual §4.0.3)."""
        wrong = self._names_wrong
        return wrong.message if wrong and now_ns - wrong.received_ns <= NAMES_WRONG_NS else None

    def topic_view(self, topic: str, now_ns: int) -> TopicView:
        """Return age, rate and counters of a topic; samples that were not believed are among the refused."""
        meter = self._tracks[topic].meter
        rate_hz, worst_gap_ns = meter.figures(now_ns)
        return TopicView(
            age_ns=self.age_ns(topic, now_ns),
            rate_hz=rate_hz,
            worst_gap_ns=worst_gap_ns,
            count=meter.count,
            duplicates=meter.duplicates,
            refused=meter.refused,
        )

    def why_not_believed(self, topic: str, within_ns: int, now_ns: int) -> str:
        """Return why the samples of a topic are not believed of late; empty when they are, or when none comes.

        Args:
            topic: ROS name.
            within_ns: An older refusal says nothing about now [ns].
            now_ns: Monotonic time [ns].
        """
        track = self._tracks[topic]
        is_newest = track.refused_ns is not None and track.refused_ns > (track.received_ns or 0)
        return track.why_refused if is_newest and now_ns - (track.refused_ns or 0) <= within_ns else ""

    def _why_not(self, track: _Track, event: SampleArrived, received_ns: int) -> str:
        value = event.value
        if isinstance(value, MotorState) and not track.in_order(value.stamp_ns):
            return f"stamp {value.stamp_ns} ns is not newer than the one before"
        if isinstance(value, EePose):  # it carries no stamp
            posture = Posture(value.values, received_ns, received_ns)
        elif isinstance(value, ArmState):
            posture = Posture(value.q_rad, received_ns, value.stamp_ns)
        else:
            return ""
        why = self._guards[event.topic].why_not(posture)
        if not why:
            self._latest[event.topic].add(received_ns, posture.values)
            if isinstance(value, ArmState):
                self._seeds[event.topic].add(received_ns, value.stamp_ns)
        return why
