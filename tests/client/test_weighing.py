"""Weighing what a hand holds: the real engine and the robot with forces, in virtual time."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.api.translate import describe
from gateway.client import Payload, aio, connect
from gateway.core.messages.events import LinkDown, LinkUp
from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.errors import Aborted, Code, NotReady, Rejected
from gateway.kinematics.description import nominal
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.kinematics.dynamics.parameters import DriveParameters
from gateway.messages.requests import Stop
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.motion import ArmSettings
from gateway.settings.settings import ModelSettings, Settings
from gateway.sim.robot.arm import SimArm
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.changed import replace
from tests.client.playing import play
from tests.client.robot_world import RobotWorld
from tests.memory_plane import MemoryPlane
from tests.pair import MS, Pair

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
pytest.importorskip("mujoco", reason=REASON)

pytestmark = pytest.mark.slow

LEFT = Side.LEFT
HELD_KG = 0.3


class World(RobotWorld):
    """Arms with forces at the home of §6.6: masses and friction up to 8 % off, efforts noisy, hands heavier than described."""

    def __init__(self, *, feels=True):
        settings = Settings(model=ModelSettings(dynamics=feels), arm=ArmSettings(settle_ns=50 * MS))
        model = body_model(settings)
        assert model is not None
        if feels:
            model.contacts = Contacts(load_dynamics(settings), model.refusal)
        forces = {"physics": "mujoco", "differs_percent": 8.0, "seed": 3} if feels else {}
        start = {side: HOME_Q_RAD[side] for side in Side}
        self.pair = Pair(settings, SimSettings(state_period_ns=10 * MS, start_rad=start, **forces), model=model)
        self.plane = MemoryPlane(describe(settings, socket="/s", pid=1), self.now_ns)
        self.transports, self.at = [], {}
        self.run(4.0)  # joints and poses have agreed

    def hang(self, kg):
        """Put something between the left hand's pads."""
        self.pair.robot.inject({"fault": "load", "side": "left", "kg": kg}, self.now_ns())
        self.run(0.5)


@pytest.fixture(scope="module")
def scene():
    """A robot whose empty left hand was weighed at home, its owner, and what came of it."""
    world = World()
    with connect(transport=world.transport(), name="weigher") as robot, robot.control() as own:
        own.enable()
        yield world, robot, own, own.left_arm.payload()


def test_a_load_is_found_to_a_tenth_beside_the_empty_hand_and_is_no_longer_felt(scene):
    """Whatever the arm weighs and friction is; the other hand is not concerned."""
    world, robot, own, empty = scene
    assert 0.05 < empty.mass < 0.5 and empty.mass_sd > 0.1, "what the arm itself is heavier by looks like it"
    begun = robot.state.left_arm.q
    own.left_arm.payload(None)
    world.hang(HELD_KG)
    found = own.left_arm.payload(empty=empty)
    assert found.mass == pytest.approx(HELD_KG, rel=0.1) and found.mass_sd < 0.05
    assert found.com == pytest.approx((0.185, -0.0068, 0.0), abs=0.03) and max(found.com_sd) < 0.05
    assert (np.abs(np.array(found.com) - (0.185, -0.0068, 0.0)) < 4.0 * np.array(found.com_sd)).all()
    assert found.frame == "left_ee" and 1.0 < found.condition < 300.0
    assert robot.state.left_arm.q == pytest.approx(begun, abs=0.03), "it ends where it began"
    world.run(0.5)
    told = robot.state.left_arm.contact
    assert told.payload == Payload(mass=found.mass, com=found.com, frame="left_ee")
    assert robot.state.right_arm.contact.payload is None
    own.left_arm.payload(None)
    world.run(0.5)
    untold = robot.state.left_arm.contact
    assert untold.payload is None
    from gateway.kinematics.dynamics.arm_dynamics import ArmDynamics  # pinocchio

    columns = ArmDynamics(nominal(), LEFT, DriveParameters()).load_columns(robot.state.left_arm.q)
    pulls = columns @ (found.mass * np.array((1.0, *found.com)))
    assert untold.torque - told.torque == pytest.approx(pulls, abs=0.45) and np.abs(pulls).max() > 1.0
    world.pair.robot.clear("load")


