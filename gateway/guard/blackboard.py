"""The memory that a daemon and its guard share: what is on the wire, tick by tick, and how the guard is.

One page of anonymous memory, handed to the guard as an open file: it has no name that could be left behind, and lives as
long as one of the two does. Each side writes its own part:

    daemon   what is on the wire (two slots, written in turn), that it ends by itself, and which session is its guard's
    guard    its process id, its zenoh id, whether it reaches the robot, whether the daemon's API answers it, and when it
             last looked

What either says is a record of two slots, written in turn, each with its number and a checksum of both: whoever dies in
the middle of one, or reads it meanwhile, finds the other, which is one older and whole. So a reader gets what was true,
without a lock and without waiting for anybody. A number of eight bytes alone would not do: `struct` sets a field to zero
before it writes it, and some processors show what was written later first. 5 µs a tick.

It knows the shape of `core/messages/held.py` and nothing of processes.
"""

from __future__ import annotations

import mmap
import os
import struct
from typing import Any
from zlib import crc32

from msgspec import Struct

from gateway.codes import Code
from gateway.core.messages.held import Held, HeldArm
from gateway.core.supervision.supervisor import LATCH_CODE, State
from gateway.robot.topics import joint_command, pose_command
from gateway.values import ARM_DOF, Side, Vector

__all__ = ["Blackboard", "GuardSaid"]

SIZE = 4096
ENDED = 0
"""One byte: the daemon ends by itself."""
CHECKSUM, COUNT = struct.Struct("=L"), struct.Struct("=Q")
HEAD = struct.Struct("=LQ")
"""Of a slot: checksum of all that follows; how many were written with this one."""
KNOWN = struct.Struct("33p")
KNOWN_AT = 64
"""Zenoh id of the guard's session that the daemon knows to be a friend's."""
SAID = struct.Struct("=QqBB33p")
SAID_AT = 256
"""The guard: process id, last look [ns], linked, API silent, zenoh id."""
SHOWN = struct.Struct("=qqqQBBBBBBBB21d21d2d")
SHOWN_AT = 1024
"""Tick [ns], newest setpoint [ns], epoch, latches; state, beat, flags; per side the space and whether the gripper is
streamed, one spare; per side values, rate and acceleration; per side the gripper's value."""

STATES = tuple(state.value for state in State)
BEATS = ("silent", "one", "zero")
LATCHES = tuple(dict.fromkeys((*LATCH_CODE.values(), Code.STATE_LOST)))
"""What can be latched, a bit each."""
OWED, ESTOP, CHASSIS, LIFT = 1, 2, 4, 8
OFF, JOINT, POSE = 0, 1, 2
NOTHING: Vector = (0.0,) * (3 * ARM_DOF)
NOTHING_SAID = (0, 0, False, False, b"")
TRIES = 5
"""A reader that finds neither slot whole so often gives up until its next look: the writer has written none, or races."""

SIDES = tuple(Side)
TOPICS = {
    JOINT: {side: joint_command(side) for side in Side},
    POSE: {side: pose_command(side) for side in Side},
}
SPACES = {topic: space for space, topics in TOPICS.items() for topic in topics.values()}
WIDTHS = {JOINT: ARM_DOF, POSE: 6}
"""Length of rate and acceleration: one per joint, or linear and angular."""


class GuardSaid(Struct, frozen=True, kw_only=True):
    """What the guard says of itself; all zero before it has.

    Attributes:
        pid: Its process id.
        looked_ns: When it last looked [ns].
        is_linked: Whether it reaches the robot's router.
        zid: Its zenoh id on the robot plane; empty before it has one.
        is_api_silent: Whether the daemon's API has not answered it for long.
    """

    pid: int
    looked_ns: int
    is_linked: bool
    zid: str
    is_api_silent: bool


class Record:
    """What one process says and the other one reads.

    Its two slots begin at `at` [bytes].
    """

    def __init__(self, page: mmap.mmap, at: int, body: struct.Struct) -> None:
        self._page, self._body = page, body
        self._slots = tuple(slice(begin, begin + HEAD.size + body.size) for begin in (at, at + HEAD.size + body.size))
        self._count = self._newest()[0]

    def write(self, *values: object) -> None:
        """Say what becomes the newest."""
        self._count += 1
        said = COUNT.pack(self._count) + self._body.pack(*values)
        self._page[self._slots[self._count & 1]] = CHECKSUM.pack(crc32(said)) + said

    def read(self) -> tuple[Any, ...] | None:
        """Return the newest; None where nothing was said, or the writer is faster than one can read."""
        for _ in range(TRIES):
            count, said = self._newest()
            if count:
                return self._body.unpack_from(said, HEAD.size)
        return None

    def _newest(self) -> tuple[int, bytes]:
        """Return the number and the bytes of the newest slot that is whole; 0 where none is."""
        newest = (0, b"")
        for slot in self._slots:
            said = self._page[slot]
            checksum, count = HEAD.unpack_from(said)
            if count > newest[0] and checksum == crc32(said[CHECKSUM.size :]):
                newest = (count, said)
        return newest


