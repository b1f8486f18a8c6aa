"""`ta2 gripper`, `payload`, `drive` and `lift`, against the real engine and the simulated robot in virtual time."""

from __future__ import annotations

import json
import re

import pytest

from gateway.cli.command_line.arguments import parse
from gateway.cli.looking.frame import Picture, frame
from gateway.cli.main import main
from gateway.client import Payload, connect
from gateway.client.state.reading import ArmState
from gateway.values import Side
from tests.changed import replace
from tests.cli.views import INFO
from tests.client.robot_world import RobotWorld


class Shell:
    """Runs commands in this process; `world` is what they find."""

    def __init__(self, monkeypatch, capsys, **world):
        self.world = RobotWorld(**world)
        self._capsys = capsys
        monkeypatch.setattr(
            "gateway.client.connect",
            lambda target=None, *, name=None, timeout_s=5.0, greet=True: connect(
                target, name=name, timeout_s=timeout_s, transport=self.world.transport(), greet=greet
            ),
        )

    def run(self, *words):
        """Run `ta2 WORDS` to its end; return status, standard output and standard error."""
        self._capsys.readouterr()
        try:
            status = main(words)
        except SystemExit as end:
            status = end.code
        self.world.run(0.1)
        read = self._capsys.readouterr()
        return int(status), read.out, read.err

    def owner(self):
        """Who owns the robot now."""
        return self.world.pair.engine.owner_id


@pytest.fixture
def shell(monkeypatch, capsys):
    """A robot with a lift, something in its left gripper, and a shell."""
    return Shell(monkeypatch, capsys, model="lift", left_object_rad=0.4)


def test_drive_drives_for_its_time_and_gives_the_robot_back(shell):
    """Zeros follow; what was done is told, to scripts as JSON."""
    for words in (("--vx", "-0.1", "--wz", "1e-1"), ("-0.1", "0", "1e-1")):  # by name, and as a person types it first
        status, out, err = shell.run("drive", *words, "--for", "1", "--yes")
        assert status == 0 and out == "drove with (-0.1, 0) m/s, 0.1 rad/s for 1 s; released\n", err
    chassis = shell.world.pair.robot.chassis
    assert -0.25 < chassis.travel[0] < -0.1 and not any(chassis.velocity) and shell.owner() is None
    assert "the chassis drives with" in err
    status, out, _ = shell.run("drive", "0.1", "--for", "0.5", "--json")
    assert status == 0 and json.loads(out) == {
        "ok": True, "vx": 0.1, "vy": 0.0, "wz": 0.0, "for_s": 0.5, "held": False,
    }  # fmt: skip


def test_what_is_refused_is_status_1_and_gives_the_robot_back(shell):
    """Too fast: with the bound, and nothing is left owned."""
    status, out, err = shell.run("drive", "--vx", "0.9", "--for", "1", "--json")
    assert status == 1 and "OUT_OF_RANGE" in err and json.loads(out)["error"]["field"] == "vx_mps, vy_mps"
    assert shell.owner() is None and not shell.world.pair.engine.running_topics


def test_lift_goes_up_down_and_off(shell):
    """Its servo is off when the robot is given back."""
    lift = shell.world.pair.robot.lift
    begin_m = lift.lowered_m
    assert shell.run("lift", "up", "--for", "1")[:2] == (0, "lift: drove up with 0.3 for 1 s; released\n")
    up_m = lift.lowered_m
    assert up_m < begin_m - 0.05
    assert shell.run("lift", "down", "--speed", "0.2", "--for", "0.5")[0] == 0 and lift.lowered_m > up_m
    assert shell.run("lift", "off")[:2] == (0, "lift: its servo is off; released\n")
    shell.world.run(2.0)
    assert not lift.is_powered


def test_a_robot_without_a_lift_says_so(monkeypatch, capsys):
    """With the code and what to set, before anything is said of a motion, and before anybody owns it."""
    shell = Shell(monkeypatch, capsys)
    status, out, err = shell.run("lift", "up", "--json")
    assert status == 1 and err.startswith("NO_LIFT: ") and "set `model`" in err and "drives" not in err
    assert json.loads(out)["error"]["code"] == "NO_LIFT" and shell.owner() is None


