"""Permits: who may do what now, and in which order reasons against it are found."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from gateway.core.messages.events import CommandRequested, GuardSeen
from gateway.core.messages.sightings import ForeignData, Gateway, Means, Writer
from gateway.core.motion.motion import plan
from gateway.core.others.other_robots import other_namespace, two_robots
from gateway.core.requests.authorisation import REFUSAL_TEXT, Authorisation
from gateway.core.supervision.supervisor import TABLE, State, Trigger
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import Enable, Move, Recover
from gateway.robot.topics import FSM_ENABLE, joint_command
from gateway.values import FsmState, Role, Side, Space
from tests.changed import replace
from tests.core.stage import GOAL, MIDDLE, MS, L, R, Stage

MOVE = Move(epoch=1, targets_rad=GOAL)
LATCHED = {Code.TRACKING_ERROR: "blocked"}


class Scene(Stage):
    """A stage with somebody who gives permits."""

    def __init__(self, state: State = State.ACTIVE, **how: object) -> None:
        super().__init__(state, **how)
        self.authorisation = Authorisation(self.coordinator, self.phases.starting)

    def motion(
        self,
        sides: Sequence[Side] = (L,),
        client: str = "ann",
        epoch: int | None = None,
        received_ns: int | None = None,
    ) -> Refusal | None:
        """Ask whether these arms may be moved."""
        command = self.command(MOVE, client, received_ns)
        return self.authorisation.motion(command, self.epoch if epoch is None else epoch, sides, self.now_ns)

    def why_not(self, sides: Sequence[Side] = (L,), **who: object) -> Refusal:
        """These arms may not be moved; return why."""
        refusal = self.motion(sides, **who)
        assert refusal is not None
        return refusal

    def in_motion(self) -> None:
        """The left arm is on its way."""
        arm = self.coordinator.body.arms[L]
        arm.follow_path(plan({L: arm.reference}, {L: GOAL[L]})[L], self.epoch)
        self.run(30)
        assert not self.coordinator.body.is_at_rest


# ------------------------------------------------------------------------------------------------ lease and stops


def test_the_owner_with_the_current_epoch_may():
    """And nobody else, under no other epoch; the daemon's end comes before everything."""
    scene = Scene()
    assert scene.authorisation.owner(scene.command(MOVE), scene.epoch) is None
    for client, epoch, code in (("bob", 1, Code.NOT_OWNER), ("ann", 0, Code.NOT_OWNER), ("ann", 2, Code.NOT_OWNER)):
        refusal = scene.authorisation.owner(scene.command(MOVE, client), epoch)
        assert refusal is not None and refusal.code is code
    scene.coordinator.is_exiting = True
    refusal = scene.authorisation.owner(scene.command(MOVE, "bob"), scene.epoch)
    assert refusal is not None and refusal.code is Code.EXITING


def test_what_arrived_before_a_stop_or_with_it_came_before_it():
    """Without a stop nothing did; an earlier stop that is noted later changes nothing."""
    scene = Scene()
    now_ns = scene.now_ns
    assert not scene.authorisation.is_before_stop(0)
    scene.authorisation.note_stop(now_ns)
    scene.authorisation.note_stop(now_ns - 5)
    assert [scene.authorisation.is_before_stop(now_ns + late_ns) for late_ns in (-1, 0, 1)] == [True, True, False]


def test_a_request_from_before_a_stop_is_refused_and_a_later_one_is_not():
    """It must not undo the stop (DESIGN §8.5)."""
    scene = Scene()
    scene.authorisation.note_stop(scene.now_ns)
    refusal = scene.authorisation.after_stop(scene.command(MOVE))
    assert refusal is not None and refusal.code is Code.STOPPED
    assert scene.authorisation.after_stop(scene.command(MOVE, received_ns=scene.now_ns + 1)) is None


# ------------------------------------------------------------------------------------------------ state


def test_every_refusal_of_the_table_has_words():
    """A code that the table may give and nobody can explain would end as a bug at the user's."""
    codes = {cell.refuse for row in TABLE.values() for cell in row.values() if cell.refuse is not None}
    assert codes == set(REFUSAL_TEXT)


