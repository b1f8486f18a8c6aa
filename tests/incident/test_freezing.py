"""What an engine becomes of its bytes: the same frames, replies, notices and snapshots, to the last bit."""

from __future__ import annotations

import copyreg
import io
import math
import os
import pickle
from collections import namedtuple

import numpy as np
import pytest

from gateway.core.messages.events import CommandRequested
from gateway.core.messages.outputs import Reply
from gateway.core.requests.answers import REPLIES_KEPT
from gateway.core.robot_state.body_model import body_model
from gateway.core.supervision.conditions import Conditions
from gateway.incident.freezing import Frozen, Unfrozen, Unpickler, _array, freeze, packed, thaw
from gateway.kinematics.urdf import from_urdf
from gateway.messages.incoming import Admittance
from gateway.messages.requests import MovePose, OpenStream, Recover
from gateway.settings.settings import LocalSettings, Settings
from gateway.settings.toml_file import state_dir
from gateway.sim.robot.settings import SimSettings
from gateway.values import EePose, Side, Space
from tests.changed import replace
from tests.incident.feeling import feeling
from tests.pair import MS, Pair

GOAL = (0.4, 0.3, 0.2, 0.3, 0.1, 0.2, 0.1)

OTHER = (0.4, -0.3, 0.2, -0.5, 0.1, 0.2, 0.1)


def going_on(pair: Pair, seconds: float) -> int:
    """Let time pass for the pair's engine and one that was thawed from it; return how many frames were compared."""
    engine = pair.engine
    twin = thaw(*packed(freeze(engine)))
    receive, tick = engine.receive, engine.tick

    def received(event, now_ns):
        receive(event, now_ns)
        twin.receive(event, now_ns)

    def ticked(now_ns, late_ns=0):
        output = tick(now_ns, late_ns)
        assert repr(twin.tick(now_ns, late_ns)) == repr(output)
        return output

    before = len(pair.frames)
    pair.engine.receive, pair.engine.tick = received, ticked  # type: ignore[method-assign]  # both hear the same
    pair.run(seconds)
    del pair.engine.receive, pair.engine.tick
    return len(pair.frames) - before


@pytest.fixture
def pair() -> Pair:
    """Return an engine and its robot."""
    return Pair()


def test_a_motion_goes_on_from_anywhere_in_it(pair: Pair) -> None:
    """The plan of ruckig is worked out anew, and gives the same setpoints."""
    epoch = pair.activate()
    pair.move(epoch, {Side.LEFT: GOAL, Side.RIGHT: OTHER})
    for _ in range(4):
        assert going_on(pair, 0.4) > 0
    going_on(pair, 3.0)


def test_a_stream_of_targets_goes_on(pair: Pair) -> None:
    """Follower, slots, sequence numbers."""
    epoch = pair.activate()
    stream_id = pair.stream(epoch)
    for number in range(20):
        pair.target(epoch, stream_id, tuple(0.2 * math.sin(number / 5) ** 2 for _ in GOAL))
        assert going_on(pair, 0.05) > 0
    going_on(pair, 1.0)


def test_a_robot_whose_arms_keep_apart_by_the_model_goes_on() -> None:
    """The model's numbers are parts, its verdicts are state."""
    settings = Settings()
    settings = replace(settings, model=replace(settings.model, self_collision=True))
    pair = Pair(settings, model=body_model(settings))
    epoch = pair.activate()
    pair.run(4.0)
    pair.move(epoch, {Side.LEFT: GOAL})
    pair.run(0.2)
    frozen = freeze(pair.engine)
    assert len(frozen.parts) > 2
    assert going_on(pair, 1.0) > 0


