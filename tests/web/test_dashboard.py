"""The dashboard of configs/grafana asks for nothing that `/metrics` does not have."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

from msgspec.structs import replace
from prometheus_client.parser import text_string_to_metric_families

from gateway.api.protocol import RefusalMessage
from gateway.messages.body_views import SpacingView
from gateway.messages.snapshot import Finding, TargetView
from gateway.web import metrics
from gateway.web.messages import CamerasSeen
from tests.cli.views import a_view

ROOT = Path(__file__).parents[2]
DASHBOARD = ROOT / "configs" / "grafana" / "teleavatar2.json"


def exposed() -> dict[str, set[str]]:
    """Return the labels of each metric of a gateway of which everything is known."""
    no = RefusalMessage(code="LATCHED", message="")
    target = TargetView(
        stream_id=1,
        side="left",
        open=True,
        code="",
        seq=3,
        refused=2,
        refusal_code="LATCHED",
        refusal_message="",
        limited=False,
    )
    view = a_view()
    view = replace(
        a_view(latches={"ESTOP": ""}),
        arms={side: replace(arm, tracking_rad=0.01) for side, arm in view.arms.items()},
        refusals={"enable": no},
        refused={"LATCHED": 4},
        targets=(target,),
        findings=(Finding(code="MODEL_DIFFERS", message="", hint="", since_ns=0, facts={}),),
        spacing=SpacingView(on=True, why="", gap_m=0.1, first="a", second="b", margin_m=0.02, held=()),
    )
    cameras = CamerasSeen(views=(), is_receiving=True, age_s=0.1, rate_hz=30.0, why=())
    viewer = SimpleNamespace(view=view, counted=Counter({("LINK_UP", "info"): 1}))
    page = metrics.text(viewer, cameras, 10**9)  # type: ignore[arg-type]  # as much of one as is read
    return {s.name: set(s.labels) for f in text_string_to_metric_families(page.decode()) for s in f.samples}


def test_each_metric_of_the_dashboard_is_exposed_with_the_labels_it_is_shown_by() -> None:
    """A panel that asks for a name which is no more stays empty, and nobody knows why."""
    known = exposed()
    asked = 0
    for panel in json.loads(DASHBOARD.read_text())["panels"]:
        for target in panel["targets"]:
            (name,) = re.findall(r"ta2_\w+", target["expr"])
            assert name in known, panel["title"]
            assert set(re.findall(r"{{(\w+)}}", target["legendFormat"])) <= known[name], panel["title"]
            asked += 1
    assert asked > 20


def test_changes_are_shown_whatever_the_interval_and_the_first_of_a_code_too() -> None:
    """A range of its own is empty where Prometheus comes by less often; a code's counter appears with 1, no change at all."""
    known = exposed()
    for panel in json.loads(DASHBOARD.read_text())["panels"]:
        for target in panel["targets"]:
            assert set(re.findall(r"\[(.*?)\]", target["expr"])) <= {"$__rate_interval"}, panel["title"]
            if "[" in target["expr"]:
                (name,) = re.findall(r"ta2_\w+", target["expr"])
                assert "code" not in known[name], panel["title"]


def test_prometheus_comes_by_within_the_time_of_what_is_worst() -> None:
    """10 s: what its documented configuration leaves out is seen by nobody."""
    text = (ROOT / "docs" / "how-to" / "web.md").read_text(encoding="utf-8")
    assert 2 * int(re.findall(r"scrape_interval: (\d+)s", text)[0]) <= 10


def test_panels_do_not_overlap() -> None:
    """As Grafana lays them out: 24 columns."""
    taken: set[tuple[int, int]] = set()
    for panel in json.loads(DASHBOARD.read_text())["panels"]:
        place = panel["gridPos"]
        cells = {(place["x"] + x, place["y"] + y) for x in range(place["w"]) for y in range(place["h"])}
        assert not cells & taken and max(x for x, _ in cells) < 24
        taken |= cells