@pytest.mark.parametrize(
    ("state", "code"),
    [
        (State.OFFLINE, Code.NO_LINK),
        (State.IDLE, Code.NOT_ENABLED),
        (State.ENABLING, Code.NOT_ENABLED),
        (State.ACTIVE, None),
        (State.HOLDING, None),
        (State.PAUSED, Code.ROBOT_PAUSED),
        (State.STOPPING, Code.STOPPING),
        (State.STALE, Code.STATE_STALE),
    ],
)
def test_the_table_says_in_which_states_arms_may_move(state, code):
    """With its code and the words for it."""
    scene = Scene(state)
    refusal = scene.authorisation.state(Trigger.ARM_MOTION, scene.now_ns)
    expected = None if code is None else Refusal(code=code, message=REFUSAL_TEXT[code])
    assert refusal == expected


def test_a_robot_under_another_namespace_is_the_reason_when_nothing_is_heard():
    """Where the state is missing it is told where robots are; every other reason stays what it is."""
    for state, code in (
        (State.OFFLINE, Code.OTHER_NAMESPACE),
        (State.STALE, Code.OTHER_NAMESPACE),
        (State.IDLE, Code.NOT_ENABLED),
    ):
        scene = Scene(state)
        scene.coordinator.other_robot = other_namespace(("bot1",), "")
        refusal = scene.authorisation.state(Trigger.ARM_MOTION, scene.now_ns)
        assert refusal is not None and refusal.code is code
        assert ("bot1" in refusal.hint) == (code is Code.OTHER_NAMESPACE)


def test_nothing_begins_beside_a_second_robot_that_would_obey():
    """Neither arms nor chassis; what is not heard keeps its own reason, and a robot elsewhere is none against beginning."""
    scene = Scene(State.IDLE)
    scene.coordinator.other_robot = two_robots(("a1", "b2"), "")
    assert scene.authorisation.beside_others(scene.now_ns).code is Code.TWO_ROBOTS
    assert scene.authorisation.ground(scene.command(MOVE), scene.epoch, scene.now_ns).code is Code.TWO_ROBOTS
    assert scene.authorisation.state(Trigger.ARM_MOTION, scene.now_ns).code is Code.NOT_ENABLED
    scene.coordinator.other_robot = other_namespace(("bot1",), "")
    assert scene.authorisation.beside_others(scene.now_ns) is None
    stale = Scene(State.STALE)
    stale.coordinator.other_robot = two_robots(("a1", "b2"), "")
    assert stale.authorisation.state(Trigger.ARM_MOTION, stale.now_ns).code is Code.STATE_STALE


def unknown(scene: Scene) -> None:
    """The robot's mode falls silent."""
    scene.mode = None
    scene.run(301)


@pytest.mark.parametrize(
    ("happens", "code"),
    [
        (lambda scene: scene.say_mode(api=False), Code.MODE_VR),
        (unknown, Code.MODE_UNKNOWN),
        (lambda scene: scene.hear(), Code.NOT_OWNER),
    ],
)
def test_an_owner_in_read_only_is_told_of_the_robots_mode(happens, code):
    """That is why he is there: `NOT_OWNER` would send him after a lease that he has."""
    scene = Scene(State.READ_ONLY)
    happens(scene)
    refusal = scene.authorisation.state(Trigger.ENABLE, scene.now_ns)
    assert refusal is not None and refusal.code is code


def test_without_an_owner_read_only_is_nobodys():
    """Whatever the mode is: the lease comes first."""
    scene = Scene(State.READ_ONLY, owner=None)
    scene.say_mode(api=False)
    refusal = scene.authorisation.state(Trigger.ENABLE, scene.now_ns)
    assert refusal == Refusal(code=Code.NOT_OWNER, message="nobody owns the robot")


