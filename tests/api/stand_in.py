"""A scripted engine: small, predictable, and on the daemon's side of the local plane. For tests of plane and client.

It keeps the promises of the real one that clients lean on (one reply per request, the same reply for the same number,
snapshots after replies) and nothing else: no physics, no limits, no robot.
"""

from __future__ import annotations

from msgspec.structs import replace

from gateway.core.messages import events, outputs
from gateway.errors import Code, Refusal
from gateway.messages import incoming
from gateway.messages.snapshot import (
    ArmView,
    ChassisView,
    EnableView,
    GripView,
    GuardView,
    LeaseView,
    LinkView,
    LoopView,
    ModelView,
    ModeView,
    MotionView,
    MotorView,
    OthersView,
    OtherView,
    Snapshot,
    SpacingView,
    StreamView,
    TargetView,
    TopicView,
)

TICK_NS = 10_000_000
START_Q = (0.1, 0.5, -0.3, 0.9, 0.2, -0.1, 0.3)
ENABLE_TICKS = 5
MOVE_TICKS = 20
BRAKE_TICKS = 4
BEATING = ("ENABLING", "ACTIVE", "HOLDING", "STOPPING")
"""States in which the heartbeat goes on."""


def a_snapshot(seq=1, at_ns=1000, **changes):
    """Return a full snapshot of a robot at rest in READ_ONLY."""
    motors = MotorView(q_rad=START_Q, dq_radps=(0.0,) * 7, tau_nm=(0.5,) * 7, stamp_ns=17, age_ns=2_000_000)
    arm = ArmView(
        measured=motors,
        p_m=(0.3, 0.1, -0.2),
        quat_xyzw=(0.0, 0.0, 0.0, 1.0),
        pose_age_ns=3_000_000,
        q_ref_rad=(),
        dq_ref_radps=(),
        streaming=False,
        tracking_rad=None,
        space="joint",
        ref_p_m=(),
        ref_quat_xyzw=(),
        ref_v_mps=(),
        ref_w_radps=(),
        tracking_m=None,
        model=ModelView(
            state="agrees", reason="0.20 mm apart", pairs=70, position_m=2e-4, angle_rad=1e-3, lag_ns=4_000_000
        ),
    )
    gripper = MotorView(q_rad=(0.2,), dq_radps=(0.0,), tau_nm=(0.1,), stamp_ns=17, age_ns=2_000_000)
    snapshot = Snapshot(
        seq=seq,
        at_ns=at_ns,
        state="READ_ONLY",
        shown="READ_ONLY",
        latches={},
        link=LinkView(up=True, router_zid="abc", fresh=True, age_ns=2_000_000),
        fsm=0,
        mode=ModeView(
            api=True,
            joint_mode={"left": True, "right": True},
            arm_enabled={"left": True, "right": True},
            chassis_enabled=True,
            lift_enabled=False,
            collision_check=False,
            age_ns=400_000_000,
        ),
        lease=LeaseView(
            owned=False,
            name="",
            client_id="",
            pid=0,
            epoch=0,
            since_ns=0,
            on_loss="",
            lost_ns=None,
            free_in_ns=None,
            down_in_ns=None,
        ),
        arms={"left": arm, "right": arm},
        grippers={"left": gripper, "right": None},
        chassis=None,
        topics={
            "/fsm_state": TopicView(
                age_ns=20_000_000, rate_hz=20.0, worst_gap_ns=60_000_000, count=7, duplicates=0, refused=0
            ),
            "/chassis/joint_states": TopicView(
                age_ns=None, rate_hz=0.0, worst_gap_ns=0, count=0, duplicates=0, refused=0
            ),
        },
        streams={"/api/fsm/enable": StreamView(running=True, sent=3, rate_hz=20.0, worst_gap_ns=51_000_000)},
        motions=(),
        targets=(),
        grips={
            side: GripView(streaming=False, input_ratio=None, torque_nm=None, holding=None)
            for side in ("left", "right")
        },
        drive=ChassisView(
            driven=False,
            drive_id=0,
            code="",
            wanted_mps=(0.0, 0.0),
            wanted_radps=0.0,
            commanded_mps=(0.0, 0.0),
            commanded_radps=0.0,
            left_ns=None,
        ),
        lift=None,
        enable=EnableView(attempt=0, outcome="none", code="", message=""),
        loop=LoopView(ticks=5, skipped=1, late_ns=30_000, worst_late_ns=900_000),
        findings=(),
        refusals={},
        guard=GuardView(expected=True, pid=43, linked=True, lost=0, earlier_holds=False),
        others=OthersView(
            zid="a1",
            armed=False,
            seen=(
                OtherView(kind="gateway", topic="", zid="b2", link="", since_ns=7, last_ns=None, count=0, armed=False),
            ),
        ),
        spacing=SpacingView(
            on=True, why="", gap_m=0.143, first="left_palm", second="right_forearm", margin_m=0.02, held=()
        ),
        slowing={},
        endpoints=(),
    )
    return replace(snapshot, **changes)


