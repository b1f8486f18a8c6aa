"""The door for chunks: each way in which points cannot be followed has its code, and the first point to blame is named."""

from __future__ import annotations

import math

import pytest

from gateway.core.motion.chunk import MAX_LEAD_NS, MAX_POINTS, Chunk, check_jump, check_motion, check_start, prepare
from gateway.errors import Code, Refusal
from gateway.robot.limits import HOME_Q_RAD, JOINT_UPPER_RAD
from gateway.settings.settings import ArmSettings
from gateway.values import Side

LEFT, RIGHT = Side.LEFT, Side.RIGHT
HOME = HOME_Q_RAD
ARM = ArmSettings()


def points(count=20, side=LEFT, rise=0.005, joint=2):
    """A joint that moves evenly from home."""
    return [tuple(q + (rise * i if n == joint else 0.0) for n, q in enumerate(HOME[side])) for i in range(count)]


def swap(rows, index, joint, value):
    """The same points with one number changed."""
    return [tuple(value if (i, n) == (index, joint) else q for n, q in enumerate(row)) for i, row in enumerate(rows)]


def refused(arms, **kinds) -> Refusal:
    """Prepare points that must be refused."""
    made = prepare(arms, **(kinds or {"dt_s": 0.1}))
    assert isinstance(made, Refusal), made
    return made


# --------------------------------------------------------------------------------------------------- the input itself


def test_points_of_both_arms_become_trajectories_on_one_clock():
    """Even times from dt, or times that begin later: the offset is told."""
    made = prepare({RIGHT: points(side=RIGHT), LEFT: points()}, dt_s=0.1)
    assert isinstance(made, Chunk) and list(made.trajectories) == [LEFT, RIGHT]
    assert made.duration_s == pytest.approx(1.9) and (made.offset_s, made.moved) == (0.0, 0.0)
    late = prepare({LEFT: points(3)}, times_s=[0.5, 0.7, 1.0])
    assert late.offset_s == 0.5 and late.trajectories[LEFT].times_s == pytest.approx((0.0, 0.2, 0.5))


def test_stretch_makes_all_of_it_slower():
    """Times and offset."""
    made = prepare({LEFT: points(3)}, times_s=[0.5, 0.7, 1.0], stretch=2.0)
    assert made.offset_s == 1.0 and made.duration_s == pytest.approx(1.0)


def test_no_arm_is_no_chunk():
    """One or two are needed."""
    assert refused({}).code is Code.WRONG_SHAPE


@pytest.mark.parametrize("count", [0, 1, MAX_POINTS + 1])
def test_the_number_of_points_is_bounded(count):
    """2 to 450, and the refusal says so; a longer one is sent in parts."""
    refusal = refused({LEFT: points(count, rise=0.0)}, dt_s=0.01)
    assert (refusal.code, refusal.field, refusal.value) == (Code.WRONG_SHAPE, "left_arm", str(count))
    assert refusal.bound == "[2, 450]" and ("several chunks" in refusal.hint) is (count > 2)
    assert ("two points" in refusal.hint) is (count < 2)


def test_the_largest_chunk_passes():
    """450 points for both arms."""
    assert isinstance(prepare({s: points(MAX_POINTS, s, 0.0) for s in Side}, dt_s=1 / 45), Chunk)


def test_both_arms_need_as_many_points():
    """One clock."""
    refusal = refused({LEFT: points(5), RIGHT: points(4, RIGHT)})
    assert (refusal.code, refusal.value) == (Code.WRONG_SHAPE, "5 and 4")


def test_a_point_without_seven_joints_is_named():
    """The first one."""
    rows = points(5)
    rows[2], rows[3] = rows[2][:6], (*rows[3], 0.0)
    refusal = refused({LEFT: rows})
    assert (refusal.code, refusal.field, refusal.value) == (Code.WRONG_SHAPE, "left_arm[2]", "6")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_named(bad):
    """The first point, the joint, the value."""
    refusal = refused({LEFT: swap(swap(points(), 4, 6, bad), 3, 5, bad)})
    assert (refusal.code, refusal.field) == (Code.NOT_FINITE, "left_arm[3][5]")
    assert refusal.value == str(bad) and "point 3 joint 6 (l_joint6)" in refusal.message


def test_a_point_outside_the_robots_limits_is_named_before_anything_is_worked_out():
    """Manual §4.13; absurd numbers go no further."""
    refusal = refused({RIGHT: swap(points(side=RIGHT), 7, 3, 1e308)})
    assert (refusal.code, refusal.field, refusal.bound) == (Code.OUT_OF_RANGE, "right_arm[7][3]", "[-2.2, -0.25]")


