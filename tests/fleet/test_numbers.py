"""The numbers of `docs/explanation/fleets.md`: the page's table is what the code computes."""

from __future__ import annotations

from tests.bench.fleet_numbers import MEASURED, sizes, table
from tests.fleet.fleets import PAGE


def test_the_page_has_the_table_that_is_computed():
    """`python -m tests.bench.fleet_numbers` prints it."""
    assert table() in (PAGE.parents[1] / "explanation" / "fleets.md").read_text()


def test_a_tree_has_no_wider_router_than_was_allowed():
    """And one on top."""
    for robots in (1, 99, 100, 101, 10_000, 10_001):
        found = sizes(robots, fan_out=10)
        below = robots
        for routers in found.routers:
            assert routers * 10 >= below
            below = routers
        assert found.routers[-1] == 1


def test_what_one_look_costs_is_proportional():
    """A thousand robots are a thousand answers."""
    assert sizes(1000).list_bps == 1000 * sizes(1).list_bps > 8000 * MEASURED.snapshot_bytes
