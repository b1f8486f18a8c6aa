"""Every combination of lease, state, latch, mode, parts, control mode, FSM, freshness and model: the right code and remedy.

The oracle below is data, typed from the behaviour table and the manual: for each kind of request, rows in order, and the
first that fits tells the code; none: it may pass. It shares no code with the rules that it judges.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import pytest

from gateway.codes import Code
from gateway.core.messages.events import SampleArrived
from gateway.core.requests.handler import RequestHandler
from gateway.core.supervision.lease import Lease
from gateway.core.supervision.supervisor import State
from gateway.errors import CODES
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import DriveChassis, DriveLift, Enable, Move, Request, SetGripper
from gateway.robot.topics import CURRENT_MODE, FSM_STATE
from gateway.settings.settings import LossSettings
from tests.changed import replace
from tests.core.stage import GOAL, MODE, L, R, S, Stage
from tests.thoroughness import IS_RELEASE, IS_THOROUGH, either

# ------------------------------------------------------------------------------------------------------ the situations

LEASES = ("owner", "nobody", "other", "old epoch", "left")
MODES = ("API", "VR", "unknown")
ARMS = ("both", "left", "right", "none")
"""Arms that are enabled in the robot's configuration."""
CONTROL = ("JJ", "PJ", "JP", "PP")
"""Control mode of the left and the right arm: joint or pose."""
FSM = (-1, 0, 1, 2, 3, None)
HEARD = ("all", "left arm old", "right arm old", "all old", "no transport")
GROUND = (True, False)
"""Whether chassis and lift are enabled in the configuration."""
LATCHES = (False, True)
STATES = tuple(State)
EVERY = 1 if IS_THOROUGH else 7
"""One in so many robots with a lift is met by its owner."""


@dataclass(frozen=True)
class Situation:
    """What a request meets."""

    model: str
    state: State
    mode: str
    arms: str
    control: str
    fsm: int | None
    heard: str
    ground: bool
    lease: str
    latched: bool

    @property
    def facts(self) -> frozenset[str]:
        """What the rows of the oracle are about."""
        known = _facts(self.mode, self.arms, self.control, self.fsm, self.heard, self.ground)
        return known | _own(self.state, self.lease, latched=self.latched)


@lru_cache
def _own(state: State, lease: str, *, latched: bool) -> frozenset[str]:
    """Return what is known of the gateway itself."""
    return frozenset({f"state {state}", f"lease {lease}", *(["latched"] if latched else [])})


@lru_cache(maxsize=8192)
def _facts(mode: str, arms: str, control: str, fsm: int | None, heard: str, ground: bool) -> frozenset[str]:
    """Return what is known of the robot; what was heard before another transport counts for nothing."""
    is_heard = heard != "no transport"
    found = {f"mode {mode if is_heard else 'unknown'}", f"fsm {fsm if is_heard else None}"}
    for side, letter in zip(("left", "right"), control, strict=True):
        is_on = arms in ("both", side)
        found.add(f"{side} {'on' if is_on else 'off'}")
        found.add(f"{side} {'joint' if letter == 'J' else 'pose'}")
        found.add(f"{side} {'old' if heard in ('all old', 'no transport', f'{side} arm old') else 'fresh'}")
    return frozenset(found | {f"ground {'on' if ground else 'off'}"})


# ---------------------------------------------------------------------------------------------------------- the oracle

Rows = tuple[tuple[str, str], ...]
"""(facts that must all hold, the code)."""

WHO: Rows = (
    ("lease nobody", "NOT_OWNER"),
    ("lease other", "NOT_OWNER"),
    ("lease old epoch", "LEASE_STALE"),
    ("lease left", "LEASE_LOST"),
)
WHERE: Rows = (
    ("state OFFLINE", "NO_LINK"),
    ("state STALE", "STATE_STALE"),
    ("state STOPPING", "STOPPING"),
    ("state READ_ONLY, mode unknown", "MODE_UNKNOWN"),
    ("state READ_ONLY, mode VR", "MODE_VR"),
)
API: Rows = (("mode unknown", "MODE_UNKNOWN"), ("mode VR", "MODE_VR"))


def _arm(side: str) -> Rows:
    return ((f"{side} off", "ARM_DISABLED"), (f"{side} pose", "WRONG_CONTROL_MODE"), (f"{side} old", "PART_STALE"))


def _motion(side: str, other: str) -> Rows:
    """An arm is moved; the other one is streamed, too, and must be fit to be held."""
    return (
        *WHO,
        *WHERE,
        ("state READ_ONLY", "NOT_ENABLED"),
        ("state IDLE", "NOT_ENABLED"),
        ("state ENABLING", "NOT_ENABLED"),
        ("state PAUSED", "ROBOT_PAUSED"),
        ("latched", "LATCHED"),
        *API,
        *_arm(side),
        *_arm(other),
    )