@pytest.mark.parametrize("times", [{}, {"dt_s": 0.1, "times_s": [0.1 * n for n in range(20)]}])
def test_either_dt_or_times_is_needed(times):
    """Neither and both are refused."""
    made = prepare({LEFT: points()}, **times)
    assert isinstance(made, Refusal) and made.code is Code.BAD_REQUEST


@pytest.mark.parametrize(
    ("kinds", "code", "field"),
    [
        ({"dt_s": 0.0}, Code.OUT_OF_RANGE, "dt_s"),
        ({"dt_s": math.nan}, Code.NOT_FINITE, "dt_s"),
        ({"dt_s": 0.0009}, Code.OUT_OF_RANGE, "dt_s"),
        ({"dt_s": 3.2}, Code.OUT_OF_RANGE, "duration"),
        ({"dt_s": 0.1, "stretch": 0.99}, Code.OUT_OF_RANGE, "stretch"),
        ({"dt_s": 0.1, "stretch": 101.0}, Code.OUT_OF_RANGE, "stretch"),
        ({"dt_s": 0.1, "stretch": 40.0}, Code.OUT_OF_RANGE, "duration"),
        ({"dt_s": 0.1, "stretch": math.inf}, Code.NOT_FINITE, "stretch"),
        ({"dt_s": 0.1, "smoothing_s": -0.1}, Code.OUT_OF_RANGE, "smoothing_s"),
        ({"dt_s": 0.1, "smoothing_s": 1.1}, Code.OUT_OF_RANGE, "smoothing_s"),
        ({"dt_s": 0.1, "smoothing_s": math.nan}, Code.NOT_FINITE, "smoothing_s"),
        ({"dt_s": 0.1, "smoothing_s": 0.04}, Code.OUT_OF_RANGE, "smoothing_s"),
        ({"times_s": [0.1 * n for n in range(20)], "smoothing_s": 0.1}, Code.BAD_REQUEST, "smoothing_s"),
        ({"times_s": [0.1 * n for n in range(19)]}, Code.WRONG_SHAPE, "times_s"),
        ({"times_s": [0.1 * n - 0.05 for n in range(20)]}, Code.OUT_OF_RANGE, "times_s[0]"),
        ({"times_s": [0.1 * n if n != 4 else 0.3 for n in range(20)]}, Code.OUT_OF_RANGE, "times_s[4]"),
        ({"times_s": [0.1 * n if n != 4 else math.nan for n in range(20)]}, Code.NOT_FINITE, "times_s[4]"),
        ({"times_s": [5.0 * n for n in range(20)]}, Code.OUT_OF_RANGE, "times_s[13]"),
    ],
)
def test_times_that_are_none_are_refused(kinds, code, field):
    """Finite, rising by a millisecond at least, from 0 to 60 s; stretched and smoothed within bounds."""
    refusal = refused({LEFT: points()}, **kinds)
    assert (refusal.code, refusal.field) == (code, field)


def test_smoothing_that_reaches_beyond_all_points_is_refused():
    """It needs as many neighbours."""
    assert refused({LEFT: points(5)}, dt_s=0.1, smoothing_s=0.5).bound == "[0.1, 0.4]"


def test_smoothing_says_how_far_it_moved_a_point():
    """Jitter of 1 mrad at 30 Hz, which no limit would let pass, passes; nothing is silently changed."""
    rows = [tuple(q + 0.001 * (-1) ** (i * n) for n, q in enumerate(HOME[LEFT])) for i in range(40)]
    rough = prepare({LEFT: rows}, dt_s=1 / 30)
    smooth = prepare({LEFT: rows}, dt_s=1 / 30, smoothing_s=0.1)
    assert check_motion(LEFT, rough.trajectories[LEFT], ARM).code is Code.TOO_FAST
    assert check_motion(LEFT, smooth.trajectories[LEFT], ARM) is None
    assert rough.moved == 0.0 and 0.0009 < smooth.moved < 0.0025


# --------------------------------------------------------------------------------------------------- the motion


def motion(rows, dt_s=0.1, side=LEFT, arm=ARM):
    """Judge the motion through points."""
    made = prepare({side: rows}, dt_s=dt_s)
    assert isinstance(made, Chunk), made
    return check_motion(side, made.trajectories[side], arm)


def test_a_motion_inside_all_limits_passes():
    """An even one at half the velocity limit."""
    assert motion(points()) is None


def test_a_configured_limit_names_the_first_point_beyond_it():
    """Tighter than the robot's own."""
    tight = ArmSettings(upper_rad={**ARM.upper_rad, LEFT: (1.8, 1.9, -0.4, 2.2, 1.8, 1.4, 0.7)})
    refusal = motion(points(30), arm=tight)
    first = next(i for i, row in enumerate(points(30)) if row[2] > -0.4)
    assert (refusal.code, refusal.field) == (Code.OUT_OF_RANGE, f"left_arm[{first}][2]")
    outside = motion(
        points(30, rise=-0.005),
        arm=ArmSettings(lower_rad={**ARM.lower_rad, LEFT: (-1.8, 0, -0.46, 0.25, -1.8, -1.4, -0.7)}),
    )
    assert outside.field == "left_arm[0][2]"