def test_latches_refuse_with_all_their_causes():
    """Until `recover` has cleared them."""
    scene = Scene(latches=LATCHED)
    refusal = scene.authorisation.latches()
    assert refusal is not None and (refusal.code, refusal.value) == (Code.LATCHED, "TRACKING_ERROR")
    scene.coordinator.supervisor.clear()
    assert scene.authorisation.latches() is None


# ------------------------------------------------------------------------------------------------ motion


@pytest.mark.parametrize("state", [State.ACTIVE, State.HOLDING])
@pytest.mark.parametrize("sides", [(L,), (R,), (L, R)])
def test_the_owner_of_a_healthy_robot_may_move_it(state, sides):
    """One arm or both, active or held."""
    assert Scene(state).motion(sides) is None


def latch(scene: Scene) -> None:
    """Something is latched."""
    scene.coordinator.latch(Code.TRACKING_ERROR, "blocked", scene.now_ns)


def stop(scene: Scene) -> None:
    """Somebody stops the robot after the request was sent."""
    scene.authorisation.note_stop(scene.now_ns + 1)


def pause(scene: Scene) -> None:
    """The robot pauses by itself."""
    scene.fsm = int(FsmState.PAUSE)
    scene.coordinator.go(State.PAUSED, scene.now_ns, "test")


def take_over(scene: Scene) -> None:
    """The robot was taken in motion."""
    scene.in_motion()
    scene.authorisation.note_takeover(scene.epoch)


def disable_left(scene: Scene) -> None:
    """The left arm is disabled."""
    scene.say_mode(arm_enabled={L: False, R: True})


def hand_over(scene: Scene) -> None:
    """Somebody else owns the robot now."""
    scene.coordinator.lease.take("bob", "bob", 8, "he left", OnLoss.HOLD, scene.now_ns)


REASONS: tuple[tuple[Callable[[Scene], None], Code], ...] = (
    (hand_over, Code.LEASE_STALE),
    (stop, Code.STOPPED),
    (pause, Code.ROBOT_PAUSED),
    (latch, Code.LATCHED),
    (take_over, Code.TAKEOVER_BRAKING),
    (disable_left, Code.ARM_DISABLED),
)
"""Reasons against a motion, in the order in which they are found."""


@pytest.mark.parametrize("first", range(len(REASONS)))
def test_reasons_against_a_motion_are_found_in_order(first):
    """Lease, stop, state, latches, takeover, then the arms: of several the first is told."""
    scene = Scene()
    for happens, _ in reversed(REASONS[first:]):
        happens(scene)
    assert scene.why_not().code is REASONS[first][1]


def silence_right(scene: Scene) -> None:
    """The right arm's state is dead."""
    scene.dumb = {R}
    scene.run(11)


@pytest.mark.parametrize(
    ("happens", "code", "field"),
    [
        (lambda scene: scene.say_mode(arm_enabled={L: True, R: False}), Code.ARM_DISABLED, "right_arm"),
        (lambda scene: scene.say_mode(joint_mode={L: True, R: False}), Code.WRONG_CONTROL_MODE, "right_arm"),
        (silence_right, Code.PART_STALE, "right_arm"),
        (unknown, Code.MODE_UNKNOWN, "mode"),
    ],
)
@pytest.mark.parametrize("sides", [(L,), (R,), (L, R)])
def test_an_arm_that_streams_must_be_fit_though_the_other_one_shall_move(happens, code, field, sides):
    """It must be held, too: a motion that it would end at once is not begun."""
    scene = Scene()
    happens(scene)
    refusal = scene.why_not(sides)
    assert (refusal.code, refusal.field) == (code, field)


def test_the_arm_that_is_asked_for_is_blamed_first():
    """Of two that are unfit the caller hears of his own."""
    scene = Scene()
    scene.say_mode(arm_enabled={L: False, R: False})
    assert (scene.why_not((R,)).field, scene.why_not((L,)).field) == ("right_arm", "left_arm")


def test_an_arm_that_does_not_stream_is_no_hindrance_and_cannot_be_moved():
    """It was not enabled by the last `enable`; the other arm moves without it."""
    scene = Scene(sides=(L,))
    silence_right(scene)
    assert scene.motion((L,)) is None
    scene.dumb = set()
    scene.run(1)
    assert scene.why_not((R,)).code is Code.NOT_ENABLED


