"""Tests of `ta2 home` and `ta2 move`: what is asked of the gateway, what a person is told, how they end."""

from __future__ import annotations

import io
import signal

import pytest
from msgspec.structs import replace

from gateway.cli.motion import job
from gateway.cli.terminal import asking
from gateway.errors import Code, Refusal
from gateway.messages import requests
from gateway.messages.snapshot import LinkView
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.api.stand_in import START_Q, a_snapshot

ZEROS = ["0"] * 7
GOAL = ["0.1", "0.5", "-0.3", "1.2", "0.2", "-0.1", "0.3"]


def request_of(shell, kind):
    """Return the one request of a kind."""
    (found,) = [request for _, request in shell.world.engine.requests if isinstance(request, kind)]
    return found


class Terminal(io.StringIO):
    """A terminal at which somebody has typed."""

    def isatty(self):
        return True

    def fileno(self):
        return 0


@pytest.fixture
def typed(monkeypatch):
    """Let somebody sit at a terminal and type; returns what is done with typed-ahead input."""
    flushed = []

    def sit_down(text):
        monkeypatch.setattr("sys.stdin", Terminal(text))
        monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
        monkeypatch.setattr(asking.termios, "tcflush", lambda *_: flushed.append(True))
        return flushed

    return sit_down


# ------------------------------------------------------------------------------------------------------- as it should


def test_home_enables_moves_and_disables(shell):
    """Both arms to the manual's initial position (§6.6), with the speed asked for; then released and paused."""
    ended = shell.run("home", "--speed", "0.3")
    assert ended.status == 0, ended.err
    assert shell.world.engine.names() == ["Acquire", "Enable", "Move", "Release"]
    move = request_of(shell, requests.Move)
    assert move.targets_rad == HOME_Q_RAD and not move.relative
    assert (move.speed, move.tolerance_rad, move.on_limit) == (0.3, None, requests.OnLimit.REJECT)
    assert request_of(shell, requests.Acquire).name == "ta2 home"
    assert ended.out == "reached within 0.004 rad after 0.2 s; disabled\n"
    for said in ("initial position of manual §6.6", "0.3 rad/s", "enable: READY", "50%, 0.200 rad to go", "PAUSE"):
        assert said in ended.err
    assert "left arm  by +0.310 +0.660 -0.170 +0.000 +0.030 -0.050 +0.300 rad" in ended.err


def test_hold_leaves_the_arms_held_and_says_how_to_go_on(shell):
    """`--hold`: the lease is left, not given back; the clocks and the ways on are told."""
    ended = shell.run("home", "--hold", "--json")
    assert ended.status == 0 and shell.world.engine.names() == ["Acquire", "Enable", "Move", "Abandon"]
    assert ended.json["held"] is True and ended.json["sides"] == ["left", "right"] and ended.json["ok"] is True
    assert "60 s" in ended.err and "--take REASON" in ended.err and "`ta2 estop`" in ended.err


def test_a_reason_that_is_no_text_is_told_in_a_line(shell):
    """Bytes that are no UTF-8 come as lone surrogates."""
    ended = shell.run("home", "--take", "\udcff")
    assert ended.status == 1 and ended.err.splitlines()[-1].startswith("BAD_REQUEST: Take cannot be sent")


def test_move_takes_one_arm_or_both_absolute_or_by(shell):
    """What was typed is what is asked for."""
    assert shell.run("move", "--left", *GOAL, "--tolerance", "0.01").status == 0
    move = request_of(shell, requests.Move)
    assert move.targets_rad == {Side.LEFT: tuple(map(float, GOAL))} and move.tolerance_rad == 0.01
    shell.world.engine.requests.clear()
    arm = a_snapshot().arms["left"]
    right = replace(arm, measured=replace(arm.measured, q_rad=HOME_Q_RAD[Side.RIGHT]))
    shell.world.engine.show(arms={"left": arm, "right": right})
    offset = ["0", "0", "0", "1e-1", "0", "0", "-1E-2"]
    ended = shell.run("move", "--by", "--left", *offset, "--right", *ZEROS)
    assert ended.status == 0, ended.err
    move = request_of(shell, requests.Move)
    assert move.relative and move.targets_rad[Side.LEFT] == (0.0, 0.0, 0.0, 0.1, 0.0, 0.0, -0.01)
    assert "left arm  by +0.000 +0.000 +0.000 +0.100 +0.000 +0.000 -0.010 rad" in ended.err


