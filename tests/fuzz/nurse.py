"""Brings a pair back to ACTIVE whatever was done to it: what a patient owner does, with nothing but requests.

Its request ids are in a range of their own, so that no hostile request can have had its answer before.
"""

from __future__ import annotations

import itertools

from gateway.core.events import Acquire, CommandRequested, Enable, Move, Recover, Reply, Request, Take
from gateway.errors import CODES
from gateway.robot import HOME_Q_RAD
from gateway.values import ARM_DOF, Side
from tests.pair import Pair, S

OWNER = "owner"
FIRST_ID = 2**61
PATIENCE_S = 30.0
RUNNING = ("queued", "executing")


class Nurse:
    """Owns the robot of a pair.

    Args:
        pair: The pair; its lease is taken by the client `OWNER`.

    Attributes:
        epoch: Of the nurse's latest lease.
        revivals: How often it had something to do.
    """

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.epoch = 0
        self.revivals = 0
        self._ids = itertools.count(FIRST_ID)
        pair.alive.add(OWNER)

    def ask(self, request: Request) -> Reply:
        """Ask something as the owner and return the reply of the next tick."""
        pair, request_id = self.pair, next(self._ids)
        pair.now_ns += 1  # after whatever arrived until now
        pair.receive(CommandRequested(client_id=OWNER, request_id=request_id, request=request, received_ns=pair.now_ns))
        pair.step()
        reply = next(reply for reply in reversed(pair.replies) if reply.request_id == request_id)
        assert reply.refusal is None or reply.refusal.code in CODES, reply
        return reply

    @property
    def is_well(self) -> bool:
        """Whether the owner may move the robot now."""
        return self.pair.state == "ACTIVE" and self.pair.engine.owner_id == OWNER and not self.pair.engine.latches

    def revive(self) -> None:
        """Recover, own, enable, and wait; fail when half a minute is not enough."""
        pair = self.pair
        until_ns = pair.now_ns + round(PATIENCE_S * S)
        if not self.is_well:
            self.revivals += 1
        while not self.is_well:
            assert pair.now_ns < until_ns, f"{pair.state} {pair.engine.latches} {pair.last_words()}"
            pair.robot.clear()
            if pair.engine.owner_id != OWNER:
                self.epoch = int(str(self.ask(Take(name="nurse", pid=1, reason="care")).facts["epoch"]))
            else:
                self.epoch = int(str(self.ask(Acquire(name="nurse", pid=1)).facts["epoch"]))
            self.ask(Recover())
            self.ask(Enable(epoch=self.epoch))
            if pair.state == "HOLDING":  # held and healthy: the owner resumes by a motion, here one of no length
                self.ask(Move(epoch=self.epoch, targets_rad=dict.fromkeys(Side, (0.0,) * ARM_DOF), relative=True))
            pair.run(0.1)

    def move_home(self) -> None:
        """Move both arms to the initial position; fail unless the robot is measured there."""
        pair = self.pair
        reply = self.ask(Move(epoch=self.epoch, targets_rad=HOME_Q_RAD))
        assert reply.refusal is None, reply.refusal
        motion_id = reply.facts["motion_id"]

        def ended() -> str:
            motions = pair.snapshot.motions if pair.snapshot else ()
            return next((m.state for m in motions if m.motion_id == motion_id and m.state not in RUNNING), "")

        pair.run_until(lambda: bool(ended()))
        assert ended() == "reached", pair.last_words()