def test_a_robot_that_feels_what_pulls_at_it_goes_on() -> None:
    """Pinocchio's own objects are made anew from the description; the observers are state."""
    pair = feeling()
    epoch = pair.activate()
    pair.run(4.0)
    pair.move(epoch, {Side.LEFT: GOAL})
    pair.run(0.2)
    assert {"ArmDynamics"} < {type(part).__name__ for part in freeze(pair.engine).parts}
    assert going_on(pair, 1.0) > 0
    twin = thaw(*packed(freeze(pair.engine)))
    ours, theirs = (engine._coordinator.model.contacts for engine in (pair.engine, twin))
    for side in Side:
        assert repr(ours.view(side, pair.now_ns)) == repr(theirs.view(side, pair.now_ns))
        assert ours._observers[side].torque_nm.tobytes() == theirs._observers[side].torque_nm.tobytes()


def test_a_hand_that_yields_goes_on() -> None:
    """The virtual mass is state: where it is, how it goes and what pushed it last."""
    pair = feeling("pose")
    epoch = pair.activate()
    pair.run(4.0)
    wish = Admittance(mass=(8.0,) * 3 + (None,) * 3, damping=(200.0,) * 6, stiffness=(10.0,) * 6)
    how = {"side": Side.LEFT, "space": Space.POSE, "frame": "left_shoulder_base", "expiry_ns": 3_000 * MS}
    facts = pair.granted(OpenStream(epoch=epoch, admittance=wish, **how))
    pair.target(epoch, facts["stream_id"], tuple(facts["values"]))
    pair.run(0.3)
    mass = pair.engine._coordinator.body.targets.find(facts["stream_id"]).mass
    assert mass.place and going_on(pair, 1.0) > 0
    assert any(mass.force), "this robot's efforts are made up, and push"


def test_poses_go_on() -> None:
    """Arms in end-effector mode."""
    pair = Pair(sim=SimSettings(state_period_ns=10 * MS, left_mode="pose", right_mode="pose"))
    epoch = pair.activate()
    arm = pair.see().arms["left"]
    x, y, z = arm.p_m
    goal = EePose(p_m=(0.93 * x, 0.93 * y, 0.93 * z), quat_xyzw=tuple(arm.quat_xyzw))
    pair.granted(
        MovePose(
            epoch=epoch, targets={Side.LEFT: (*goal.p_m, *goal.quat_xyzw)}, frames={Side.LEFT: "left_shoulder_base"}
        )
    )
    pair.run(0.2)
    assert going_on(pair, 1.5) > 0


def test_work_that_is_cut_into_ticks_is_no_moment_to_freeze(pair: Pair) -> None:
    """The next one is; the recorder tries again."""
    pair.engine._phases.work = (number for number in range(3))  # type: ignore[attr-defined]  # like a line being planned
    with pytest.raises(Unfrozen, match="generator"):
        freeze(pair.engine)


def test_replies_that_were_given_are_named_and_are_given_again(pair: Pair) -> None:
    """However many there are, the loop does not pack them; nor does what is kept change under the one who does."""
    pair.activate()
    few = len(freeze(pair.engine).state)
    answered = pair.engine._answered
    asked = [
        CommandRequested(client_id="ann", request_id=number, request=Recover(), received_ns=1, content=11)
        for number in range(REPLIES_KEPT)
    ]
    for command in asked:
        answered.keep(command, Reply(client_id="ann", request_id=command.request_id, facts={"cleared": []}))
    frozen = freeze(pair.engine)
    assert len(frozen.state) <= few
    answered.keep(replace(asked[0], client_id="bob"), Reply(client_id="bob", request_id=0))
    twin = thaw(*packed(frozen))._answered
    assert all(repr(twin.again(command)) == repr(answered.again(command)) for command in asked[1:])
    assert twin.again(asked[0]) is not None and answered.again(asked[0]) is None


def test_no_file_of_users_or_keys_is_named_in_it() -> None:
    """Nor can what only the local plane reads be told from it."""
    local = LocalSettings(users_file="/etc/ta2/users", tls_private_key="/etc/ta2/key.pem", socket="/run/secret.sock")
    parts, state = packed(freeze(Pair(Settings(local=local)).engine))
    assert not any(name in parts + state for name in (b"users", b"key.pem", b"secret.sock"))


class Evil:
    def __reduce__(self):
        return os.system, ("echo",)