# ------------------------------------------------------------------------------------------------ what is held


@pytest.mark.parametrize("side", list(Side))
def test_a_held_arm_that_was_pushed_away_is_not_moved(side):
    """The motion would begin with a jerk; the refusal says how far it is off and what leads it back."""
    scene = Scene(State.HOLDING)
    scene.push(side, -0.35)
    refusal = scene.why_not()
    assert (refusal.code, refusal.field) == (Code.TRACKING_ERROR, f"{side}_arm")
    assert (refusal.value, refusal.bound, refusal.unit) == ("0.35", "0.3", "rad")
    assert refusal.message == f"the {side} arm is 0.35 rad from where it is held, 0.3 rad is the bound"
    assert "enable()" in refusal.hint


def test_a_held_arm_inside_the_bound_may_be_moved():
    """It sags a little under gravity; that is no error."""
    scene = Scene(State.HOLDING)
    scene.push(L, 0.29)
    assert scene.motion() is None


def test_in_active_the_tracking_error_is_the_conditions_matter():
    """It aborts only when it lasts: a motion under way may be replaced meanwhile."""
    scene = Scene(State.ACTIVE)
    scene.push(L, 0.35)
    assert scene.motion() is None


@pytest.mark.parametrize("state", [State.ACTIVE, State.HOLDING])
def test_nothing_is_moved_while_a_reference_walks_back(state):
    """Of either arm; afterwards everything may."""
    scene = Scene(state)
    scene.push(L, 0.35)
    scene.run(5)
    assert scene.phases.starting.walk(scene.now_ns) is None
    assert [scene.why_not(sides).code for sides in ((L,), (R,))] == [Code.STOPPING] * 2
    scene.run(300)
    assert scene.motion((L, R)) is None


# ------------------------------------------------------------------------------------------------ takeover


def test_a_new_owner_waits_until_the_former_motion_is_at_rest():
    """Once it is, the takeover is over: his own motions may be replaced in motion (BEHAVIOUR, takeover)."""
    scene = Scene()
    scene.in_motion()
    scene.authorisation.note_takeover(scene.epoch)
    scene.coordinator.body.cut(Code.LEASE_LOST, "taken")
    assert scene.why_not().code is Code.TAKEOVER_BRAKING
    scene.run(100)
    assert scene.motion() is None
    scene.in_motion()
    assert scene.motion() is None


def test_a_takeover_is_only_the_new_owners():
    """After another change of the lease it binds nobody."""
    scene = Scene()
    scene.in_motion()
    scene.authorisation.note_takeover(scene.epoch - 1)
    assert scene.motion() is None


def test_asking_changes_nothing():
    """A authorisation is a word, not a deed."""
    scene = Scene(State.HOLDING)
    before = scene.state, scene.coordinator.body.arms[L].reference.values
    scene.motion((L, R))
    scene.authorisation.owner(scene.command(Enable(epoch=scene.epoch)), scene.epoch)
    assert (scene.state, scene.coordinator.body.arms[L].reference.values) == before == (State.HOLDING, MIDDLE[L])
    assert scene.coordinator.notices == []


def test_what_an_earlier_daemons_guard_holds_is_not_enabled():
    """Two would command the robot."""
    scene = Scene(State.IDLE)
    assert scene.authorisation.held_elsewhere() is None
    scene.coordinator.guard.earlier_holds = True
    refusal = scene.authorisation.held_elsewhere()
    assert refusal is not None and refusal.code is Code.HELD_BY_GUARD