def test_offsets_start_from_where_an_arm_is_held(shell):
    """The preview counts from the setpoint while there is one, as the gateway does."""
    held = replace(a_snapshot().arms["left"], streaming=True, q_ref_rad=(*START_Q[:6], 0.69), tracking_rad=0.4)
    shell.world.engine.show(arms={"left": held, "right": held})
    ended = shell.run("move", "--by", "--left", *ZEROS[:6], "0.02")
    assert ended.status == 1 and ended.err.startswith("OUT_OF_RANGE: left arm joint 7") and " 0.71" in ended.err


def test_clip_moves_to_the_limit_and_says_so(shell):
    """`--clip` asks for clipping and reports which joints were clipped."""
    ended = shell.run("move", "--left", "9", *GOAL[1:], "--clip")
    assert ended.status == 0 and "clipped to the limits: left_arm[3]" in ended.out
    assert request_of(shell, requests.Move).on_limit is requests.OnLimit.CLIP
    assert "left arm  by +1.700 " in ended.err
    assert shell.run("move", "--left", "9", *GOAL[1:], "--clip", "--json").json["clipped"] == ["left_arm[3]"]


POSE = ["0.30", "0.10", "-0.15", "0", "0", "0", "1"]


def in_pose_mode(shell, *sides):
    """Put arms into end-effector mode."""
    joint_mode = {side: side not in sides for side in ("left", "right")}
    shell.world.engine.show(mode=replace(a_snapshot().mode, joint_mode=joint_mode))


def test_move_pose_moves_an_end_effector_in_its_own_frame(shell):
    """How far it moves and turns is said before; the request has the arm's frame."""
    in_pose_mode(shell, "left")
    ended = shell.run("move-pose", "--left", *POSE, "--speed", "0.4")
    assert ended.status == 0, ended.err
    request = request_of(shell, requests.MovePose)
    assert dict(request.frames) == {Side.LEFT: "left_shoulder_base"} and request.speed == 0.4
    assert request.targets[Side.LEFT] == tuple(map(float, POSE))
    assert "left arm  by 50 mm and 0.000 rad, straight" in ended.err
    assert shell.world.engine.names() == ["Acquire", "Enable", "MovePose", "Release"]


def test_a_pose_beyond_the_reach_is_refused_before_anything_is_asked_for(shell):
    """Unless it is to be clipped."""
    in_pose_mode(shell, "left")
    ended = shell.run("move-pose", "--left", "0.6", *POSE[1:])
    assert ended.status == 1 and ended.err.startswith("OUT_OF_RANGE: the pose for the left arm")
    assert shell.world.engine.names() == []
    assert shell.run("move-pose", "--left", "0.6", *POSE[1:], "--clip").status == 0


@pytest.mark.parametrize(("options", "straight", "how"), [
    ([], False, "as the joints like"), (["--straight"], True, "straight"),
])  # fmt: skip
def test_move_pose_moves_an_arm_in_joint_mode_too_straight_if_wanted(shell, options, straight, how):
    """By the gateway's model of the body: what limits it is said before, and asked for."""
    ended = shell.run("move-pose", "--left", *POSE, "--speed", "0.4", *options)
    assert ended.status == 0, ended.err
    assert request_of(shell, requests.MovePose).straight is straight
    assert f"left arm  by 50 mm and 0.000 rad, {how}" in ended.err
    assert ("0.4 rad/s of each joint" in ended.err) is not straight