def _grip() -> Rows:
    """A gripper needs its arm streamed; with it both are, and both must be fit to be held."""
    return (*_motion("left", "right"),)


def _enable() -> Rows:
    begins = tuple(
        (f"state {state}, {facts}", code)
        for state in ("IDLE", "PAUSED")
        for facts, code in (
            *API,
            ("left off, right off", "NO_ARM_ENABLED"),
            ("fsm None", "FSM_UNKNOWN"),
            ("fsm -1", "FSM_ERROR"),
            ("fsm 1", "FSM_BUSY"),
            ("fsm 2", "FSM_BUSY"),
            ("fsm 3", "FSM_BUSY"),
            ("left on, left old", "PART_STALE"),
            ("right on, right old", "PART_STALE"),
        )
    )
    return (*WHO, *WHERE, ("state READ_ONLY", "NOT_OWNER"), ("latched", "LATCHED"), *begins)


def _drive(*more: tuple[str, str]) -> Rows:
    return (
        *WHO,
        *WHERE,
        ("state READ_ONLY", "NOT_OWNER"),
        ("state PAUSED", "ROBOT_PAUSED"),
        ("latched", "LATCHED"),
        *API,
        ("fsm 3", "FSM_BUSY"),
        *more,
    )


ORACLE: Mapping[str, Rows] = {
    "enable": _enable(),
    "left_arm": _motion("left", "right"),
    "right_arm": _motion("right", "left"),
    "left_gripper": _grip(),
    "right_gripper": _grip(),
    "chassis": _drive(("ground off", "CHASSIS_DISABLED")),
    "lift": _drive(("ground off", "LIFT_DISABLED"), ("fsm -1", "FSM_ERROR")),
}


def expected(kind: str, facts: frozenset[str]) -> str | None:
    """Return the code that a kind of request must be refused with, or None."""
    for needed, code in COMPILED[kind]:
        if needed <= facts:
            return code
    return None


COMPILED = {
    kind: tuple((frozenset(needed.split(", ")), code) for needed, code in rows) for kind, rows in ORACLE.items()
}


REQUESTS: Mapping[str, Callable[[int], Request]] = {
    "enable": lambda epoch: Enable(epoch=epoch),
    "left_arm": lambda epoch: Move(epoch=epoch, targets_rad={L: GOAL[L]}),
    "right_arm": lambda epoch: Move(epoch=epoch, targets_rad={R: GOAL[R]}),
    "left_gripper": lambda epoch: SetGripper(epoch=epoch, side=L, raw=0.5),
    "right_gripper": lambda epoch: SetGripper(epoch=epoch, side=R, raw=0.5),
    "chassis": lambda epoch: DriveChassis(epoch=epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0),
    "lift": lambda epoch: DriveLift(epoch=epoch, velocity=0.5),
}
"""What a kind stands for."""

# ----------------------------------------------------------------------------------------------------- the gateway then


class Gateway(Stage):
    """A coordinator in a state, whose lease, latches and robot can be made anything."""

    def __init__(self, state: State, model: str) -> None:
        super().__init__(state, model=model)
        self.handler = RequestHandler(self.coordinator, self.phases)
        for gripper in self.coordinator.body.grippers.values():
            gripper.start(self.now_ns, is_kept=False)
        self.leases = {name: self._lease(name) for name in LEASES}

    def _lease(self, name: str) -> tuple[Lease, str, int]:
        """Return a lease, who asks and under which epoch."""
        lease = Lease(LossSettings(), 6)
        if name == "nobody":
            return lease, "ann", 0
        epoch = lease.acquire("bob" if name == "other" else "ann", "x", 7, OnLoss.HOLD, self.now_ns)
        assert epoch == 7
        if name == "left":
            assert lease.abandon("ann", 7, self.now_ns) is None
        return lease, "ann", 6 if name == "old epoch" else 7

    def meet(self, mode: str, arms: str, control: str, fsm: int | None, heard: str, *, ground: bool) -> None:
        """Let the robot be so: whatever was heard before is too old to count."""
        self.now_ns += 4 * S
        coordinator, store = self.coordinator, self.coordinator.store
        coordinator.transport_up = heard != "no transport"
        said: dict[str, object] = {FSM_STATE: fsm}
        if mode != "unknown":
            said[CURRENT_MODE] = replace(
                MODE,
                api=mode == "API",
                arm_enabled={L: arms in ("both", "left"), R: arms in ("both", "right")},
                joint_mode={L: control[0] == "J", R: control[1] == "J"},
                chassis_enabled=ground,
                lift_enabled=ground,
            )
        self.hear_arms({"all": {L, R}, "left arm old": {R}, "right arm old": {L}}.get(heard, set()))
        for topic, value in said.items():
            if value is not None:
                store.receive(SampleArrived(topic=topic, value=value, received_ns=self.now_ns), self.now_ns)
        if not coordinator.transport_up:
            store.reset()

    def hear_arms(self, sides: set) -> None:
        """These arms' states arrive now."""
        said = self.fsm, self.mode, self.dumb, self.poses
        self.fsm, self.mode, self.dumb, self.poses = None, None, {L, R} - sides, sides
        self.hear()
        self.fsm, self.mode, self.dumb, self.poses = said


