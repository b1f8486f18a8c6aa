"""Metrics are what Prometheus's own parser reads, in base units."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace

import pytest
from msgspec.structs import replace
from prometheus_client.parser import text_string_to_metric_families

from gateway.messages.snapshot import ContactView, EndpointView, Finding, TargetView
from gateway.web import metrics
from tests.cli.views import a_view, owned


def read(view, counted=None) -> dict[str, list]:
    """Return the samples of each name, as Prometheus reads them."""
    page = metrics.text(SimpleNamespace(view=view, counted=Counter(counted or {})))  # type: ignore[arg-type]  # as much of one as is read
    samples: dict[str, list] = {}
    for family in text_string_to_metric_families(page.decode()):
        for sample in family.samples:
            samples.setdefault(sample.name, []).append(sample)
    return samples


def test_a_gateway_that_is_away_is_told_and_nothing_old_beside_it() -> None:
    """Old figures of a dead gateway would look like a robot that stands still."""
    samples = read(None, {("LINK_UP", "info"): 2})
    assert samples["ta2_up"][0].value == 0
    assert samples["ta2_notices_total"][0].labels == {"code": "LINK_UP", "level": "info"}
    assert set(samples) == {"ta2_up", "ta2_web", "ta2_notices_total"}


def test_no_series_is_there_twice() -> None:
    """Prometheus refuses the page: of two stop endpoints of one name, or one finding of both arms, it would get nothing."""
    beat = EndpointView(endpoint_id=3, name="pedal", timeout_ns=1, on_silence="hold", age_ns=0, is_silent=False)
    found = Finding(code="NOT_FOLLOWING", message="", hint="", since_ns=0, facts={})
    twice = a_view(endpoints=(beat, replace(beat, endpoint_id=4, is_silent=True)), findings=(found, found))
    samples = read(twice, {("LINK_UP", "info"): 2, ("LINK_UP", "warning"): 1})
    for rows in samples.values():
        labels = [tuple(sorted(row.labels.items())) for row in rows]
        assert len(labels) == len(set(labels))
    silent = {(row.labels["name"], row.labels["endpoint"]): row.value for row in samples["ta2_endpoint_silent"]}
    assert silent == {("pedal", "3"): 0.0, ("pedal", "4"): 1.0}


def test_times_are_seconds_and_unknown_ones_are_left_out() -> None:
    """A topic that was never heard has a count and no age."""
    view = a_view(lease=owned(lost_ns=1_500_000_000), latches={"ESTOP_BY_OTHER": 'a "quoted"\nline'})
    name = next(iter(view.topics))
    silent = replace(view, topics={**view.topics, name: replace(view.topics[name], age_ns=None)})
    samples = read(silent)
    ages = {sample.labels["topic"]: sample.value for sample in samples["ta2_topic_age_seconds"]}
    assert name not in ages and set(ages.values()) == {0.003}
    assert samples["ta2_lease_lost_seconds"][0].value == 1.5
    assert samples["ta2_latch"][0].labels == {"code": "ESTOP_BY_OTHER"}
    assert samples["ta2_state"][0].labels == {"state": view.shown}


def test_refused_targets_are_counted_by_stream() -> None:
    """Why the last one was refused is not why all before it were."""
    left = TargetView(
        stream_id=4,
        side="left",
        open=True,
        code="",
        seq=600,
        refused=501,
        refusal_code="LATCHED",
        refusal_message="",
        limited=False,
    )
    right = replace(left, stream_id=5, side="right", space="pose", refused=0, refusal_code="")
    rows = read(a_view(targets=(left, right)))["ta2_targets_refused"]
    assert [(row.labels, row.value) for row in rows] == [
        ({"side": "left", "space": "joint", "stream": "4"}, 501.0),
        ({"side": "right", "space": "pose", "stream": "5"}, 0.0),
    ]


@pytest.mark.parametrize("name", ["ta2_loop_ticks_total", "ta2_stream_sent_total", "ta2_topic_samples_total"])
def test_what_rises_is_a_counter(name: str) -> None:
    """By its name and its type."""
    assert read(a_view())[name]


def test_what_pulls_at_an_arm_is_told_where_it_is_estimated() -> None:
    """Forces that are felt; that it is unknown, without figures, where it is not."""
    view = a_view()
    assert "ta2_contact_known" not in read(view)
    felt = ContactView(state="known", wrench=(1.5, None, -2.0, 0.0, 0.0, 0.0), sigmas=4.0)
    arms = {
        "left": replace(view.arms["left"], contact=felt),
        "right": replace(view.arms["right"], contact=ContactView(state="unknown", code="NO_EFFORTS")),
    }
    samples = read(replace(view, arms=arms))
    assert {s.labels["side"]: s.value for s in samples["ta2_contact_known"]} == {"left": 1.0, "right": 0.0}
    forces = {(s.labels["side"], s.labels["axis"]): s.value for s in samples["ta2_contact_force_newtons"]}
    assert forces == {("left", "x"): 1.5, ("left", "z"): -2.0}
    assert [(s.labels["side"], s.value) for s in samples["ta2_contact_sigmas"]] == [("left", 4.0)]
