"""Tests of the live view: frames of any size, and the viewer that feeds them."""

from __future__ import annotations

import os
import pty
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from rich.console import Console

from gateway.cli.looking import watch as watching
from gateway.cli.looking.frame import Picture, Remark, frame
from gateway.cli.looking.watch import Viewer, plain_line
from gateway.client import connect
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import Code
from gateway.messages.snapshot import (
    ContactView,
    LeaseView,
    LinkView,
    MotionView,
    SlowingView,
    SpacingView,
    StreamView,
    TargetView,
    TouchView,
)
from tests.api.stand_in import a_snapshot
from tests.cli.views import INFO, MS, S, a_view, all_topics, owned
from tests.client.world import World

SIZES = [(80, 24), (100, 30), (120, 40), (140, 45), (250, 80), (60, 24), (30, 10), (20, 3)]
MOVING = {
    "state": "ACTIVE",
    "shown": "ACTIVE",
    "fsm": 2,
    "lease": owned(),
    "streams": {
        "/api/left_arm/joint_cmd": StreamView(running=True, sent=900, rate_hz=100.0, worst_gap_ns=11 * MS),
        "/api/fsm/enable": StreamView(running=True, sent=90, rate_hz=20.0, worst_gap_ns=1200 * MS),
        "/api/new/thing": StreamView(running=False, sent=0, rate_hz=0.0, worst_gap_ns=0),
    },
    "motions": (
        MotionView(
            motion_id=3,
            sides=("left", "right"),
            state="executing",
            progress=0.62,
            error_rad=0.213,
            duration_ns=3 * S,
            code="",
            message="",
            space="joint",
            error_m=None,
        ),
    ),
    "targets": (
        TargetView(
            stream_id=1,
            side="left",
            open=True,
            code="",
            seq=77,
            refused=2,
            refusal_code="OUT_OF_RANGE",
            refusal_message="m",
            limited=True,
            space="joint",
        ),
    ),
}
SPACING = SpacingView(on=True, why="", gap_m=0.143, first="left_palm", second="right_forearm", margin_m=0.02, held=())
LATCHED = {
    "shown": "FAULT",
    "latches": {"TRACKING_ERROR": "left arm joint 4 is 0.35 rad off", "STOPPED_BY_OTHER": "stop() by a colleague"},
}
LOST = {"state": "HOLDING", "shown": "HOLDING", "fsm": 2,
        "lease": owned(lost_ns=S, free_in_ns=9 * S, down_in_ns=59 * S)}  # fmt: skip
OFFLINE = {"state": "OFFLINE", "shown": "OFFLINE", "fsm": None, "mode": None,
           "link": LinkView(up=False, router_zid="", fresh=False, age_ns=None)}  # fmt: skip
CASES = {"rest": {}, "moving": MOVING, "latched": LATCHED, "lost": LOST, "offline": OFFLINE}
REMARKS = tuple(
    Remark(clock=f"17:32:{n:02}", level=level, text=f"CODE_{n}: {'something happened ' * 9}")
    for n, level in enumerate(["info", "warning", "error"] * 5)
)


def picture(since_ns=0, remarks=REMARKS, trouble="", is_live=True, **changes):
    """Return a picture of a snapshot."""
    return Picture(
        address="unix:/run/ta2/gateway.sock",
        info=INFO,
        view=a_view(**changes),
        since_ns=since_ns,
        remarks=remarks,
        trouble=trouble,
        is_live=is_live,
    )


def text_of(lines):
    """Return a frame as a person reads it."""
    return "\n".join(line.plain for line in lines)


# -------------------------------------------------------------------------------------------------------------- frames


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_a_frame_fits_every_terminal(case, width, height):
    """No line is wider and there are never more than the terminal has; rich draws it without another line."""
    lines = frame(picture(**CASES[case]), width, height)
    assert len(lines) <= height
    assert all(line.cell_len <= width for line in lines), [line.plain for line in lines if line.cell_len > width]
    console = Console(width=width, height=height, force_terminal=True, color_system="truecolor")
    with console.capture() as capture:
        for line in lines:
            console.print(line)
    drawn = re.sub(r"\x1b\[[0-9;]*m", "", capture.get()).splitlines()
    assert len(drawn) == len(lines) and all(len(line) <= width for line in drawn)