class Sly:
    def __reduce__(self):
        return getattr, (freeze, "__globals__")


def test_no_module_comes_out_of_a_file() -> None:
    """Not even one that a module of ours has imported: its functions would come with it."""
    for name in ("os", "os.system", "state_dir.__globals__"):
        asked = b"\x80\x04" + pickle.BINUNICODE + len(b"gateway.settings.toml_file").to_bytes(4, "little")
        asked += b"gateway.settings.toml_file" + pickle.BINUNICODE + len(name).to_bytes(4, "little") + name.encode()
        with pytest.raises(pickle.UnpicklingError):
            Unpickler(io.BytesIO(asked + pickle.STACK_GLOBAL + pickle.STOP)).load()


class Called:
    """What a file would have called."""

    def __init__(self, function, *given):
        self.function, self.given = function, given

    def __reduce__(self):
        return self.function, self.given


def evaluating(owner: object, name: str) -> object:
    """Return what gets at `eval` by a generator's frame."""
    frame = Called(getattr, Called(Called(getattr, owner, name), 0), "gi_frame")
    get = Called(getattr, Called(getattr, frame, "f_builtins"), "get")
    return Called(Called(get, "eval"), "1 + 1")


class Nested(pickle._Pickler):  # type: ignore[name-defined]  # Python's own takes callables that are made by calls
    """Writes calls of what calls return."""

    def save_reduce(self, func, args, *more, obj=None):
        self.save(func)
        self.save(args)
        self.write(pickle.REDUCE)


def asking(value: object) -> io.BytesIO:
    """Return a file that asks for it."""
    file = io.BytesIO()
    Nested(file, 4).dump(value)
    file.seek(0)
    return file


def test_no_frame_comes_out_of_a_generator_of_ours(pair: Pair) -> None:
    """With it came all that Python has: methods are only those that a class of the core has written down."""
    conditions = Called(copyreg.__newobj__, Conditions)  # type: ignore[attr-defined]  # typeshed hides it
    with pytest.raises(pickle.UnpicklingError, match="gi_frame is no method"):
        Unpickler(asking(evaluating(conditions, "look"))).load()


@pytest.mark.parametrize(
    "value",
    [
        Called(getattr, "{0.__class__}", "format"),
        Called(getattr, [], "append"),
        Called(getattr, Called(np.ndarray, (1,)), "tofile"),
        Called(getattr, Conditions, "mro"),
        Called(np.dtype, "O"),
        Called(namedtuple, "Name", "a b"),
        Called(from_urdf, "/etc/passwd"),
        Called(state_dir),
        Called(_array, "|O8", (1,), "C", b"12345678"),
    ],
)
def test_nothing_that_reaches_outside_is_called(value: object) -> None:
    """No method of Python's or numpy's, no function that opens a file, no array of objects."""
    with pytest.raises(pickle.UnpicklingError):
        Unpickler(asking(value)).load()


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_come_back_as_they_lay(order: str) -> None:
    """Sums depend on it, to the last bit; and they can be written into."""
    array = np.asarray(np.arange(6.0).reshape(2, 3) / 7.0, order=order)  # type: ignore[call-overload]  # one of the two
    parts, _ = packed(Frozen(b"", [array, np.float64(0.1), np.bool_(True), np.zeros((0, 3), np.int64)]))
    found, number, truth, nothing = Unpickler(io.BytesIO(parts)).load()
    assert found.tobytes("A") == array.tobytes("A") and found.strides == array.strides and found.flags.writeable
    assert repr([number, truth]) == repr([np.float64(0.1), np.bool_(True)]) and nothing.shape == (0, 3)


@pytest.mark.parametrize("value", [Evil(), Sly(), thaw, open, os.path.join])
def test_nothing_but_the_gateways_own_values_comes_out_of_a_file(value: object) -> None:
    """An incident of somebody else's calls nothing."""
    with pytest.raises(pickle.UnpicklingError):
        Unpickler(io.BytesIO(pickle.dumps(value))).load()