def test_gripper_closes_watches_and_says_what_it_takes_to_be_so(shell):
    """The estimate is called one; without --hold the robot pauses and the grip is lost."""
    status, out, err = shell.run("gripper", "left", "grip", "--force", "0.5", "--for", "2")
    assert status == 0 and out.startswith(
        "left gripper: sent 0.55 (-0.80 N·m), it seems to hold something (an estimate)"
    )
    assert out.endswith("; released\n") and "closes with 0.5" in err
    assert shell.world.pair.robot.grippers[Side.LEFT].effort_nm == 0.0 and shell.world.pair.state == "READ_ONLY"


def test_a_held_grip_is_kept_by_the_commands_that_follow(shell):
    """`--hold`: the next command finds the robot held, and leaves it so."""
    status, out, err = shell.run("gripper", "left", "grip", "--hold", "--json")
    assert status == 0 and json.loads(out)["held"] is True and "held with their grip" in err
    sim = shell.world.pair.robot.grippers[Side.LEFT]
    assert sim.effort_nm < -0.7 and shell.world.pair.state == "HOLDING"
    status, out, _ = shell.run("drive", "--vx", "0.1", "--for", "0.5", "--take", "test")
    assert status == 0 and out.endswith("; held\n") and sim.effort_nm < -0.7
    assert shell.run("gripper", "left", "set", "0.2", "--take", "test")[0] == 0
    assert sim.level_01 == 0.2 and shell.world.pair.state == "HOLDING"
    for action, level in (("open", 0.075), ("relax", 0.1)):
        assert shell.run("gripper", "left", action, "--force", "0.25", "--take", "test")[0] == 0
        assert sim.level_01 == pytest.approx(level)


def ctrl_c():
    """Interrupt whoever waits."""
    raise KeyboardInterrupt


def test_ctrl_c_while_a_gripper_closes_says_that_the_arms_are_held(shell):
    """As after `ta2 move`: how long, and how to go on; nothing is said where nothing is held."""
    shell.world.after(4.0, ctrl_c)
    status, _, err = shell.run("gripper", "left", "grip", "--for", "5")
    assert status == 130 and shell.world.pair.state == "HOLDING"
    assert "interrupted: the arms are held with their grip for 60 s" in err


def test_ctrl_c_while_the_chassis_drives_holds_nothing(shell):
    """No arm was in it."""
    shell.world.after(0.5, ctrl_c)
    status, _, err = shell.run("drive", "--vx", "0.1", "--for", "5", "--yes")
    assert status == 130 and "held with their grip" not in err


def test_a_robot_that_is_not_heard_any_more_is_not_said_to_be_held(shell):
    """It may be, or it may pause: what becomes of it is told, and how to go on."""
    shell.world.after(3.0, lambda: setattr(shell.world.pair, "is_deaf", True))
    status, _, err = shell.run("move", "--by", "--left", "0,0,0,0.3,0,0,0", "--speed", "0.05")
    assert status == 1 and "STATE_STALE" in err and "else it pauses" in err and "  go on    `ta2 move` again" in err


def test_what_makes_a_weighing_is_a_command_that_there_is(shell, tmp_path):
    """The hint names all that it needs."""
    _, _, err = shell.run("payload", "--arm", "left", "--empty", str(tmp_path / "nothing.json"))
    (words,) = re.findall(r"`ta2 (.*) > FILE`", err)
    assert parse(words.replace("SIDE", "left").split()).arm == "left"


FOUND = Payload(
    mass=0.302,
    mass_sd=0.02,
    com=(0.18, -0.002, 0.019),
    com_sd=(0.011, 0.003, 0.003),
    frame="left_ee",
    condition=60.0,
    q_rad=((0.1,) * 7,),
    up_nm=((-1.0,) * 7,),
    down_nm=((1.0,) * 7,),
    noise_nm=((0.01,) * 7,),
)