def test_an_arm_in_the_other_control_mode_is_refused_with_the_command_that_fits(shell):
    """Before anybody is asked, and before the robot is owned."""
    in_pose_mode(shell, "left")
    ended = shell.run("move", "--left", *GOAL)
    assert ended.status == 1 and ended.err.startswith("WRONG_CONTROL_MODE: the left arm is in end-effector mode")
    assert "ta2 move-pose`" in ended.err and shell.world.engine.names() == []


def test_poses_for_arms_in_different_control_modes_are_refused(shell):
    """One after the other they can be gone to."""
    in_pose_mode(shell, "left")
    ended = shell.run("move-pose", "--left", *POSE, "--right", *POSE)
    assert ended.status == 1 and ended.err.startswith("WRONG_CONTROL_MODE: the right arm is in joint mode")
    assert "one arm after the other" in ended.err and shell.world.engine.names() == []


def test_home_leaves_an_arm_in_end_effector_mode_alone_and_says_so(shell):
    """The initial position is one of joints; with both arms in that mode there is none."""
    in_pose_mode(shell, "right")
    ended = shell.run("home")
    assert ended.status == 0 and set(request_of(shell, requests.Move).targets_rad) == {Side.LEFT}
    assert "the right arm is in end-effector mode and stays" in ended.err
    in_pose_mode(shell, "left", "right")
    assert shell.run("home").err.startswith("WRONG_CONTROL_MODE: ")


def test_home_leaves_a_disabled_arm_alone_and_says_so(shell):
    """One arm is switched off: the other one moves; both: refused, nothing is asked for."""
    mode = a_snapshot().mode
    shell.world.engine.show(mode=replace(mode, arm_enabled={"left": True, "right": False}))
    ended = shell.run("home")
    assert ended.status == 0 and set(request_of(shell, requests.Move).targets_rad) == {Side.LEFT}
    assert "the right arm is disabled and stays" in ended.err
    shell.world.engine.show(mode=replace(mode, arm_enabled={"left": False, "right": False}))
    shell.world.engine.requests.clear()
    ended = shell.run("home")
    assert ended.status == 1 and ended.err.startswith("NO_ARM_ENABLED: ") and shell.world.engine.names() == []


# ------------------------------------------------------------------------------------------------------------- asking


@pytest.mark.parametrize(
    ("answer", "moves"), [("y\n", True), ("YES\n", True), ("n\n", False), ("\n", False), ("", False)]
)
def test_a_person_at_a_terminal_is_asked(shell, typed, monkeypatch, answer, moves):
    """Nothing but yes is yes, and what was typed before the question is thrown away; `nothing was done` is status 1."""
    flushed = typed(answer)
    monkeypatch.setattr(job, "teller", _plain_teller(job.teller))
    ended = shell.run("home")
    assert flushed == [True] and "[y/N]" in ended.err
    assert (ended.status, shell.world.engine.names() != []) == ((0, True) if moves else (1, False))
    assert ("nothing was done" in ended.err) is not moves


def _plain_teller(teller):
    """Return a teller that is plain although somebody pretends to sit at a terminal."""
    from contextlib import contextmanager

    from gateway.cli.terminal.progress import _Lines

    @contextmanager
    def plain():
        yield _Lines()

    return plain


def test_yes_asks_nobody(shell, typed, monkeypatch):
    """`--yes` moves at once, and a pipe or a script is never asked."""
    flushed = typed("n\n")
    monkeypatch.setattr(job, "teller", _plain_teller(job.teller))
    assert shell.run("home", "--yes").status == 0 and flushed == []


# ------------------------------------------------------------------------------------------------------------ refused


