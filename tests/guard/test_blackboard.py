"""The page that daemon and guard share: everything comes back exactly, and a writer's death leaves a state that was true."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.messages.held import Held, HeldArm
from gateway.core.supervision.supervisor import State
from gateway.guard.blackboard import HEAD, KNOWN, KNOWN_AT, LATCHES, SAID, SAID_AT, SHOWN, SHOWN_AT, SIZE, Blackboard
from gateway.robot.topics import joint_command, pose_command
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
    st.builds(HeldArm, topic=st.just(joint_command(Side.LEFT)), values=sevens, rate=sevens, acceleration=sevens),
    st.builds(HeldArm, topic=st.just(pose_command(Side.LEFT)), values=sevens, rate=sixes, acceleration=sixes),
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
            right = HeldArm(topic=joint_command(Side.RIGHT), values=arm.rate, rate=arm.values, acceleration=arm.rate)
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


PARTS = {"shown": (SHOWN_AT, SHOWN.size), "said": (SAID_AT, SAID.size), "known": (KNOWN_AT, KNOWN.size)}
"""Where each part begins on the page, and the size of what is said in it [bytes]."""


def test_no_part_of_the_page_lies_over_another() -> None:
    """Two slots each."""
    ends = 8
    for begin, size in sorted(PARTS.values()):
        assert begin >= ends
        ends = begin + 2 * (HEAD.size + size)
    assert ends <= SIZE


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.99])
def test_a_slot_that_is_being_written_is_not_read(board: Blackboard, part: str, share: float) -> None:
    """Who dies in the middle of it leaves what was said before: of what is on the wire, the guard, or who knows it."""
    begin, size = PARTS[part]
    newest = slice(begin, begin + HEAD.size + size)  # the second of two is in the first slot
    for n in (1, 2):
        board.write(Held(at_ns=n, state="ACTIVE", grippers={Side.RIGHT: 0.1}))
        board.say(41, n, f"{n}" * 32, is_linked=True)
        board.know(f"{n}" * 32)
    whole = bytes(board._page[newest])
    done = int(share * len(whole))
    for rest in (bytes(len(whole) - done), b"\xff" * (len(whole) - done)):
        board._page[newest] = whole[:done] + rest
        held, said = board.read(), board.guard()
        assert held is not None and held.at_ns == (1 if part == "shown" else 2)
        assert (said.pid, said.is_linked) == (41, True)
        assert (said.looked_ns, said.zid) == ((1, "1" * 32) if part == "said" else (2, "2" * 32))
        assert board.known_zid == ("1" if part == "known" else "2") * 32
    other = Blackboard(os.dup(board.descriptor))  # who writes next, as the guard after a guard that died so
    other.write(Held(at_ns=3, state="ACTIVE"))
    other.say(42, 3, "3" * 32, is_linked=False)
    other.know("3" * 32)
    held, said = board.read(), board.guard()
    assert held is not None and held.at_ns == 3
    assert (said.pid, said.looked_ns, board.known_zid) == (42, 3, "3" * 32)
    other.close()


def test_a_reader_that_is_overtaken_again_and_again_gives_up(
    board: Blackboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It looks again at its next instant: nobody waits here."""
    board.write(Held(at_ns=1, state="ACTIVE"))
    monkeypatch.setattr("gateway.guard.blackboard.crc32", lambda _: -1)
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
    assert not board.guard().is_api_silent
    other.say(41, 12, "c4" * 16, is_linked=True, is_api_silent=True)
    assert board.guard().is_api_silent
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


WRITER = """
import os, sys
from gateway.robot.topics import joint_command, pose_command
from gateway.guard.blackboard import Blackboard
from gateway.core.messages.held import Held, HeldArm
from gateway.values import Side
board = Blackboard(int(sys.argv[1]))
n = 0
while True:
    n += 1
    row = (float(n),) * 7
    arm = HeldArm(topic=joint_command(Side.LEFT), values=row, rate=row, acceleration=row)
    board.write(Held(at_ns=n, state="ACTIVE", last_frame_ns=n, epoch=n, arms={Side.LEFT: arm}))
    board.say(n, n, f"{n:032d}", is_linked=True)
    board.know(f"{n:032d}")
    if n == 1:
        os.write(1, b"x")
"""


def test_a_writer_that_is_killed_at_any_instant_leaves_a_whole_state(board: Blackboard) -> None:
    """All numbers of what is read belong to one tick, while it writes and after its death."""
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(board.descriptor)], pass_fds=[board.descriptor], stdout=subprocess.PIPE
    )
    assert writer.stdout is not None and writer.stdout.read(1) == b"x"
    # Fields that `struct` writes into the page itself, and so sets to zero before, were seen as zero 60 times in so many.
    assert sum(_one_tick(board) for _ in range(20_000)) > 19_000
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
    said, known = board.guard(), board.known_zid
    assert said.pid == said.looked_ns == int(said.zid) > 0 and said.is_linked
    assert len(known) == 32 and int(known) > 0
    return True