class ScriptedEngine:
    """Answers clients of a plane by simple rules; tests change the rules by setting attributes.

    Attributes:
        requests: Every request that was carried out, with its client, in order.
        refusals: Type of a request -> refusal to give to the next one of it.
        mute: Types of requests that are carried out and never answered.
        enable_outcome: `ok`, or the code with which enabling fails.
        motion_end: `reached`, or the code with which motions are aborted.
    """

    def __init__(self, plane, now_ns):
        self.plane = plane
        self.now_ns = now_ns
        self.requests = []
        self.refusals = {}
        self.mute = set()
        self.enable_outcome = "ok"
        self.motion_end = "reached"
        self.targets = []
        self.seen = {}
        self.gone = []
        self.notices = []
        self.snapshot = a_snapshot(seq=0)
        self.frozen = False
        self._answered = {}
        self._countdowns = []
        self._motion_id = 0
        self._stream_id = 0

    # ------------------------------------------------------------------------------------------------ the loop

    def tick(self):
        """Do what a loop does in one tick; nothing while frozen."""
        if self.frozen:
            return
        replies = []
        for event in self.plane.poll():
            if isinstance(event, events.CommandRequested):
                reply = self._reply(event)
                if reply is not None:
                    replies.append(reply)
            elif isinstance(event, events.TargetArrived):
                self._target(event)
            elif isinstance(event, events.ClientSeen):
                self.seen.setdefault(event.client_id, []).append(event.at_ns)
            elif isinstance(event, events.ClientGone):
                self.gone.append(event.client_id)
        for countdown in list(self._countdowns):
            countdown[0] -= 1
            if countdown[0] <= 0:
                self._countdowns.remove(countdown)
                countdown[1]()
        notices, self.notices = self.notices, []
        self.plane.heed(self.heeded)
        self.plane.send(replies, notices)
        self.snapshot = replace(self.snapshot, seq=self.snapshot.seq + 1, at_ns=self.now_ns())
        self.plane.publish_snapshot(self.snapshot)

    def later(self, ticks, action):
        """Do something some ticks from now."""
        self._countdowns.append([ticks, action])

    def show(self, **changes):
        """Change what the snapshot says."""
        self.snapshot = replace(self.snapshot, **changes)
        if "state" in changes:
            heartbeat = replace(self.snapshot.streams["/api/fsm/enable"], running=changes["state"] in BEATING)
            self.snapshot = replace(self.snapshot, streams={"/api/fsm/enable": heartbeat})
        if "state" in changes and "shown" not in changes:
            self.snapshot = replace(self.snapshot, shown="FAULT" if self.snapshot.latches else self.snapshot.state)

    def names(self):
        """Return the types of the requests that were carried out, in order."""
        return [type(request).__name__ for _, request in self.requests]

    def _reply(self, event):
        key = (event.client_id, event.request_id)
        if key not in self._answered:
            refusal = self.refusals.pop(type(event.request), None)
            if refusal is None:
                self.requests.append((event.client_id, event.request))
                refusal_or_facts = getattr(self, f"_on_{type(event.request).__name__.lower()}")(event)
            else:
                refusal_or_facts = refusal
            answer = (
                {"refusal": refusal_or_facts}
                if isinstance(refusal_or_facts, Refusal)
                else {"facts": refusal_or_facts or {}}
            )
            self._answered[key] = outputs.Reply(client_id=event.client_id, request_id=event.request_id, **answer)
            if type(event.request) in self.mute:
                return None
        return self._answered[key]

    # ------------------------------------------------------------------------------------------------ the lease

    @property
    def heeded(self):
        """The owner, lost or not."""
        return frozenset({self.snapshot.lease.client_id} - {""})

    def _owns(self, event):
        lease = self.snapshot.lease
        if lease.owned and lease.client_id == event.client_id and lease.epoch == event.request.epoch:
            return None
        return Refusal(code=Code.LEASE_STALE, message=f"epoch {event.request.epoch} is over")

    def _give(self, event):
        request = event.request
        lease = replace(
            self.snapshot.lease,
            owned=True,
            name=request.name,
            client_id=event.client_id,
            pid=request.pid,
            epoch=self.snapshot.lease.epoch + 1,
            since_ns=self.now_ns(),
            on_loss=request.on_loss.value,
        )
        self.show(lease=lease)
        if self.snapshot.state == "READ_ONLY":
            self.show(state="IDLE")
        return {"epoch": lease.epoch}

    def _on_acquire(self, event):
        lease = self.snapshot.lease
        if lease.owned and lease.client_id != event.client_id:
            return Refusal(code=Code.LEASE_HELD, message=f"{lease.name!r} (pid {lease.pid}) owns the robot")
        return self._give(event)

    def _on_take(self, event):
        moving = self.snapshot.state == "ACTIVE"
        facts = self._give(event)
        if moving:
            self.brake("HOLDING")
        return facts

    def free(self):
        """Let nobody own the robot."""
        self.show(lease=replace(self.snapshot.lease, owned=False, name="", client_id="", pid=0))

    def _on_release(self, event):
        refusal = self._owns(event)
        if refusal is None:
            self.free()
            self.brake("READ_ONLY")
        return refusal

    def _on_abandon(self, event):
        refusal = self._owns(event)
        if refusal is None:
            self.show(lease=replace(self.snapshot.lease, lost_ns=1, free_in_ns=10**10, down_in_ns=6 * 10**10))
            if self.snapshot.state == "ACTIVE":
                self.brake("HOLDING")
        return refusal

    # ------------------------------------------------------------------------------------------------ enabling

    def _on_enable(self, event):
        refusal = self._owns(event)
        if refusal is not None:
            return refusal
        if self.snapshot.state == "ACTIVE":
            return {"attempt": self.snapshot.enable.attempt, "outcome": "ok"}
        attempt = self.snapshot.enable.attempt + 1
        self.show(state="ENABLING", enable=EnableView(attempt=attempt, outcome="running", code="", message=""))
        self.later(ENABLE_TICKS, lambda: self._enabled(attempt))
        return {"attempt": attempt, "outcome": "running"}

    def _enabled(self, attempt):
        if self.enable_outcome == "ok":
            self.show(
                state="ACTIVE",
                fsm=2,
                arms={side: self._arm(START_Q) for side in ("left", "right")},
                enable=EnableView(attempt=attempt, outcome="ok", code="", message=""),
            )
        else:
            failed = EnableView(
                attempt=attempt, outcome="failed", code=self.enable_outcome, message="READY was not seen"
            )
            self.show(state="IDLE", enable=failed)

    def _on_disable(self, event):
        refusal = self._owns(event)
        if refusal is None:
            self.brake("IDLE")
        return refusal

    def _arm(self, q_ref, speed=0.0):
        return replace(
            self.snapshot.arms["left"],
            streaming=True,
            q_ref_rad=tuple(q_ref),
            dq_ref_radps=(speed,) * 7,
            tracking_rad=0.01,
        )

    def brake(self, then):
        """Let the arms run on for some ticks, then rest in a state."""
        streaming = self.snapshot.state in ("ACTIVE", "HOLDING")
        if streaming:
            self.show(state="STOPPING", arms={side: self._arm(START_Q, 0.2) for side in ("left", "right")})
        self.end_motions("cancelled", "CANCELLED")

        def rest():
            off = replace(self.snapshot.arms["left"], streaming=False, q_ref_rad=(), dq_ref_radps=(), tracking_rad=None)
            arm = self._arm(START_Q) if then == "HOLDING" else off
            self.show(state=then, arms={"left": arm, "right": arm})

        self.later(BRAKE_TICKS if streaming else 1, rest)

    # ------------------------------------------------------------------------------------------------ motions

    def _on_move(self, event):
        clipped = {"left": [3]} if event.request.on_limit is incoming.OnLimit.CLIP else {}
        return self._begin(event, event.request.targets_rad, {"clipped": clipped})

    def _on_movepose(self, event):
        return self._begin(event, event.request.targets, {"clipped": {}})

    def _on_follow(self, event):
        goals = {side: points[-1] for side, points in event.request.points.items()}
        return self._begin(event, goals, {"skipped": 0, "moved": event.chunk.moved})

    def _begin(self, event, goals, facts):
        refusal = self._owns(event)
        if refusal is not None:
            return refusal
        if self.snapshot.state != "ACTIVE":
            return Refusal(code=Code.NOT_ENABLED, message="the arms are not enabled")
        self.end_motions("superseded", "SUPERSEDED")
        self._motion_id += 1
        motion = MotionView(
            motion_id=self._motion_id,
            sides=tuple(side.value for side in goals),
            state="executing",
            progress=0.5,
            error_rad=0.2,
            duration_ns=MOVE_TICKS * TICK_NS,
            code="",
            message="",
            space="joint",
            error_m=None,
        )
        self.show(motions=(*self.snapshot.motions, motion))
        self.later(MOVE_TICKS, lambda: self._moved(motion.motion_id))
        return {
            "motion_id": motion.motion_id,
            "duration_ns": motion.duration_ns,
            "q_rad": {side.value: list(q) for side, q in goals.items()},
            **facts,
        }

    def _moved(self, motion_id):
        if self.motion_end == "reached":
            self._end(motion_id, "reached", "", error_rad=0.004, progress=1.0)
        else:
            self._end(motion_id, "aborted", self.motion_end)

    def _end(self, motion_id, state, code, **changes):
        self.show(
            motions=tuple(
                replace(motion, state=state, code=code, message=f"it was {state}" if code else "", **changes)
                if motion.motion_id == motion_id and motion.state == "executing"
                else motion
                for motion in self.snapshot.motions
            )
        )

    def end_motions(self, state, code):
        """End all running motions and streams."""
        for motion in self.snapshot.motions:
            self._end(motion.motion_id, state, code)
        self.show(targets=tuple(replace(t, open=False, code=t.code or code) for t in self.snapshot.targets))

    def _on_cancel(self, event):
        refusal = self._owns(event)
        if refusal is not None:
            return refusal
        self._end(event.request.motion_id, "cancelled", "CANCELLED")
        self.show(arms={side: self._arm(START_Q, 0.2) for side in ("left", "right")})
        self.later(BRAKE_TICKS, lambda: self.show(arms={side: self._arm(START_Q) for side in ("left", "right")}))
        return {"state": "cancelled"}

    def _on_hold(self, event):
        refusal = self._owns(event)
        if refusal is None:
            self.end_motions("cancelled", "CANCELLED")
        return refusal

    # ------------------------------------------------------------------------------------------------ streams

    def _on_openstream(self, event):
        refusal = self._owns(event)
        if refusal is not None:
            return refusal
        self._stream_id += 1
        stream = TargetView(
            stream_id=self._stream_id,
            side=event.request.side.value,
            open=True,
            code="",
            seq=0,
            refused=0,
            refusal_code="",
            refusal_message="",
            limited=False,
            space="joint",
        )
        self.show(targets=(*self.snapshot.targets, stream))
        return {"stream_id": stream.stream_id, "values": list(START_Q)}

    def _on_closestream(self, event):
        refusal = self._owns(event)
        if refusal is None:
            self.end_streams("CANCELLED")
        return refusal

    def end_streams(self, code):
        """End the open streams with a code."""
        self.show(targets=tuple(replace(t, open=False, code=t.code or code) for t in self.snapshot.targets))

    def refuse_target(self, code, message):
        """Refuse the last target of every open stream."""
        self.show(
            targets=tuple(
                replace(t, refused=t.refused + 1, refusal_code=code, refusal_message=message) if t.open else t
                for t in self.snapshot.targets
            )
        )

    def _target(self, event):
        self.targets.append(event)
        self.show(
            targets=tuple(
                replace(t, seq=event.seq, lead_ns=self.now_ns() - event.received_ns)
                if t.stream_id == event.stream_id and t.open
                else t
                for t in self.snapshot.targets
            )
        )

    # ------------------------------------------------------------------------------------------------ stopping

    def _on_stop(self, event):
        lease = self.snapshot.lease
        if not (lease.owned and lease.client_id == event.client_id):
            self.show(latches={"STOPPED_BY_OTHER": f"stop(): {event.request.reason}"})
        self.end_motions("aborted", "STOPPED")
        self.show(state="HOLDING" if self.snapshot.state == "ACTIVE" else self.snapshot.state)
        return {"stop_undelivered": not self.snapshot.link.up}

    def _on_estop(self, event):
        self.show(latches={"ESTOP": f"estop(): {event.request.reason}"})
        self.end_motions("aborted", "ESTOP")
        self.show(state="IDLE", fsm=0)
        return {"stop_undelivered": not self.snapshot.link.up}

    def _on_recover(self, event):
        self.show(latches={})
        self.show(state=self.snapshot.state)
        return {"cleared": []}
