"""The heartbeat: 1.0 while armed, 0.0 until PAUSE is seen, and the memory of what is owed."""

from __future__ import annotations

import pytest

from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.heartbeat import LAST_WORD_NS, Beat, HeartbeatStream
from gateway.robot.topics import FSM_ENABLE

MS = 1_000_000
S = 1_000_000_000
T0 = 1_000 * S
ONE, ZERO = (1.0,), (0.0,)


class Course:
    """A heartbeat that is ticked every 10 ms, as the engine does.

    Attributes:
        beat: The stream.
        sent: What left, with its time [ms since T0].
    """

    def __init__(self, timeout_ns: int = 2 * S) -> None:
        self.beat = HeartbeatStream(timeout_ns)
        self.now_ns = T0
        self.sent: list[tuple[int, Frame]] = []

    def run(self, milliseconds: int) -> list[tuple[int, float]]:
        """Let time pass; return what left meanwhile: when [ms since T0] and 1.0 or 0.0."""
        before, end_ns = len(self.sent), self.now_ns + milliseconds * MS
        while self.now_ns < end_ns:
            frame = self.beat.frame(self.now_ns) if self.beat.running else None
            if frame is not None:
                self.beat.log.note(self.now_ns)
                self.sent.append(((self.now_ns - T0) // MS, frame))
            self.now_ns += 10 * MS
        return [(at_ms, frame.values[0]) for at_ms, frame in self.sent[before:]]

    def ones(self, milliseconds: int = 500) -> Course:
        """Send 1.0 for a while."""
        self.beat.ones(self.now_ns)
        self.run(milliseconds)
        return self

    def fsm_zero(self) -> None:
        """An FSM 0 sample arrives now."""
        self.beat.fsm_zero_seen(self.now_ns)


@pytest.fixture
def armed() -> Course:
    """A heartbeat that has sent 1.0 for half a second."""
    return Course().ones()


# ------------------------------------------------------------------------------------------------------ 1.0 and 0.0


def test_a_heartbeat_is_silent_until_it_is_asked_for():
    """A gateway that only reads sends nothing on the FSM's topic."""
    beat = HeartbeatStream(2 * S)
    assert (beat.beat, beat.running, beat.is_ending, beat.is_owed) == (Beat.SILENT, False, False, False)
    assert (beat.next_due_ns(), beat.frame(T0), beat.is_estop) == (None, None, False)
    beat.fsm_zero_seen(T0)
    assert (beat.running, beat.is_owed, beat.gave_up_at_ns) == (False, False, None)


def test_ones_leave_at_once_and_then_at_20_hz():
    """Manual §4.7: more than 1 Hz, 10-20 Hz advised; between two instants of the grid nothing is due."""
    course = Course()
    course.now_ns = T0 + 30 * MS
    course.beat.ones(course.now_ns)
    assert course.run(300) == [(30, 1.0), *((at_ms, 1.0) for at_ms in range(50, 330, 50))]
    assert course.beat.next_due_ns() == T0 + 350 * MS
    assert course.sent[0][1] == Frame(topic=FSM_ENABLE, values=ONE, kind=FrameKind.BEAT, epoch=0, due_ns=T0)


def test_asking_for_ones_again_changes_nothing(armed):
    """The phases ask on every tick."""
    for _ in range(20):
        armed.beat.ones(armed.now_ns)
        armed.run(10)
    assert [at_ms for at_ms, _ in armed.sent] == list(range(0, 700, 50))


def test_ones_after_a_short_silence_leave_at_once_too(armed):
    """A short stall is over: 1.0 does not wait for the next instant of the grid (BEHAVIOUR, short stall)."""
    armed.beat.silence()
    armed.run(20)
    armed.beat.ones(armed.now_ns)
    assert armed.run(40) == [(520, 1.0), (550, 1.0)]


def test_zeros_leave_at_once_as_stop_frames_until_fsm_0_is_seen(armed):
    """The first 0.0 does not wait for the grid (BEHAVIOUR, stopping and losing)."""
    armed.run(20)
    armed.beat.zeros(armed.now_ns)
    assert armed.beat.is_ending and armed.run(180) == [(520, 0.0), (550, 0.0), (600, 0.0), (650, 0.0)]
    assert armed.sent[-1][1] == Frame(topic=FSM_ENABLE, values=ZERO, kind=FrameKind.STOP, epoch=0, due_ns=T0 + 650 * MS)
    armed.fsm_zero()
    assert not armed.beat.running and not armed.beat.is_owed and armed.run(3000) == []


def test_asking_for_zeros_again_does_not_prolong_them(armed):
    """A condition that lasts asks on every tick; the 2 s count from the first time."""
    for _ in range(200):
        armed.beat.zeros(armed.now_ns)
        armed.run(10)
    armed.run(1000)
    assert [at_ms for at_ms, frame in armed.sent if frame.values == ZERO] == list(range(500, 2550, 50))


def test_ones_end_a_repetition_of_zeros(armed):
    """An `enable` out of PAUSED: never 1.0 and 0.0 in turn."""
    armed.beat.zeros(armed.now_ns)
    armed.run(100)
    armed.beat.ones(armed.now_ns)
    assert {value for _, value in armed.run(200)} == {1.0} and not armed.beat.is_ending


def test_a_silent_heartbeat_starts_without_a_gap_of_the_past(armed):
    """Silence on purpose is no gap, and its stream is shown as not running."""
    armed.beat.silence()
    assert not armed.beat.running and not armed.beat.log.view(armed.now_ns).running
    assert armed.run(5000) == []
    armed.ones()
    assert armed.beat.log.view(armed.now_ns).worst_gap_ns == 50 * MS


# ------------------------------------------------------------------------------------------------------ giving up


@pytest.mark.parametrize("timeout_ns", [1 * S, 2 * S])
def test_zeros_give_up_after_their_time_and_say_when(timeout_ns):
    """At most 2 s, then STOP_NOT_EFFECTIVE is somebody's word; what is owed stays owed."""
    course = Course(timeout_ns).ones()
    course.beat.zeros(course.now_ns)
    zeros = course.run(5000)
    assert zeros[0] == (500, 0.0) and zeros[-1] == (500 + timeout_ns // MS, 0.0)
    assert course.beat.gave_up_at_ns == T0 + 510 * MS + timeout_ns
    assert not course.beat.running and course.beat.is_owed


def test_a_first_zero_leaves_even_when_its_tick_is_late(armed):
    """The time to give up does not run before anything was sent."""
    armed.beat.zeros(armed.now_ns)
    armed.now_ns += 5 * S
    assert armed.run(100) == [(5500, 0.0)]
    assert armed.beat.gave_up_at_ns == T0 + 5510 * MS


def test_a_repetition_that_is_answered_takes_the_memory_of_one_that_was_not(armed):
    """`gave_up_at_ns` tells of the last repetition only."""
    armed.beat.zeros(armed.now_ns)
    armed.run(2500)
    assert armed.beat.gave_up_at_ns is not None
    armed.beat.zeros(armed.now_ns)
    armed.run(100)
    armed.fsm_zero()
    assert armed.beat.gave_up_at_ns is None and not armed.beat.is_owed


# ------------------------------------------------------------------------------------------------------ what is owed


def test_a_zero_is_owed_from_the_first_1_0_that_left_until_fsm_0():
    """Asking for 1.0 is not sending it (BEHAVIOUR, words: 0.0 owed)."""
    course = Course()
    course.beat.ones(T0)
    assert not course.beat.is_owed
    course.run(10)
    assert course.beat.is_owed and course.beat.last_one_ns == T0
    course.run(990)
    course.beat.silence()
    course.run(200)
    assert course.beat.is_owed
    course.fsm_zero()
    assert not course.beat.is_owed


def test_fsm_0_settles_nothing_while_1_0_goes_out(armed):
    """The next 1.0 would wake the robot up again."""
    armed.fsm_zero()
    assert armed.beat.is_owed and armed.beat.beat is Beat.ONE


@pytest.mark.parametrize(
    ("after_ns", "is_owed"), [(10 * MS, True), (150 * MS, True), (150 * MS + 1, False), (400 * MS, False)]
)
def test_after_silence_fsm_0_counts_only_150_ms_after_the_last_1_0(armed, after_ns, is_owed):
    """A sample that was under way may tell of the time before our 1.0 (20 Hz, manual §4.11.1)."""
    last_ns = armed.beat.last_one_ns
    armed.beat.silence()
    armed.beat.fsm_zero_seen(last_ns + after_ns)
    assert armed.beat.is_owed is is_owed


def test_fsm_0_of_before_the_zeros_or_before_the_first_of_them_left_is_no_answer(armed):
    """Only a sample that came after a 0.0 of ours ends the repetition."""
    armed.beat.zeros(armed.now_ns)
    armed.beat.fsm_zero_seen(armed.now_ns + 5 * MS)
    assert armed.beat.is_ending, "nothing has left yet"
    armed.run(10)
    armed.beat.fsm_zero_seen(armed.now_ns - 10 * MS)
    assert armed.beat.is_ending, "it came before the zeros"
    armed.beat.fsm_zero_seen(armed.now_ns - 5 * MS)
    assert armed.beat.is_ending, "it may have been under way since before our last 1.0 took effect"
    armed.run(150)
    armed.fsm_zero()
    assert not armed.beat.is_ending and not armed.beat.is_owed


def test_an_fsm_0_that_was_under_way_does_not_settle_what_a_lost_zero_left_owed(armed):
    """`/fsm_state` comes at 20 Hz: right after our 1.0 a sample may still tell of the time before it."""
    armed.ones(10)
    armed.beat.zeros(armed.now_ns)
    armed.run(40)
    armed.fsm_zero()
    assert armed.beat.is_ending and armed.beat.is_owed
    armed.run(110)
    armed.fsm_zero()
    assert not armed.beat.is_ending and not armed.beat.is_owed


def test_zeros_that_were_silenced_before_they_left_keep_nothing_owed_for_ever(armed):
    """VR mode takes the FSM in the same tick: FSM 0 seen later settles what was owed, and nobody is paused for it."""
    armed.beat.zeros(armed.now_ns)
    armed.beat.silence()
    armed.run(500)
    armed.fsm_zero()
    assert not armed.beat.is_owed


# ------------------------------------------------------------------------------------------------------ once


def test_zero_once_sends_one_zero_when_it_is_owed_and_settles_it(armed):
    """Somebody else commands the robot: one 0.0, never two setpoints in turn (BEHAVIOUR, somebody else)."""
    armed.run(20)
    armed.beat.zero_once(armed.now_ns)
    assert armed.beat.is_ending
    assert armed.run(500) == [(520, 0.0)]
    assert not armed.beat.running and not armed.beat.is_owed
    assert not armed.beat.log.view(armed.now_ns).running


def test_zero_once_sends_nothing_when_no_1_0_of_ours_was_out():
    """A 0.0 would pause the other one's robot; a 1.0 that was only asked for is taken back."""
    course = Course()
    course.beat.ones(T0)
    course.beat.zero_once(T0)
    assert not course.beat.running and course.run(500) == []


def test_zero_once_ends_a_repetition_after_one_more_zero(armed):
    """Foreign data ends a running repetition; asked for on each tick it is still one."""
    armed.beat.zeros(armed.now_ns)
    armed.run(100)
    for _ in range(30):
        armed.beat.zero_once(armed.now_ns)
        armed.run(10)
    assert [at_ms for at_ms, frame in armed.sent if frame.values == ZERO] == [500, 550, 600]


def test_zeros_that_are_asked_for_after_a_single_one_are_repeated(armed):
    """`once` is over when somebody demands the whole repetition."""
    armed.beat.zero_once(armed.now_ns)
    armed.beat.zeros(armed.now_ns)
    assert [at_ms for at_ms, _ in armed.run(200)] == [500, 550, 600, 650]


# ------------------------------------------------------------------------------------------------------ the last word


def test_the_last_word_is_0_0_for_0_3_s_and_settles_nothing(armed):
    """Often, so that a bridge keeps nothing else; it stays owed, and its end is no stop that found no hearing."""
    armed.beat.silence()
    armed.beat.last_word(armed.now_ns)
    assert armed.beat.is_last_word and armed.run(1000) == [(at_ms, 0.0) for at_ms in range(500, 800, 10)]
    assert LAST_WORD_NS == 300 * MS
    assert (armed.beat.running, armed.beat.is_last_word, armed.beat.is_owed) == (False, False, True)
    assert armed.beat.gave_up_at_ns is None


@pytest.mark.parametrize("is_estop", [False, True])
def test_the_last_word_makes_no_repetition_shorter(armed, is_estop):
    """What was begun by somebody's wish goes on as long as it would have."""
    armed.beat.zeros(armed.now_ns, is_estop=is_estop)
    armed.run(100)
    armed.beat.last_word(armed.now_ns)
    assert not armed.beat.is_last_word and armed.run(3000)[-1] == (2500, 0.0)


@pytest.mark.parametrize("how", ["zeros", "estop", "once", "ones", "fsm 0"])
def test_whatever_is_asked_for_ends_the_last_word(armed, how):
    """A release, an e-stop, foreign data, a short stall's 1.0 after all; or the robot answers."""
    armed.beat.last_word(armed.now_ns)
    armed.run(100)
    if how in {"zeros", "estop"}:
        armed.beat.zeros(armed.now_ns, is_estop=how == "estop")
        assert armed.run(4000)[-1] == (2600, 0.0)
    elif how == "once":
        armed.beat.zero_once(armed.now_ns)
        assert armed.run(500) == [(600, 0.0)] and not armed.beat.is_owed
    elif how == "ones":
        armed.beat.ones(armed.now_ns)
        assert armed.run(500)[-1] == (1050, 1.0)
    else:
        armed.now_ns += 100 * MS
        armed.fsm_zero()
        assert armed.run(500) == [] and not armed.beat.is_owed
    assert not armed.beat.is_last_word


# ------------------------------------------------------------------------------------------------------ e-stop


def test_an_estops_zeros_go_on_beside_somebody_else(armed):
    """Foreign data ends a running repetition, but not an e-stop's (BEHAVIOUR, somebody else)."""
    armed.beat.zeros(armed.now_ns, is_estop=True)
    armed.run(100)
    armed.beat.zero_once(armed.now_ns)
    assert armed.beat.is_estop and [at_ms for at_ms, _ in armed.run(150)] == [600, 650, 700]


def test_each_estop_has_its_own_two_seconds(armed):
    """A second e-stop is not cut short by the first; a plain repetition in between changes nothing."""
    armed.beat.zeros(armed.now_ns, is_estop=True)
    armed.run(1500)
    armed.beat.zeros(armed.now_ns)
    armed.run(300)
    armed.beat.zeros(armed.now_ns, is_estop=True)
    assert armed.run(5000)[-1] == (500 + 1500 + 300 + 2000, 0.0)


def test_an_estop_makes_a_running_repetition_its_own(armed):
    """A plain 0.0 was under way when the e-stop came."""
    armed.beat.zeros(armed.now_ns)
    armed.run(100)
    assert not armed.beat.is_estop
    armed.beat.zeros(armed.now_ns, is_estop=True)
    assert armed.beat.is_estop


@pytest.mark.parametrize("end", ["silence", "ones", "fsm 0", "giving up"])
def test_a_later_repetition_is_not_the_estops_any_more(armed, end):
    """The privilege of an e-stop's zeros ends with them."""
    armed.beat.zeros(armed.now_ns, is_estop=True)
    armed.run(200)
    if end == "silence":
        armed.beat.silence()
    elif end == "ones":
        armed.ones()
    elif end == "fsm 0":
        armed.fsm_zero()
    else:
        armed.run(2500)
    assert not armed.beat.is_estop
    armed.beat.zeros(armed.now_ns)
    assert not armed.beat.is_estop
