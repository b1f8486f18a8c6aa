"""Tests of how things show themselves: short in a terminal, as a table in a notebook, without waiting or failing."""

from __future__ import annotations

import numpy as np

from gateway.client import connect
from tests.api.stand_in import START_Q


def test_a_state_is_one_line_and_a_small_table(world, robot):
    """A cell that ends with `robot.state` says what matters, in a line or a table."""
    line = repr(robot.state)
    assert line.startswith("<state ") and "READ_ONLY, FSM PAUSE, link fresh, unowned" in line and len(line) < 120
    table = robot.state._repr_html_()
    assert table.count("<table>") == 1 and "READ_ONLY" in table and "left_arm" in table and "0.900" in table
    world.engine.show(link=world.engine.snapshot.link.__class__(up=False, router_zid="", fresh=False, age_ns=None))
    world.run(0.02)
    assert "link down" in repr(robot.state) and "never heard" in robot.state._repr_html_()


def test_parts_show_their_positions(robot):
    """An arm is a line with its joints; what was never heard says so instead of raising."""
    assert repr(robot.state.left_arm).startswith("<left_arm: q [0.100, 0.500, -0.300, 0.900, 0.200, -0.100, 0.300] rad")
    assert repr(robot.state.right_gripper) == "<right_gripper: never heard>"


def test_a_robot_shows_its_state_and_never_fails(world):
    """A cell that ends with `robot` works with a daemon, without one, and after close()."""
    robot = connect(transport=world.transport(), name="eyes")
    assert "eyes" in robot._repr_html_() and "READ_ONLY" in robot._repr_html_()
    world.plane.set_reachable(False)
    world.plane._daemon_id = "second"
    world.engine.frozen = True
    world.plane.set_reachable(True)
    assert "not seen yet" in robot._repr_html_()
    world.plane.set_reachable(False)
    world.run(2.0)
    assert "DISCONNECTED" in robot._repr_html_()
    robot.close()
    assert "closed" in robot._repr_html_() and repr(robot) == "<robot at memory for 'eyes'>"


def test_health_is_a_table(world, robot):
    """What is well and what is not, with the ages of what the robot sends."""
    assert "<td>ok</td>" in robot.health()._repr_html_() and "/fsm_state" in robot.health()._repr_html_()
    world.engine.show(latches={"ESTOP": "m"})
    world.run(0.02)
    table = robot.health()._repr_html_()
    assert "not ok" in table and "ESTOP" in table
    world.plane.set_reachable(False)
    assert "not ok" in robot.health()._repr_html_()


def test_what_others_wrote_is_escaped(world, robot):
    """A name or a message of somebody else is text, not markup."""
    world.engine.show(latches={"ESTOP": "<script>alert(1)</script>"})
    world.run(0.02)
    with connect(transport=world.transport(), name="<b>bold</b>") as other, other.control():
        table = robot.state._repr_html_()
        assert "&lt;script&gt;" in table and "&lt;b&gt;bold" in table and "<b>" not in table and "<script" not in table
        assert "owned by '<b>bold</b>'" in repr(robot.state)


def test_what_owns_and_moves_shows_itself(robot):
    """Control, arm and stream say what they are, before, during and after."""
    own = robot.control()
    assert repr(own) == "<control for 'tester', not entered>"
    with own:
        assert repr(own) == "<control for 'tester', epoch 1, open>"
        own.enable()
        with own.left_arm.stream() as out:
            out.set(np.array(START_Q))
            assert repr(out) == "<stream 1 of the left arm: 1 targets set>"
        assert repr(own.left_arm) == "<left arm of <control for 'tester', epoch 1, open>>"
        assert "not opened" in repr(own.left_arm.stream())
    assert repr(own) == "<control for 'tester', epoch 1, ended>"
