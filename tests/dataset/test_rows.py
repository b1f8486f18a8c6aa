"""Tests of rows: what a row needs, where a run ends, and that nothing is made up."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.dataset.episode import numbered
from gateway.dataset.layout import Feature, Layout, Part, Source
from gateway.dataset.rows import choose, runs
from gateway.dataset.series import Series
from gateway.errors import Rejected

S = 1_000_000_000


def part(topic, need="always", names=("a",), **source):
    """Return a part with one source."""
    return Part(names=names, need=need, source=(Source(topic=topic, field="data", **source),))


def series(begin_s, end_s, value=1.0, step_s=0.01, width=1):
    """Return samples at a steady rate."""
    times = np.arange(round(begin_s / step_s), round(end_s / step_s)) * round(step_s * S)
    return Series(times_ns=times.astype(np.int64), values=np.full((len(times), width), value))


def made(parts, recorded, interval_s=(0.0, 10.0), least=5, namespace="", fps=10.0):
    """Return the runs, and what was left out."""
    layout = Layout(feature=(Feature(name="observation.state", part=tuple(parts)),))
    chosen = choose(layout, recorded, namespace)
    found = {(topic, "data"): one for topic, one in recorded.items()}
    return runs(chosen, found, (round(interval_s[0] * S), round(interval_s[1] * S)), fps, least)


def joined(*parts):
    """Return samples one after the other."""
    return Series(
        times_ns=np.concatenate([one.times_ns for one in parts]), values=np.concatenate([one.values for one in parts])
    )


def test_rows_stand_on_the_grid_from_the_episodes_begin_to_before_its_end():
    """As many as fit."""
    (run,), left_out = made([part("/a")], {"/a": series(0, 10)}, (1.05, 2.05))
    assert run.times_ns.tolist() == [round((1.05 + n / 10) * S) for n in range(10)]
    assert run.tables["observation.state"].dtype == np.float32 and left_out == {}


def test_a_gap_ends_a_run_and_time_does_not_jump_within_one():
    """What lies in it is left out and told; what follows is an episode of its own."""
    recorded = {"/a": joined(series(0, 3), series(5, 10))}
    found, left_out = made([part("/a")], recorded)
    assert [run.times_ns[[0, -1]].tolist() for run in found] == [[0, 3_100_000_000], [5 * S, 9_900_000_000]]
    assert left_out == {"no value of /a": 18}
    assert all(np.all(np.diff(run.times_ns) == 100_000_000) for run in found)


def test_rows_that_are_left_out_are_told_once_with_all_that_they_lack():
    """Their sum is the number of rows that are missing."""
    recorded = {"/a": series(0, 6), "/b": series(0, 4)}
    (run,), left_out = made([part("/a"), part("/b", names=("b",))], recorded)
    assert left_out == {"no value of /b": 20, "no value of /a, /b": 38}
    assert len(run.times_ns) + sum(left_out.values()) == 100


def test_a_run_that_is_too_short_is_left_out_and_told():
    """Here four rows of five."""
    recorded = {"/a": joined(series(0, 0.2), series(5, 10))}
    (run,), left_out = made([part("/a")], recorded)
    assert run.times_ns[0] == 5 * S
    assert left_out == {"no value of /a": 46, "less than 5 rows in a row": 4}


@pytest.mark.parametrize(("length_s", "parts"), [(999.9, 1), (1030.0, 2), (2100.0, 3)])
def test_a_run_is_no_longer_than_the_times_of_a_dataset_are_exact(length_s, parts):
    """LeRobot takes single precision, and refuses steps that are off by more than 1e-4 s. The parts are even, and all there."""
    found, left_out = made([part("/a")], {"/a": series(0, length_s, step_s=0.1)}, (0.0, length_s), fps=45.0)
    rows = [len(run.times_ns) for run in found]
    assert len(found) == parts and sum(rows) == round(length_s * 45) and max(rows) - min(rows) <= 1 and left_out == {}
    assert np.all(np.diff(np.concatenate([run.times_ns for run in found])) < round(S / 45) + 2)
    for run in found:
        columns, _ = numbered(run.tables, 45.0, 0, 0, 0)
        assert np.abs(np.diff(columns["timestamp"].astype(float)) - 1 / 45).max() < 1e-4


def test_what_is_always_needed_and_was_not_recorded_is_refused_with_where_it_comes_from():
    """By the name of its dimensions."""
    with pytest.raises(Rejected, match=r"a and what follows: nothing of it was recorded.*/a \(data\)"):
        made([part("/a")], {"/b": series(0, 10)})


def test_what_is_needed_if_recorded_is_zero_in_a_bag_without_it_and_needed_in_one_with_it():
    """So that no number changes its meaning within an episode."""
    parts = [part("/a"), part("/b", need="if_recorded", names=("b",))]
    (run,), left_out = made(parts, {"/a": series(0, 10)})
    assert (len(run.times_ns), left_out, run.covered) == (100, {}, {"observation.state": (1.0, 0.0)})
    assert not run.tables["observation.state"][:, 1].any()
    (run,), left_out = made(parts, {"/a": series(0, 10), "/b": series(2, 10)})
    assert len(run.times_ns) == 80 and left_out == {"no value of /b": 20}


def test_what_is_never_needed_is_zero_where_it_is_missing_and_that_is_counted():
    """No row is left out for it."""
    (run,), left_out = made(
        [part("/a"), part("/b", need="never", names=("b",))], {"/a": series(0, 10), "/b": series(0, 5)}
    )
    assert left_out == {} and run.covered["observation.state"] == (1.0, pytest.approx(0.52, abs=0.01))
    assert run.tables["observation.state"][-1].tolist() == [1.0, 0.0]


def test_the_first_source_that_was_recorded_is_taken():
    """And no other, even where that one has a gap."""
    both = Part(names=("a",), source=(Source(topic="/x", field="data"), Source(topic="/y", field="data")))
    (run,), _ = made([both], {"/x": series(0, 5, 1.0), "/y": series(0, 10, 2.0)})
    assert set(run.tables["observation.state"].ravel().tolist()) == {1.0} and len(run.times_ns) == 52
    (run,), _ = made([both], {"/y": series(0, 10, 2.0)})
    assert set(run.tables["observation.state"].ravel().tolist()) == {2.0}


def test_topics_of_a_bridge_with_a_namespace_are_found():
    """The layout speaks of the robot's own names."""
    (run,), _ = made([part("/a")], {"/robot1/a": series(0, 10), "/a": series(0, 1)}, namespace="robot1")
    assert len(run.times_ns) == 100