def test_what_is_known_is_told_without_moving_and_taken_back(scene):
    """Nothing swings; what nobody believes is refused, and what was told stays."""
    world, robot, own, _ = scene
    begun_ns, known = world.now_ns(), Payload(mass=0.25, com=(0.1, 0.0, 0.0))
    assert own.left_arm.payload(known) == known
    world.run(0.1)
    assert robot.state.left_arm.contact.payload == Payload(mass=0.25, com=(0.1, 0.0, 0.0), frame="left_ee")
    with pytest.raises(Rejected, match=r"mass_kg is 4.0 kg, outside \[0, 3\] kg") as refused:
        own.left_arm.payload(Payload(mass=4.0))
    assert refused.value.code is Code.OUT_OF_RANGE
    with pytest.raises(Rejected, match="mass is 'heavy', a number is needed"):
        own.left_arm.payload(Payload(mass="heavy"))
    assert own.left_arm.payload(None).mass == 0.0
    world.run(0.1)
    assert robot.state.left_arm.contact.payload is None and world.now_ns() - begun_ns < 1_000_000_000


def test_an_arm_that_moves_stands_elsewhere_or_does_not_swing_is_not_weighed(scene, monkeypatch):
    """Said before anything moves for it, and where it is known only then, after."""
    world, robot, own, empty = scene
    home = robot.state.left_arm.q_ref
    handle = own.left_arm.move_by((0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    world.run(0.4)
    with pytest.raises(NotReady, match=r"left_arm moves at .* must be at rest to be weighed") as refused:
        own.left_arm.payload()
    assert refused.value.code is Code.CANNOT_WEIGH
    handle.result()
    with pytest.raises(NotReady, match=r"left_arm stands 0.40 rad from where its empty hand was weighed"):
        own.left_arm.payload(empty=empty)
    with pytest.raises(NotReady, match=r"left_arm stands inf rad from"):
        own.left_arm.payload(empty=Payload(mass=0.0))
    own.left_arm.move_to(home).result()
    for other in (replace(empty, noise_nm=empty.noise_nm[:2]), replace(empty, q_rad=(*empty.q_rad[:2], (0.0,) * 7))):
        with pytest.raises(NotReady, match=r"left_arm stands .* rad from where its empty hand was weighed"):
            own.left_arm.payload(empty=other)
    monkeypatch.setattr("gateway.client.weighing.SWING_RAD", 0.0)
    with pytest.raises(NotReady, match=r"joint . of left_arm did not follow a swing"):
        own.left_arm.payload()
    own.left_arm.move_to(home).result()


def test_a_stop_of_anybody_ends_the_weighing_and_nothing_is_counted_on(scene):
    """The arm is held where it is; what was told before was taken back, for it may be another thing by now."""
    world, robot, own, _ = scene
    own.left_arm.payload(Payload(mass=0.2))
    with connect(transport=world.transport(), name="bystander") as other:
        world.after(1.5, lambda: world.pair.ask(Stop(), "bystander"))
        with pytest.raises(Aborted) as ended:
            own.left_arm.payload()
        assert ended.value.code is Code.STOPPED
        other.recover()
    own.enable()
    world.run(0.2)
    assert robot.state.left_arm.contact.payload is None and robot.state.left_arm.is_streaming


def test_without_efforts_nothing_is_weighed(scene, monkeypatch):
    """With what the arm itself says of it."""
    world, _, own, _ = scene
    place = SimArm.place
    with monkeypatch.context() as deaf:
        deaf.setattr(
            SimArm, "place", lambda arm, q_rad, v_radps, effort_nm: place(arm, q_rad, v_radps, 0.0 * effort_nm)
        )
        deaf.setattr(world.pair.robot.arms[LEFT], "effort_noise_nm", np.zeros(7))
        world.run(0.1)
        with pytest.raises(NotReady, match=r"what pulls at left_arm is unknown: NO_EFFORTS: .* all zero"):
            own.left_arm.payload()
    world.run(0.5)


def test_what_the_hand_holds_outlives_its_owner_and_goes_with_the_link(scene):
    """The hand still holds it when nobody commands; of a robot that was away nobody knows."""
    world, robot, own, _ = scene
    own.left_arm.payload(Payload(mass=0.2))
    own.leave()
    world.run(1.0)
    assert not own.is_open and robot.state.left_arm.contact.payload == Payload(mass=0.2, frame="left_ee")
    world.pair.receive(LinkDown(at_ns=world.now_ns()))
    world.pair.receive(LinkUp(at_ns=world.now_ns(), own_zid="me", router_zid="other"))
    world.run(0.5)
    assert robot.state.left_arm.contact.payload is None


def test_a_gateway_without_dynamics_says_which_setting_is_missing():
    """Also under asyncio, whose call is the same; nothing moves."""
    world = World(feels=False)

    async def scene():
        async with aio.connect(transport=world.transport()) as robot, robot.control() as own:
            for known in ("weigh", None, Payload(mass=0.2)):
                with pytest.raises(NotReady, match="does not ask for dynamics") as refused:
                    await own.right_arm.payload(known)
                assert refused.value.code is Code.MODEL_OFF and "dynamics = true" in refused.value.refusal.hint

    play(world, scene)