@given(st.integers(-5, 300), st.integers(-5, 90), st.sampled_from(sorted(CASES)), st.integers(0, 10**13))
def test_no_size_and_no_age_breaks_a_frame(width, height, case, since_ns):
    """Whatever size the terminal claims to have."""
    lines = frame(picture(since_ns, **CASES[case]), width, height)
    assert all(line.cell_len <= max(width, 20) for line in lines) and len(lines) <= max(height, 0)


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40)])
def test_a_frame_of_a_moving_robot_has_the_key_facts(width, height):
    """State, FSM, link, owner, every joint of both arms, topics, streams, motion, and the newest notice."""
    text = text_of(frame(picture(**MOVING), width, height))
    for fact in (
        "ACTIVE", "READY (2)", "link 2.0 ms", "API mode", "policy-a (pid 123), epoch 4", "for 10.0 s", "q ends",
        "LEFT ARM", "RIGHT ARM", "+0.900", "left_arm/joint_states", "current_mode", "TO THE ROBOT",
        "left_arm/joint_cmd    100  11ms", "motion 3 left+right", "62%", "0.213 rad off", "CODE_14",
        "targets left #77, 2 bad",
    ):  # fmt: skip
        assert fact in text, fact
    assert text.count("●") == 14


@pytest.mark.parametrize(
    ("seen", "words", "style"),
    [
        ({}, ("143 mm of 20 mm free", "left_palm - right_forearm"), "dim"),
        ({"gap_m": 0.031}, ("31 mm of 20 mm free",), "bold yellow"),
        ({"gap_m": 0.05, "held": ("left", "right")}, ("50 mm of 20 mm free, left+right held back",), "bold yellow"),
        ({"on": False, "why": "the model differs", "gap_m": None}, ("not kept apart: the model differs",), "yellow"),
        ({"gap_m": None}, ("not kept apart: joints not heard",), "yellow"),
    ],
)
def test_a_frame_shows_how_near_the_arms_are(seen, words, style):
    """Gap, margin and pair where arms are kept apart, and loudly when it is little; else why they are not."""
    lines = frame(picture(spacing=replace(SPACING, **seen)), 120, 40)
    assert all(word in text_of(lines) for word in words)
    line = next(line for line in lines if words[0] in line.plain)
    assert style in {str(span.style) for span in line.spans}


def test_a_frame_shows_poses_that_are_followed_slower():
    """Part of the speed and the joint, while that is what holds the arm back."""
    near = SlowingView(on=True, why="", speed_ratio=0.34, held=True, joint=4, joint_radps=8.8, bound_radps=3.0)
    shown = text_of(frame(picture(slowing={"left": near, "right": replace(near, held=False)}), 120, 40))
    assert "left at 34%: joint 4 near a singularity" in shown and "right at" not in shown


FELT = ContactView(
    state="known", torque_nm=(0.0,) * 7, torque_sd_nm=(0.1,) * 7, frame="left_shoulder_base", point="left_ee",
    wrench=(1.0, -8.24, None, 0.0, 0.1, 0.0), wrench_sd=(2.0, 1.5, None, 0.1, 0.1, 0.1), sigmas=5.0,
)  # fmt: skip
TOUCH = TouchView(
    number=2, side="left", at_ns=a_view().at_ns - 3_000_000_000, force_n=12.4, sd_n=1.5, threshold_n=8.0, direction=(),
    wrench=(), frame="left_shoulder_base", p_m=(0.34, 0.09, -0.3), is_own=False, back_id=0,
)  # fmt: skip


def test_a_frame_shows_what_pulls_at_the_arms():
    """Forces with standard deviations, loudly when it is something; what is held; the last touch; or why nothing is known."""
    unknown = ContactView(state="unknown", code="NO_EFFORTS", reason="the robot sends none")
    arms = a_view().arms
    for sigmas, style in ((5.0, "bold yellow"), (1.0, "dim")):
        left = replace(arms["left"], contact=replace(FELT, sigmas=sigmas, load_kg=0.302), touch=TOUCH)
        lines = frame(picture(arms={"left": left, "right": replace(arms["right"], contact=unknown)}), 120, 40)
        line = next(line for line in lines if "left feels +1.0±2.0 -8.2±1.5 ? N" in line.plain)
        assert style in {str(span.style) for span in line.spans} and line.plain.rstrip().endswith(" N, holds 0.302 kg")
        assert "  touch 2: 12.4±1.5 N, 3.0 s ago" in text_of(lines)
        assert "right feels nothing known: NO_EFFORTS" in text_of(lines)
    assert "feels" not in text_of(frame(picture(), 120, 40))


def test_a_frame_says_nothing_of_what_nobody_asked_for():
    """Where arms are not to be kept apart."""
    assert "mm free" not in text_of(frame(picture(spacing=None), 120, 40))


def test_what_is_latched_is_as_loud_as_a_terminal_can_be():
    """Each cause fills its line in reverse red, with the remedy; small terminals say how many more there are."""
    lines = frame(picture(**LATCHED), 80, 24)
    loud = [line for line in lines if "reverse" in str(line.style) and "red" in str(line.style)]
    assert len(loud) >= 1 and all(line.cell_len == 80 for line in loud)
    assert "TRACKING_ERROR: left arm joint 4 is 0.35 rad off" in loud[0].plain
    assert "more lines: `ta2 status`" in text_of(lines)
    tall = text_of(frame(picture(**LATCHED), 80, 40))
    assert "STOPPED_BY_OTHER" in tall and "`ta2 recover`" in tall