def test_payload_weighs_beside_what_was_kept_of_the_empty_hand(shell, monkeypatch, tmp_path):
    """Enabled for it; what was found is told with its frame and standard deviations, what may be nothing as that."""
    found, asked = [FOUND, replace(FOUND, mass=0.01, com=None, com_sd=None), FOUND], []

    def weighed(own, side, empty):
        asked.append((own.is_open, side, empty))
        return found[len(asked) - 1]
        yield

    monkeypatch.setattr("gateway.client.weighing._weighed", weighed)
    monkeypatch.setattr(ArmState, "contact", "felt")
    status, out, err = shell.run("payload", "--arm", "left", "--json")
    assert status == 0 and json.loads(out)["payload"]["mass"] == 0.302 and "swings by 0.05 rad" in err
    kept = tmp_path / "empty.json"
    kept.write_text(out)
    status, out, _ = shell.run("payload", "--arm", "right", "--empty", str(kept))
    assert (status, out) == (0, "right hand: 0.010 ± 0.020 kg, which may be nothing: not counted on; released\n")
    status, out, _ = shell.run("payload", "--arm", "left")
    assert out.startswith(
        "left hand: 0.302 ± 0.020 kg at 0.180 ± 0.011, -0.002 ± 0.003, 0.019 ± 0.003 m in left_ee; counted on"
    )
    assert asked == [(True, Side.LEFT, None), (True, Side.RIGHT, FOUND), (True, Side.LEFT, None)]


def test_payload_takes_back_what_was_told_without_moving(shell, monkeypatch, tmp_path):
    """Refused where nothing is felt; a file that is no weighing is refused before anything is asked."""

    def told(own, side, load):
        return load
        yield

    status, _, err = shell.run("payload", "--arm", "left", "--none")
    assert status == 1 and err.startswith("MODEL_OFF: ") and "`dynamics = true`" in err and shell.owner() is None
    monkeypatch.setattr(ArmState, "contact", "felt")
    monkeypatch.setattr("gateway.client.weighing._tell", told)
    status, out, err = shell.run("payload", "--arm", "left", "--none", "--json")
    assert status == 0 and json.loads(out)["payload"] is None and "said to hold nothing" in err
    (tmp_path / "no.json").write_text("{}")
    for name in ("no.json", "missing.json"):
        status, _, err = shell.run("payload", "--arm", "left", "--empty", str(tmp_path / name))
        assert status != 0 and "BAD_CONFIG" in err and "is no weighing" in err


@pytest.mark.parametrize(
    "words",
    [
        ("payload",),
        ("payload", "--arm", "left", "--none", "--empty", "file"),
        ("gripper", "left", "set"),
        ("gripper", "left", "grip", "0.3"),
        ("gripper", "left", "set", "1.1"),
        ("gripper", "both", "grip"),
        ("gripper", "left", "grip", "--force", "2"),
        ("drive", "--vx", "fast"),
        ("drive", "fast"),
        ("drive", "0.1", "0", "0", "0"),
        ("drive", "0.1", "--wz", "0.1"),
        ("drive", "--for", "0"),
        ("lift", "sideways"),
        ("lift", "up", "--speed", "nan"),
    ],
)
def test_what_makes_no_sense_is_a_usage_error(shell, words):
    """Before anything is asked."""
    assert shell.run(*words)[0] == 2 and shell.owner() is None


def test_watch_shows_what_they_are_told(shell):
    """Grip, drive and lift stand beside the streams, while there is anything to see."""
    with connect(transport=shell.world.transport(), name="tester") as robot, robot.control() as own:
        own.enable()
        own.left_gripper.grip(1.0)
        own.chassis.set_velocity(0.1, 0.0, -0.1, expiry=3.0)
        own.lift.set_velocity(0.5, expiry=3.0)
        shell.world.run(1.5)
        picture = Picture(address="here", info=INFO, view=robot.state.view, since_ns=0, remarks=())
        text = "\n".join(line.plain for line in frame(picture, 140, 60))
    assert "grip left 1.00 -1.60 N·m, holds?" in text and "grip right" not in text
    assert "drive +0.10 +0.00 m/s -0.10 rad/s" in text and "lift +0.50 servo on" in text
