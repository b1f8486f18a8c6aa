"""The page that daemon and guard share: everything comes back exactly, and a writer's death leaves a state that was true."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway import robot
from gateway.blackboard import COUNT, COUNT_AT, LATCHES, SHOWN, SLOTS_AT, Blackboard
from gateway.core.held import Held, HeldArm
from gateway.core.supervisor import State
from gateway.values import Side


@pytest.fixture
def board() -> Iterator[Blackboard]:
    """A new page."""
    made = Blackboard.create()
    yield made
    made.close()


numbers = st.floats(allow_nan=False, allow_infinity=False)
sevens = st.tuples(*[numbers] * 7)
sixes = st.tuples(*[numbers] * 6)
arms = st.one_of(
    st.builds(HeldArm, topic=st.just(robot.joint_command(Side.LEFT)), values=sevens, rate=sevens, acceleration=sevens),
    st.builds(HeldArm, topic=st.just(robot.pose_command(Side.LEFT)), values=sevens, rate=sixes, acceleration=sixes),
)
times = st.integers(0, 2**62)
helds = st.builds(
    Held,
    at_ns=times,
    state=st.sampled_from([state.value for state in State]),
    epoch=st.integers(0, 2**53),
    beat=st.sampled_from(["silent", "one", "zero"]),
    is_owed=st.booleans(),
    is_estop=st.booleans(),
    last_frame_ns=times,
    arms=st.dictionaries(st.just(Side.LEFT), arms, max_size=1),
    grippers=st.dictionaries(st.sampled_from(Side), st.floats(0.0, 1.0)),
    has_chassis=st.booleans(),
    has_lift=st.booleans(),
    latches=st.sets(st.sampled_from(LATCHES)).map(lambda some: tuple(code.value for code in LATCHES if code in some)),
)


@given(helds)
def test_what_is_shown_is_read_to_the_last_bit(held: Held) -> None:
    """Setpoints must go on without a step; either side's arm, joints or pose."""
    board = Blackboard.create()
    try:
        arm = held.arms.get(Side.LEFT)
        if arm is not None and len(arm.rate) == 7:
            right = HeldArm(
                topic=robot.joint_command(Side.RIGHT), values=arm.rate, rate=arm.values, acceleration=arm.rate
            )
            held = Held(
                **{name: getattr(held, name) for name in held.__slots__} | {"arms": {**held.arms, Side.RIGHT: right}}
            )
        board.write(held)
        assert board.read() == held
    finally:
        board.close()


def test_nothing_is_read_before_the_first_tick(board: Blackboard) -> None:
    """And the guard has said nothing of itself; the daemon has not ended."""
    assert board.read() is None
    said = board.guard()
    assert (said.pid, said.looked_ns, said.is_linked, said.zid) == (0, 0, False, "")
    assert not board.is_ended


def test_the_newest_state_is_read(board: Blackboard) -> None:
    """Slots are written in turn."""
    for n in range(1, 6):
        board.write(Held(at_ns=n, state="IDLE"))
        held = board.read()
        assert held is not None and held.at_ns == n


def test_a_slot_that_is_being_written_is_not_read(board: Blackboard) -> None:
    """Who dies in the middle of it leaves the state before."""
    board.write(Held(at_ns=1, state="ACTIVE"))
    board.write(Held(at_ns=2, state="HOLDING"))
    SHOWN.pack_into(board._page, SLOTS_AT[1], *[3] * 4, *[255] * 8, *[math.nan] * 44)
    held = board.read()
    assert held is not None and (held.at_ns, held.state) == (2, "HOLDING")


def test_a_reader_that_is_overtaken_again_and_again_gives_up(
    board: Blackboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It looks again at its next instant: nobody waits here."""
    board.write(Held(at_ns=1, state="ACTIVE"))
    counts = iter(range(1, 100))

    class Racing:
        @staticmethod
        def unpack_from(page: object, at: int) -> tuple[int]:
            return (next(counts),)

    monkeypatch.setattr("gateway.blackboard.COUNT", Racing)
    assert board.read() is None


def test_a_system_without_anonymous_files_has_no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Told like any other want of memory: the daemon goes on without a guard."""
    monkeypatch.delattr(os, "memfd_create")
    with pytest.raises(OSError, match="anonymous"):
        Blackboard.create()


def test_both_sides_see_each_other(board: Blackboard) -> None:
    """Another mapping of the same file: what the guard says, and that the daemon ends."""
    other = Blackboard(os.dup(board.descriptor))
    board.write(Held(at_ns=7, state="IDLE"))
    other.say(41, 12, "c4" * 16, is_linked=True)
    assert other.known_zid == ""
    board.know("c4" * 16)
    board.end()
    assert other.known_zid == "c4" * 16
    said = board.guard()
    assert (said.pid, said.looked_ns, said.is_linked, said.zid) == (41, 12, True, "c4" * 16)
    assert other.is_ended
    held = other.read()
    assert held is not None and held.at_ns == 7
    other.close()
    assert COUNT.unpack_from(board._page, COUNT_AT) == (1,)


WRITER = """
import os, sys
from gateway import robot
from gateway.blackboard import Blackboard
from gateway.core.held import Held, HeldArm
from gateway.values import Side
board = Blackboard(int(sys.argv[1]))
n = 0
while True:
    n += 1
    row = (float(n),) * 7
    arm = HeldArm(topic=robot.joint_command(Side.LEFT), values=row, rate=row, acceleration=row)
    board.write(Held(at_ns=n, state="ACTIVE", last_frame_ns=n, epoch=n, arms={Side.LEFT: arm}))
    if n == 1:
        os.write(1, b"x")
"""


def test_a_writer_that_is_killed_at_any_instant_leaves_a_whole_state(board: Blackboard) -> None:
    """All numbers of what is read belong to one tick, while it writes and after its death."""
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(board.descriptor)], pass_fds=[board.descriptor], stdout=subprocess.PIPE
    )
    assert writer.stdout is not None and writer.stdout.read(1) == b"x"
    for _ in range(300):
        _one_tick(board)
    writer.send_signal(signal.SIGKILL)
    writer.wait(10.0)
    writer.stdout.close()
    assert _one_tick(board)


def _one_tick(board: Blackboard) -> bool:
    held = board.read()
    if held is None:
        return False
    arm = held.arms[Side.LEFT]
    assert {held.at_ns, held.last_frame_ns, held.epoch} == {held.at_ns}
    assert {*arm.values, *arm.rate, *arm.acceleration} == {float(held.at_ns)}
    return True