def test_a_goal_outside_the_limits_is_refused_before_anything_begins(shell):
    """No lease, no enabling: joint, value and bound, and what else can be asked for."""
    ended = shell.run("move", "--left", "9", *GOAL[1:])
    assert ended.status == 1 and shell.world.engine.names() == []
    assert ended.err.startswith("OUT_OF_RANGE: left arm joint 1") and ended.err.count("\n") == 1
    assert "-1.8" in ended.err and "§4.13" in ended.err and ended.err.endswith(" or ask for --clip\n")


def test_a_goal_that_is_no_number_is_refused(shell):
    """NaN is a number to Python and none to a robot."""
    ended = shell.run("move", "--left", "nan", *GOAL[1:])
    assert ended.status == 1 and ended.err.startswith("NOT_FINITE: ") and shell.names == []


def test_an_arm_that_was_never_seen_does_not_move(shell):
    """Without a measured arm nobody can say how far it would go."""
    arm = a_snapshot().arms["left"]
    shell.world.engine.show(arms={"left": replace(arm, measured=None), "right": arm})
    ended = shell.run("home")
    assert ended.status == 1 and ended.err.startswith("PART_STALE: ") and shell.world.engine.names() == []


@pytest.mark.parametrize("kind", [requests.Enable, requests.Move])
def test_what_was_refused_is_undone(shell, kind):
    """Enabling or the motion was refused: nothing moved, so the robot is released, and the reason is told last."""
    shell.world.engine.refusals[kind] = Refusal(code=Code.LATCHED, message="motion is latched off (ESTOP)")
    ended = shell.run("home", "--json")
    assert ended.status == 1 and shell.world.engine.names()[-1] == "Release"
    assert ended.err.splitlines()[-1].startswith("LATCHED: motion is latched off (ESTOP) -> ")
    assert ended.json["error"]["code"] == "LATCHED"


def test_a_refusal_does_not_drop_what_another_command_holds(shell):
    """Arms that were held before are still held after a refusal: somebody's grip hangs on it."""
    assert shell.run("home", "--hold").status == 0
    shell.world.engine.free()
    shell.world.engine.requests.clear()
    shell.world.engine.refusals[requests.Move] = Refusal(code=Code.PART_STALE, message="left arm")
    ended = shell.run("home")
    assert ended.status == 1 and shell.world.engine.names() == ["Acquire", "Enable", "Abandon"]
    assert "PART_STALE" in ended.err and "the arms are held" in ended.err


def test_enabling_that_fails_later_is_told_with_its_reason(shell):
    """The gateway gave up: the code of its reason, status 1."""
    shell.world.engine.enable_outcome = "ENABLE_TIMEOUT"
    ended = shell.run("home")
    assert ended.status == 1 and "ENABLE_TIMEOUT: READY was not seen" in ended.err
    assert shell.world.engine.names() == ["Acquire", "Enable", "Release"]


# -------------------------------------------------------------------------------------------------------- interrupted


def test_a_motion_that_is_ended_leaves_the_arms_held(shell):
    """Aborted by a fault: the code, and how to go on, since arms and grip are kept."""
    shell.world.engine.motion_end = "TRACKING_ERROR"
    ended = shell.run("home", "--json")
    assert ended.status == 1 and shell.world.engine.names()[-1] == "Abandon"
    assert ended.json["error"]["code"] == "TRACKING_ERROR" and "the arms are held" in ended.err


def interrupt_in_motion(shell, action):
    """Let something happen while the arms move."""
    shell.once(lambda: "Move" in shell.world.engine.names(), action)


def test_ctrl_c_leaves_the_arms_held_and_says_how_to_go_on(shell):
    """In mid-motion: left held at once, told so, status 130; nothing is disabled."""

    def ctrl_c():
        raise KeyboardInterrupt

    interrupt_in_motion(shell, ctrl_c)
    ended = shell.run("home")
    assert ended.status == 130 and shell.world.engine.names() == ["Acquire", "Enable", "Move", "Abandon"]
    assert "interrupted: the arms are held with their grip for 60 s" in ended.err and not ended.out


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_sigterm_and_sighup_are_like_ctrl_c(shell, number, status):
    """Whoever ends the process or closes its terminal leaves the arms held, at once and not by a timeout."""
    interrupt_in_motion(shell, lambda: signal.raise_signal(number))
    assert shell.run("home").status == status
    assert shell.world.engine.names()[-1] == "Abandon"