def test_an_action_is_taken_so_much_later_as_its_layout_says():
    """Here half a second."""
    recorded = {"/a": Series(times_ns=np.arange(100) * S // 10, values=np.arange(100.0)[:, np.newaxis])}
    (run,), _ = made([part("/a", shift_s=0.5)], recorded)
    assert run.tables["observation.state"][:3].ravel().tolist() == [5.0, 6.0, 7.0]


def test_a_grippers_command_becomes_its_torque():
    """By the manual's curve (§4.4); what is beyond 0..1 the robot clips, too."""
    commands = [-0.5, 0.0, 0.05, 0.1, 0.55, 1.0, 2.0]
    recorded = {"/a": Series(times_ns=np.arange(7) * S // 10, values=np.array(commands)[:, np.newaxis])}
    (run,), _ = made([part("/a", convert="gripper_torque")], recorded, (0.0, 0.7))
    assert run.tables["observation.state"].ravel().tolist() == pytest.approx([2, 2, 1, 0, -0.8, -1.6, -1.6])


def test_a_field_that_is_too_narrow_is_refused():
    """With how many numbers it has, from where on."""
    with pytest.raises(Rejected, match="/a: data has 2 numbers from number 1 on, 3 are named"):
        made([part("/a", names=("a", "b", "c"), first=1)], {"/a": series(0, 10, width=3)})


def test_numbers_are_taken_from_where_the_layout_says():
    """Its part of a wider field."""
    recorded = {"/a": Series(times_ns=np.arange(10) * S // 10, values=np.tile([1.0, 2.0, 3.0], (10, 1)))}
    (run,), _ = made([part("/a", names=("a", "b"), first=1)], recorded, (0.0, 1.0))
    assert run.tables["observation.state"][0].tolist() == [2.0, 3.0]