def test_the_clocks_of_a_lost_owner_count_on():
    """Time that passed since the snapshot is counted, up for the silence, down for what will happen."""
    text = text_of(frame(picture(500 * MS, **LOST), 120, 40))
    assert "SILENT 1.5 s" in text and "free in 8.5 s" in text and "robot pauses in 58.5 s" in text
    unowned = replace(a_snapshot().lease, down_in_ns=30 * S)
    assert isinstance(unowned, LeaseView)
    assert "robot pauses in 30.0 s" in text_of(frame(picture(state="HOLDING", fsm=2, lease=unowned), 80, 24))


def test_trouble_of_the_view_itself_comes_first():
    """Without a gateway nothing below is news: the state is said to be of the past."""
    lines = frame(picture(9 * S, trouble="NO GATEWAY: gone"), 80, 24)
    assert " was READ_ONLY " in lines[1].plain and "NO GATEWAY" in lines[3].plain and "9.0 s" in lines[1].plain
    assert "q ends" not in text_of(frame(picture(is_live=False), 80, 24))


def test_topics_show_what_is_wrong_with_them():
    """Silence, a slow rate, copies and refused samples are told at the topic; streams that were late are red."""
    topics = all_topics()
    topics["/left_arm/joint_states"] = replace(topics["/left_arm/joint_states"], age_ns=None)
    topics["/right_arm/joint_states"] = replace(
        topics["/right_arm/joint_states"], rate_hz=90.0, duplicates=4, refused=1
    )
    topics["/later/topic"] = topics["/fsm_state"]
    lines = frame(picture(**{**MOVING, "topics": topics}), 120, 40)
    silent = next(line for line in lines if line.plain.startswith("left_arm/joint_states"))
    assert "never" in silent.plain
    assert "dup 4 bad 1" in text_of(lines) and "later/topic" in text_of(lines)
    late = next(line for line in lines if "fsm/enable" in line.plain)
    assert any("red" in str(span.style) for span in late.spans)


def test_an_ended_motion_stays_to_be_seen():
    """The latest motion that ended, with its code; a running one replaces it."""
    motion = MotionView(
        motion_id=8,
        sides=("left",),
        state="aborted",
        progress=0.4,
        error_rad=None,
        duration_ns=S,
        code="TRACKING_ERROR",
        message="m",
        space="joint",
        error_m=None,
    )
    assert "motion 8 aborted TRACKING_ERROR" in text_of(frame(picture(motions=(motion,)), 80, 24))
    assert "motion 8" not in text_of(frame(picture(**{**MOVING, "motions": (motion, *MOVING["motions"])}), 80, 24))


def test_notices_are_wrapped_where_there_is_room_and_cut_where_there_is_not():
    """The newest is at the bottom, whole on a tall terminal, a line on a small one; an empty view says so."""
    tall = frame(picture(), 80, 45)
    assert tall[-1].plain.startswith("         ") and "CODE_14" in text_of(tall[-3:])
    small = frame(picture(), 80, 24)
    assert small[-1].plain.startswith("17:32:14 CODE_14") and small[-1].plain.endswith("…")
    assert frame(picture(remarks=()), 80, 24)[-1].plain == "no notices yet"


# -------------------------------------------------------------------------------------------------------------- viewer


@pytest.fixture
def world():
    """A daemon and a scripted engine in virtual time."""
    return World()


@pytest.fixture
def viewer(world, monkeypatch):
    """A viewer of it, whose waits for a gateway let virtual time pass."""
    monkeypatch.setattr(watching.time, "sleep", lambda seconds: world.run(seconds))
    with connect(transport=world.transport(), name="ta2 watch") as robot:
        yield Viewer(robot)


def test_a_viewer_takes_snapshots_and_notices(world, viewer):
    """Each look brings a newer snapshot and what was said meanwhile, with the time of day it was said."""
    before = viewer.state.seq
    world.engine.notices = [Notice(code=Code.LINK_UP, level=Level.WARNING, message="there", at_ns=world.time_ns)]
    world.run(0.05)
    (remark,) = viewer.look(0.2)
    assert remark.text == "LINK_UP: there" and remark.level == "warning" and re.match(r"\d\d:\d\d:\d\d$", remark.clock)
    assert viewer.state.seq > before
    assert viewer.look(0.2) == []
    shown = viewer.picture()
    assert shown.remarks == (remark,) and shown.address == "memory" and not shown.trouble
    console = Console(width=80, height=24)
    with console.capture() as capture:
        console.print(viewer)
    assert "LINK_UP: there" in capture.get()