def test_a_motion_that_takes_too_long_is_unknown_and_held(shell):
    """`--timeout` is counted from the beginning of the motion; its end is status 4, progress included."""
    shell.once(lambda: "Move" in shell.world.engine.names(), shell.world.engine._countdowns.clear)
    ended = shell.run("home", "--timeout", "1.5")
    assert ended.status == 4 and "TIMEOUT: motion 1 has not ended within 1.5 s: 50%, 0.200 rad to go" in ended.err
    assert "--timeout" in ended.err and "the arms are held" in ended.err


def test_a_gateway_that_goes_in_mid_motion_is_status_3(shell):
    """Nobody can say what is held when nobody answers."""
    interrupt_in_motion(shell, lambda: shell.world.plane.set_reachable(False))
    ended = shell.run("home")
    assert ended.status == 3 and "DISCONNECTED" in ended.err and "are held" not in ended.err


# ------------------------------------------------------------------------------------------------------------- owning


def test_somebody_elses_robot_is_refused(shell):
    """An owner who lives is not waited for; his name is told."""
    lease = replace(a_snapshot().lease, owned=True, name="policy-a", client_id="other", pid=5, epoch=7)
    shell.world.engine.show(lease=lease, state="ACTIVE")
    ended = shell.run("home")
    assert "are held" not in ended.err  # not by us
    assert ended.status == 1 and ended.err.splitlines()[-1].startswith("LEASE_HELD: 'policy-a'")
    assert "--take REASON" in ended.err


def test_a_reason_takes_the_robot(shell):
    """`--take` goes to the gateway with the reason, and the command is the owner's name."""
    lease = replace(a_snapshot().lease, owned=True, name="policy-a", client_id="other", pid=5, epoch=7)
    shell.world.engine.show(lease=lease)
    assert shell.run("home", "--take", "my turn").status == 0
    take = request_of(shell, requests.Take)
    assert (take.reason, take.name) == ("my turn", "ta2 home")


@pytest.mark.parametrize("is_back", [False, True])
def test_an_owner_who_has_left_is_waited_for(shell, is_back):
    """The clock of the loss runs: the command waits until the lease is free; when the owner is back, it is refused."""
    gone = replace(
        a_snapshot().lease,
        owned=True,
        name="policy-a",
        client_id="other",
        pid=5,
        epoch=7,
        lost_ns=1,
        free_in_ns=4 * 10**9,
    )
    shell.world.engine.show(lease=gone)
    back = replace(gone, lost_ns=None, free_in_ns=None)
    shell.after_ticks(100, lambda: shell.world.engine.show(lease=back) if is_back else shell.world.engine.free())
    ended = shell.run("home")
    assert "wait: 'policy-a' (pid 5) has left; free in 4.0 s (--take REASON: now)" in ended.err
    assert ended.status == (1 if is_back else 0)
    assert ("LEASE_HELD" in ended.err) is is_back


def test_a_stale_robot_says_what_it_is(shell):
    """What the gateway refuses with is told as it came, with the hint in words of a shell."""
    shell.world.engine.show(link=LinkView(up=True, router_zid="a", fresh=False, age_ns=10**9), state="STALE")
    shell.world.engine.refusals[requests.Enable] = Refusal(code=Code.STATE_STALE, message="1 s old")
    ended = shell.run("home")
    assert ended.status == 1 and "STATE_STALE: 1 s old -> wait for fresh state; see `ta2 topics`" in ended.err