class Blackboard:
    """The shared page.

    Args:
        descriptor: Open file of at least `SIZE` bytes.

    Attributes:
        descriptor: The file, to be handed to the guard.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._page = mmap.mmap(descriptor, SIZE)
        self._known = Record(self._page, KNOWN_AT, KNOWN)
        self._said = Record(self._page, SAID_AT, SAID)
        self._shown = Record(self._page, SHOWN_AT, SHOWN)

    @classmethod
    def create(cls) -> Blackboard:
        """Make a new page.

        Raises:
            OSError: The kernel has no such memory to give.
        """
        try:
            descriptor = os.memfd_create("ta2-guard", os.MFD_CLOEXEC)
        except AttributeError as error:
            raise OSError("this system has no anonymous files") from error
        os.ftruncate(descriptor, SIZE)
        return cls(descriptor)

    def close(self) -> None:
        """Let the page go; the other process keeps it."""
        self._page.close()
        os.close(self.descriptor)

    # ------------------------------------------------------------------------------------------------ the daemon's part

    def write(self, held: Held) -> None:
        """Show what is on the wire."""
        left, right = [held.arms.get(side) for side in SIDES]
        flags = OWED * held.is_owed | ESTOP * held.is_estop | CHASSIS * held.has_chassis | LIFT * held.has_lift
        grippers = [held.grippers.get(side) for side in SIDES]
        self._shown.write(
            held.at_ns,
            held.last_frame_ns,
            held.epoch,
            sum(1 << bit for bit, code in enumerate(LATCHES) if code in held.latches),
            STATES.index(held.state),
            BEATS.index(held.beat),
            flags,
            OFF if left is None else SPACES[left.topic],
            OFF if right is None else SPACES[right.topic],
            grippers[0] is not None,
            grippers[1] is not None,
            0,
            *_numbers(left),
            *_numbers(right),
            grippers[0] or 0.0,
            grippers[1] or 0.0,
        )

    def end(self) -> None:
        """Say that the daemon ends by itself: nobody needs to go on."""
        self._page[ENDED] = 1

    def guard(self) -> GuardSaid:
        """Return what the guard said of itself."""
        pid, looked_ns, is_linked, is_silent, zid = self._said.read() or NOTHING_SAID
        return GuardSaid(
            pid=pid,
            looked_ns=looked_ns,
            is_linked=bool(is_linked),
            zid=zid.decode("ascii", "replace"),
            is_api_silent=bool(is_silent),
        )

    def know(self, zid: str) -> None:
        """Tell the guard that the daemon knows this session of it, and takes it for no other gateway."""
        self._known.write(zid.encode("ascii", "replace"))

    # ------------------------------------------------------------------------------------------------ the guard's part

    @property
    def known_zid(self) -> str:
        """Zenoh id of the guard's session that the daemon knows; empty before it knows one."""
        (zid,) = self._known.read() or (b"",)
        return bytes(zid).decode("ascii", "replace")

    @property
    def is_ended(self) -> bool:
        """Whether the daemon said that it ends by itself."""
        return bool(self._page[ENDED])

    def read(self) -> Held | None:
        """Return what the daemon showed last; None before its first tick, or when it is writing faster than one can read."""
        numbers = self._shown.read()
        return None if numbers is None else _held(numbers)

    def say(self, pid: int, looked_ns: int, zid: str, *, is_linked: bool, is_api_silent: bool = False) -> None:
        """Tell the daemon how the guard is, and how it finds the daemon."""
        self._said.write(pid, looked_ns, is_linked, is_api_silent, zid.encode("ascii", "replace"))


def _numbers(arm: HeldArm | None) -> Vector:
    if arm is None:
        return NOTHING
    if len(arm.rate) == ARM_DOF:
        return (*arm.values, *arm.rate, *arm.acceleration)
    return (*arm.values, *arm.rate, 0.0, *arm.acceleration, 0.0)


def _held(numbers: tuple[float, ...]) -> Held:
    at_ns, last_frame_ns, epoch, latched, state, beat, flags = (int(number) for number in numbers[:7])
    spaces, has_gripper, rest = numbers[7:9], numbers[9:11], numbers[12:]
    arms = {}
    for n, side in enumerate(SIDES):
        space = int(spaces[n])
        if space != OFF:
            row = rest[3 * ARM_DOF * n : 3 * ARM_DOF * (n + 1)]
            width = WIDTHS[space]
            arms[side] = HeldArm(
                topic=TOPICS[space][side],
                values=row[:ARM_DOF],
                rate=row[ARM_DOF : ARM_DOF + width],
                acceleration=row[2 * ARM_DOF : 2 * ARM_DOF + width],
            )
    values = rest[6 * ARM_DOF :]
    return Held(
        at_ns=at_ns,
        state=STATES[state],
        epoch=epoch,
        beat=BEATS[beat],
        is_owed=bool(flags & OWED),
        is_estop=bool(flags & ESTOP),
        last_frame_ns=last_frame_ns,
        arms=arms,
        grippers={side: values[n] for n, side in enumerate(SIDES) if has_gripper[n]},
        has_chassis=bool(flags & CHASSIS),
        has_lift=bool(flags & LIFT),
        latches=tuple(code.value for bit, code in enumerate(LATCHES) if latched >> bit & 1),
    )
