"""Brings a pair back to ACTIVE whatever was done to it: what a patient owner does, with nothing but requests.

Its request ids are in a range of their own, so that no hostile request can have had its answer before.
"""

from __future__ import annotations

import itertools
import math

from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import Reply
from gateway.errors import CODES
from gateway.messages.requests import Acquire, Enable, Move, MovePose, Recover, Request, Take
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import joint_command, pose_command
from gateway.values import ARM_DOF, Side, Vector
from tests.pair import Pair, S

OWNER = "owner"
FIRST_ID = 2**61
PATIENCE_S = 30.0
RUNNING = ("queued", "executing")
FRAMES = {side: f"{side.value}_shoulder_base" for side in Side}


class Nurse:
    """Owns the robot of a pair.

    Args:
        pair: The pair; its lease is taken by the client `OWNER`.

    Attributes:
        epoch: Of the nurse's latest lease.
        revivals: How often it had something to do.
        poses: Arms in end-effector mode.
        start: Where the end effectors were at first: x, y, z [m], qx, qy, qz, qw.
        impossible: Kinds of requests that this robot never grants.
    """

    def __init__(self, pair: Pair) -> None:
        self.pair = pair
        self.epoch = 0
        self.revivals = 0
        self._ids = itertools.count(FIRST_ID)
        pair.alive.add(OWNER)
        seen = pair.see()
        assert seen.mode is not None
        self.poses = frozenset(side for side in Side if not seen.mode.joint_mode[side.value])
        arms = seen.arms
        self.start: dict[Side, Vector] = {
            side: _inside((*arms[side.value].p_m, *arms[side.value].quat_xyzw), pair.settings.pose.reach_m)
            for side in Side
        }
        self.impossible = {"move_pose"} if not self.poses else {"move"} if len(self.poses) == len(Side) else set()
        self.impossible |= {"set_payload", "weigh"}  # no dynamics
        if not pair.settings.link.variant.has_lift:
            self.impossible |= {"drive_lift", "stop_lift", "disable_lift"}

    def topic(self, side: Side) -> str:
        """Return on which topic an arm's setpoints go out."""
        return pose_command(side) if side in self.poses else joint_command(side)

    def places(self) -> dict[Side, Vector]:
        """Return where arms are held, or hang, each in its space."""
        arms = {side: (self.pair.snapshot or self.pair.see()).arms[side.value] for side in Side}
        places: dict[Side, Vector] = {}
        for side, arm in arms.items():
            if side in self.poses:
                places[side] = (*arm.ref_p_m, *arm.ref_quat_xyzw) if arm.ref_p_m else (*arm.p_m, *arm.quat_xyzw)
            else:
                assert arm.measured is not None
                places[side] = arm.q_ref_rad or arm.measured.q_rad
        return places

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
            self.ask(Recover(reason="care"))  # with a reason: silent stop endpoints go
            self.ask(Enable(epoch=self.epoch))
            if pair.state == "HOLDING":  # held and healthy: the owner resumes by a motion, here one of no length
                self._stay()
            pair.run(0.1)

    def _stay(self) -> None:
        """Move no arm anywhere."""
        joints = {side: (0.0,) * ARM_DOF for side in Side if side not in self.poses}
        if joints:
            self.ask(Move(epoch=self.epoch, targets_rad=joints, relative=True))
        else:
            self.ask(MovePose(epoch=self.epoch, targets=self.places(), frames=FRAMES))

    def move_home(self) -> None:
        """Move both arms to the initial position, or where they were at first; fail unless they are measured there.

        Stop endpoints that were registered meanwhile are waited for: nobody checks in, and they go with the next `recover`.
        """
        while self.pair.see().endpoints:
            self.pair.run(0.1)
            self.revive()
        joints = {side: q_rad for side, q_rad in HOME_Q_RAD.items() if side not in self.poses}
        if joints:
            self._reach(Move(epoch=self.epoch, targets_rad=joints))
        if self.poses:
            self._reach(
                MovePose(epoch=self.epoch, targets={side: self.start[side] for side in self.poses}, frames=FRAMES)
            )

    def _reach(self, request: Request) -> None:
        pair = self.pair
        reply = self.ask(request)
        assert reply.refusal is None, reply.refusal
        motion_id = reply.facts["motion_id"]

        def ended() -> str:
            motions = pair.snapshot.motions if pair.snapshot else ()
            return next((m.state for m in motions if m.motion_id == motion_id and m.state not in RUNNING), "")

        pair.run_until(lambda: bool(ended()))
        assert ended() == "reached", pair.last_words()


def _inside(pose: Vector, reach_m: float) -> Vector:
    """Return a pose that is well inside the reach, in the same direction."""
    factor = min(1.0, 0.85 * reach_m / math.hypot(*pose[:3]))
    return (*(x * factor for x in pose[:3]), *pose[3:])