def situations(gateway: Gateway, model: str, state: State) -> Iterator[Situation]:
    """Bring the gateway into one situation after the other.

    Who asks is judged before anything that belongs to a robot, and all that a model changes is whether it has a lift. So
    the owner meets every robot in CI, by hand every seventh (no number of choices is a multiple of seven or eleven), those who
    may not ask every eleventh of these, and on the model without a lift every eleventh and none. Before a release all meet all.
    """
    robots = itertools.product(MODES, ARMS, CONTROL, FSM, HEARD, GROUND)
    for number, (mode, arms, control, fsm, heard, ground) in enumerate(robots):
        if number % (EVERY if model == "lift" else either(11, 1)):
            continue
        gateway.meet(mode, arms, control, fsm, heard, ground=ground)
        is_for_all = IS_RELEASE or (model == "lift" and number % 11 == 0)
        for lease, latched in itertools.product(LEASES if is_for_all else ("owner",), LATCHES):
            gateway.coordinator.lease = gateway.leases[lease][0]
            gateway.coordinator.supervisor.latches = {Code.ESTOP: "by hand"} if latched else {}
            yield Situation(model, state, mode, arms, control, fsm, heard, ground, lease, latched)


@pytest.mark.parametrize("model", [pytest.param("standard", marks=pytest.mark.slow), "lift"])
@pytest.mark.parametrize("state", STATES, ids=str)
def test_every_combination_is_refused_with_the_right_code_and_remedy(state: State, model: str) -> None:
    """Up to 28,800 situations a state and model, every kind of request that the model has: code, words and what to do."""
    gateway = Gateway(state, model)
    may = gateway.handler.may
    assert set(may) == set(ORACLE) - ({"lift"} if model != "lift" else set())
    seen: Counter[tuple[str, str]] = Counter()
    for situation in situations(gateway, model, state):
        facts = situation.facts
        _, client, epoch = gateway.leases[situation.lease]
        command = gateway.command(None, client, gateway.now_ns + 1)
        for kind, ask in may.items():
            refusal = ask(command, epoch, gateway.now_ns)
            code = None if refusal is None else refusal.code.value
            wanted = expected(kind, facts)
            assert code == wanted, f"{kind} in {situation}: {code}, {wanted} is right"
            if refusal is None or code is None:
                continue
            seen[kind, code] += 1
            if seen[kind, code] <= 20:  # the request itself is refused with the very same, and changes nothing
                assert refusal.message and (refusal.hint or CODES[refusal.code].hint)
                answer = gateway.handler.answer(
                    gateway.command(REQUESTS[kind](epoch), client, gateway.now_ns + 1), gateway.now_ns
                )
                assert answer == refusal and gateway.state is state
    assert {kind for kind, _ in seen} == set(may), "each kind was refused somewhere"


def test_every_row_of_the_oracle_matters() -> None:
    """No row is dead: each decides some situation. Else a typing error in the oracle would go unnoticed."""
    decided: dict[str, set[int]] = {kind: set() for kind in ORACLE}
    for state, mode, arms, control, fsm, heard, ground, lease, latched in itertools.product(
        STATES, MODES, ARMS, CONTROL, FSM, ("all", "left arm old", "right arm old", "all old"), GROUND, LEASES, LATCHES
    ):
        if lease != "owner" and (arms, control, fsm, heard) != ("both", "JJ", 0, "all"):
            continue
        facts = Situation("lift", state, mode, arms, control, fsm, heard, ground, lease, latched).facts
        for kind, rows in COMPILED.items():
            index = next((n for n, (needed, _) in enumerate(rows) if needed <= facts), None)
            if index is not None:
                decided[kind].add(index)
    for kind, rows in ORACLE.items():
        assert decided[kind] == set(range(len(rows))), [rows[n] for n in set(range(len(rows))) - decided[kind]]


def test_the_states_of_the_situations_are_all_there_are() -> None:
    """A state that is added must get its rows."""
    assert {row[0].split(", ")[0] for rows in ORACLE.values() for row in rows if row[0].startswith("state")} | {
        "state ACTIVE",
        "state HOLDING",
    } == {f"state {state}" for state in State}