def test_chassis_and_lift_need_no_enabled_arm():
    """Lease, order of stops, state, latches and takeover count; arms, their mode and their state do not."""
    scene = Scene(State.IDLE, dumb={L, R})
    assert scene.authorisation.ground(scene.command(MOVE), scene.epoch, scene.now_ns) is None
    scene.say_mode(arm_enabled=dict.fromkeys(Side, False))
    assert scene.authorisation.ground(scene.command(MOVE), scene.epoch, scene.now_ns) is None
    for client, received_ns, code in (("bob", None, Code.NOT_OWNER), ("ann", 0, Code.STOPPED)):
        scene.authorisation.note_stop(1)
        refusal = scene.authorisation.ground(scene.command(MOVE, client, received_ns), scene.epoch, scene.now_ns)
        assert refusal is not None and refusal.code is code
    scene.coordinator.guard.earlier_holds = True
    refusal = scene.authorisation.ground(scene.command(MOVE), scene.epoch, scene.now_ns)
    assert refusal is not None and refusal.code is Code.HELD_BY_GUARD
    scene.coordinator.latch(Code.ESTOP, "smoke", scene.now_ns)
    refusal = scene.authorisation.ground(scene.command(MOVE), scene.epoch, scene.now_ns)
    assert refusal is not None and refusal.code is Code.LATCHED


@pytest.mark.parametrize("state", State)
def test_the_table_says_in_which_states_they_may_be_driven(state):
    """The code is the table's."""
    scene = Scene(state)
    refusal = scene.authorisation.ground(scene.command(MOVE), scene.epoch, scene.now_ns)
    assert (refusal.code if refusal else None) == TABLE[Trigger.GROUND_COMMAND][state].refuse


# ------------------------------------------------------------------------------------------------ beside others


def test_nothing_begins_beside_others_but_an_open_claim_is_waited_for():
    """A writer and an established gateway object; of two that claim the robot at once one yields, which is seen later."""
    stage = Scene()
    others, claim = stage.coordinator.others, stage.coordinator.claim
    assert stage.authorisation.beside_others(stage.now_ns) is None
    others.see_gateways([Gateway(zid="b", is_armed=True)], stage.now_ns)
    assert stage.authorisation.beside_others(stage.now_ns).code is Code.OTHER_GATEWAY
    claim.is_confirmed = False
    assert stage.authorisation.beside_others(stage.now_ns) is None
    claim.withdraw()
    assert stage.authorisation.beside_others(stage.now_ns).code is Code.OTHER_GATEWAY
    claim.link_up(0)
    others.see_gateways([], stage.now_ns)
    others.see_writers([Writer(topic=FSM_ENABLE, zid="c", means=Means.TOKEN)], stage.now_ns)
    claim.step(stage.now_ns, is_wanted=True, is_used=False, own_zid="", rivals=[])
    assert claim.number and stage.authorisation.beside_others(stage.now_ns).code is Code.FOREIGN_WRITER


def test_a_friend_that_cannot_be_reached_but_shows_a_claim_holds_off_an_enable():
    """The guard of an earlier daemon with another socket; our own guard shows our own claim."""
    scene = Scene(State.IDLE)
    coordinator = scene.coordinator
    coordinator.others.befriend("c4")
    coordinator.others.see_gateways([Gateway(zid="c4", is_armed=True)], scene.now_ns)
    refusal = scene.authorisation.held_elsewhere()
    assert refusal is not None and refusal.code is Code.HELD_BY_GUARD
    coordinator.guard.see(GuardSeen(pid=41, zid="c4", is_linked=True, at_ns=scene.now_ns))
    assert scene.authorisation.held_elsewhere() is None


@pytest.mark.parametrize(
    ("asked", "is_mode", "needed"), [(Space.JOINT, "end-effector", "joint"), (Space.POSE, "joint", "end-effector")]
)
def test_a_motion_in_the_other_space_is_refused_with_what_would_do(asked, is_mode, needed):
    """On a mixed robot each arm takes its own; the other one is only held."""
    scene = Scene(State.ACTIVE, poses=(R,))
    side = R if asked is Space.JOINT else L
    command = scene.command(Move(epoch=scene.epoch, targets_rad={}))
    refusal = scene.authorisation.motion(command, scene.epoch, (side,), scene.now_ns, asked)
    assert (refusal.code, refusal.value, refusal.bound) == (Code.WRONG_CONTROL_MODE, is_mode, needed)
    assert ("move_pose()" in refusal.hint) == (asked is Space.JOINT)
    other = L if asked is Space.JOINT else R
    assert scene.authorisation.motion(command, scene.epoch, (other,), scene.now_ns, asked) is None