def test_a_viewer_outlives_its_gateway(world, viewer):
    """Gone: said once, loudly, with the last view. Back, with other limits perhaps: said once, and everything is new."""
    viewer.look(0.2)
    world.plane.set_reachable(False)
    world.run(1.5)
    (remark,) = viewer.look(0.2)
    assert remark.level == "error" and remark.text.startswith("DISCONNECTED: ")
    assert viewer.look(0.2) == [] and "`ta2 run`" in viewer.trouble
    world.plane._daemon_id = "second"
    world.plane.set_reachable(True)
    world.engine.show(state="OFFLINE")
    (remark,) = viewer.look(0.2)
    assert remark.text == "the gateway is back" and not viewer.trouble
    assert viewer.state.state == "OFFLINE"


def test_a_silent_gateway_is_not_taken_for_a_living_one(world, viewer):
    """A daemon that is there and says nothing: the old snapshot is no news, however often one looks."""
    viewer.look(0.2)
    world.engine.frozen = True
    (remark,) = viewer.look(0.2)
    assert remark.text.startswith("TIMEOUT: ") and "NO NEWS" in viewer.trouble
    for _ in range(3):
        assert viewer.look(0.2) == [] and viewer.trouble
    assert "was READ_ONLY" in text_of(frame(viewer.picture(), 80, 24))
    world.engine.frozen = False
    world.run(0.1)
    assert [remark.text for remark in viewer.look(0.2)] == ["the gateway is back"]


def test_a_plain_line_tells_the_most():
    """State, FSM, link, owner, errors and motion on one line, for logs and pipes."""
    arms = {side: replace(a_snapshot().arms[side], tracking_rad=0.004) for side in ("left", "right")}
    line = plain_line(picture(**{**MOVING, "arms": arms}))
    for fact in ("ACTIVE", "fsm READY (2)", "link 2.0 ms", "owner policy-a", "left off by 0.004 rad", "motion 3 62%"):
        assert fact in line
    assert "left_arm/joint_cmd 100 Hz gap 11 ms" in line and "\n" not in line
    assert "TRACKING_ERROR" in plain_line(picture(**LATCHED))
    assert "link down | owner nobody" in plain_line(picture(**OFFLINE))


# ------------------------------------------------------------------------------------------------------------- command


def test_once_prints_one_frame(shell, monkeypatch):
    """A frame of at least 24 lines' room, as wide as the terminal says, and the end."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("LINES", "10")
    ended = shell.run("watch", "--once")
    assert ended.status == 0 and "LEFT ARM" in ended.out and "no notices yet" in ended.out
    assert 10 < ended.out.count("\n") <= 24 and all(len(line) <= 100 for line in ended.out.splitlines())
    assert shell.names == ["ta2 watch"]


def test_without_a_terminal_it_prints_lines_until_ctrl_c(shell):
    """A line a second and every notice as it comes; Ctrl-C is its normal end."""
    world = shell.world

    def on_tick():
        if world.ticks == 150:
            world.engine.notices = [Notice(code=Code.LINK_DOWN, level=Level.ERROR, message="gone", at_ns=0)]
        elif world.ticks == 350:
            raise KeyboardInterrupt

    world.on_tick = on_tick
    ended = shell.run("watch")
    assert ended.status == 0 and ended.out.count("READ_ONLY | fsm PAUSE (0)") in (3, 4)
    assert re.search(r"^\d\d:\d\d:\d\d error   LINK_DOWN: gone$", ended.out, re.MULTILINE)


def test_on_a_terminal_q_ends_it_and_the_terminal_is_as_before(shell, monkeypatch):
    """Frames on the alternate screen; q is taken without Enter; modes of the terminal are given back."""
    import termios

    ours, theirs = pty.openpty()
    try:
        before = termios.tcgetattr(theirs)
        with os.fdopen(theirs, "r", closefd=False) as keyboard:
            monkeypatch.setattr("sys.stdin", keyboard)
            monkeypatch.setattr("gateway.cli.terminal.keys._is_ours", lambda file: True)  # it is not this process's own
            monkeypatch.setenv("TTY_INTERACTIVE", "1")
            monkeypatch.setenv("FORCE_COLOR", "1")
            monkeypatch.setenv("TERM", "xterm")
            seen = []

            def on_tick():
                if shell.world.ticks == 60:
                    seen.append(termios.tcgetattr(theirs)[3] & termios.ICANON)
                    os.write(ours, b"xq")

            shell.world.on_tick = on_tick
            ended = shell.run("watch")
        assert ended.status == 0 and "\x1b[?1049h" in ended.out and "\x1b[?1049l" in ended.out
        assert seen == [0] and termios.tcgetattr(theirs) == before
        assert "LEFT ARM" in ended.out
    finally:
        os.close(ours)
        os.close(theirs)