def test_a_turn_between_two_points_beyond_a_limit_is_seen():
    """All points are inside; the motion between them is not."""
    top = JOINT_UPPER_RAD[LEFT][6]
    rise = [0.62, 0.65, 0.68, 0.698, 0.698, 0.68, 0.65, 0.62]
    rows = [(*HOME[LEFT][:6], q) for q in rise]
    refusal = motion(rows)
    assert refusal is not None and refusal.field == "left_arm[3][6]" and float(refusal.value) > top


@pytest.mark.parametrize(
    ("rise", "unit", "index"),
    [(0.12, "rad/s", 0), (-0.12, "rad/s", 0)],
)
def test_too_fast_a_motion_names_joint_value_bound_and_the_stretch_that_would_do(rise, unit, index):
    """The factor is enough, and hardly more than enough."""
    rows = [(rise * i, *HOME[LEFT][1:]) for i in range(10)]
    refusal = motion(rows)
    assert (refusal.code, refusal.field, refusal.unit) == (Code.TOO_FAST, f"left_arm[{index}][0]", unit)
    assert refusal.value == "1.2" and refusal.bound == "1" and "l_joint1" in refusal.message
    assert "stretch=1.2 " in refusal.hint
    assert motion(rows, dt_s=0.1 * 1.2) is None


def test_too_hard_a_bend_is_refused_though_every_step_is_slow_enough():
    """Acceleration and jerk of the motion, not of the points; the first point to blame, whichever joint's."""
    rows = points(20, rise=0.0)
    bent = [
        tuple(q + (0.04 * max(i - 9, 0) if n == 4 else 0.0) for n, q in enumerate(row)) for i, row in enumerate(rows)
    ]
    refusal = motion(bent)
    assert refusal.code is Code.TOO_FAST and refusal.unit in {"rad/s²", "rad/s³"}
    assert 6 <= int(refusal.field.split("[")[1].rstrip("]")) <= 9
    factor = float(refusal.hint.split("stretch=")[1].split(" ")[0])
    assert motion(bent, dt_s=0.1 * factor) is None and motion(bent, dt_s=0.1 * factor * 0.98) is not None


def test_of_several_offences_the_first_point_is_told():
    """A later joint may be the first to offend."""
    rows = [tuple(q + (0.11 * max(i - 10, 0) if n == 0 else 0.0) for n, q in enumerate(HOME[LEFT])) for i in range(16)]
    rows = [(*row[:5], row[5] + 0.08 * max(i - 4, 0), row[6]) for i, row in enumerate(rows)]
    rows = [(*row[:5], min(row[5], 0.5), row[6]) for row in rows]
    refusal = motion(rows)
    assert refusal.field.endswith("[5]") and int(refusal.field.split("[")[1].rstrip("]")) <= 4


# --------------------------------------------------------------------------------------------------- jump and start


def test_a_chunk_may_begin_a_tenth_of_a_radian_from_the_reference():
    """BEHAVIOUR: 0.1 rad per joint, not a hair more; the joint that is farthest is named."""
    q = HOME[LEFT]
    assert check_jump(LEFT, q, 0.0, (q[0] + 0.1, *q[1:5], q[5] - 0.0999, q[6])) is None
    refusal = check_jump(LEFT, q, 0.0, (q[0] + 0.11, *q[1:5], q[5] - 0.2, q[6]))
    assert (refusal.code, refusal.field, refusal.value) == (Code.JUMP_TOO_FAR, "left_arm[0][5]", "0.2")
    assert (refusal.bound, refusal.unit) == ("0.1", "rad") and "at its first point" in refusal.message


def test_a_chunk_that_began_earlier_is_judged_where_it_is_now():
    """And the refusal says so."""
    q = HOME[RIGHT]
    assert "0.300 s after its first point" in check_jump(RIGHT, q, 0.3, (q[0] + 0.2, *q[1:])).message


def test_a_chunk_that_is_over_or_far_ahead_is_refused():
    """All points have passed; or it begins in more than 10 s."""
    assert (
        check_start(-MAX_LEAD_NS, 1.0) is None and check_start(0, 1.0) is None and check_start(999_999_999, 1.0) is None
    )
    late = check_start(1_500_000_000, 1.0)
    assert late.code is Code.TOO_LATE and "0.500 s ago" in late.message
    early = check_start(-MAX_LEAD_NS - 1, 1.0)
    assert (early.code, early.field) == (Code.OUT_OF_RANGE, "start")