def test_a_held_end_effector_that_was_pushed_away_is_not_moved():
    """Distance in metres, as the bound."""
    scene = Scene(State.HOLDING, poses=(R,))
    scene.shift(R, 0.08)
    command = scene.command(Move(epoch=scene.epoch, targets_rad={}))
    refusal = scene.authorisation.motion(command, scene.epoch, (R,), scene.now_ns, Space.POSE)
    assert (refusal.code, refusal.value, refusal.bound, refusal.unit) == (Code.TRACKING_ERROR, "0.08", "0.06", "m")


def test_commands_that_are_not_ours_are_an_objection_until_they_are_long_past():
    """What was received of them counts as of now."""
    stage = Scene(State.IDLE)
    trace = ForeignData(topic=joint_command(L), zid="b0b", at_ns=stage.now_ns, count=1, link="tcp/10.0.0.9:4711")
    stage.coordinator.others.see_data(trace)
    assert stage.authorisation.beside_others(stage.now_ns).code is Code.FOREIGN_WRITER
    stage.run(1000)
    assert stage.authorisation.beside_others(stage.now_ns) is None


# ------------------------------------------------------------------------------------------------ roles


def asked(scene: Scene, client: str, role: Role) -> CommandRequested:
    """A request under a role."""
    return replace(scene.command(Recover(), client), role=role)


def test_people_are_told_the_name_of_whoever_asks_where_one_is_known():
    """That came along, or under which he owns the robot, or watches it; his id where there is none."""
    scene = Scene(owner=None)
    scene.coordinator.lease.acquire("0a", "policy", 7, OnLoss.HOLD, scene.now_ns)
    scene.coordinator.endpoints.register("0b", "page", 500 * MS, OnLoss.HOLD, scene.now_ns)
    named = replace(scene.command(Recover(), "0a"), name="bob")
    asking = [named, *(scene.command(Recover(), client) for client in ("0a", "0b", "0c"))]
    assert [scene.authorisation.name_of(command) for command in asking] == ["bob", "policy", "page", "0c"]


def test_only_an_admin_may_take_the_robot_from_its_owner():
    """From nobody, and again from himself, an operator may."""
    scene = Scene()
    for client, role, code in (
        ("bob", Role.OPERATOR, Code.NOT_PERMITTED),
        ("bob", Role.ADMIN, None),
        ("ann", Role.OPERATOR, None),
    ):
        refusal = scene.authorisation.by_force(asked(scene, client, role))
        assert (refusal and refusal.code) is code


def test_a_stop_is_undone_by_whoever_alone_left_it_or_by_an_admin():
    """One that two have left is nobody's own; without one an operator recovers, but lets no silent endpoint go."""
    scene = Scene()
    authorisation, latches = scene.authorisation, scene.coordinator.supervisor.latches
    assert authorisation.recovery(asked(scene, "ann", Role.OPERATOR)) is None
    authorisation.note_stop(1, "bob")
    latches[Code.ESTOP] = "bob"
    authorisation.note_stop(2, "bob")
    assert authorisation.recovery(asked(scene, "bob", Role.OPERATOR)) is None
    refusal = authorisation.recovery(asked(scene, "ann", Role.OPERATOR))
    assert refusal is not None and refusal.code is Code.NOT_PERMITTED and refusal.bound == "admin"
    authorisation.note_stop(3, "carol")
    assert authorisation.recovery(asked(scene, "bob", Role.OPERATOR)) is not None
    assert authorisation.recovery(asked(scene, "ann", Role.ADMIN)) is None
    del latches[Code.ESTOP]
    latches[Code.ENDPOINT_SILENT] = "page"
    assert authorisation.recovery(asked(scene, "ann", Role.OPERATOR)) is not None
