"""The state as Prometheus reads it, by its own library: base units (seconds, metres), one family after the other."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from gateway import __version__
from gateway.errors import GatewayError
from gateway.settings.toml_file import state_dir

if TYPE_CHECKING:
    from gateway.api.protocol import Snapshot
    from gateway.web.messages import CamerasSeen
    from gateway.web.viewer import Viewer

__all__ = ["Disk", "text"]

S = 1_000_000_000
KINDS = {"gauge": GaugeMetricFamily, "counter": CounterMetricFamily}
LOOK_S = 0.2
"""How long a look at the disk is waited for [s]."""
Rows = Iterable[tuple[Mapping[str, str], float | None]]


class Disk:
    """The disk of state and black box. It is looked at beside the event loop: one that hangs keeps no stop waiting."""

    def __init__(self) -> None:
        self._looking: asyncio.Task[int | None] | None = None

    async def free(self) -> int | None:
        """Return its room [bytes]; None where it does not say so at once. However often it is asked, one look goes on."""
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(asyncio.to_thread(_free))
        looking = self._looking
        await asyncio.wait({looking}, timeout=LOOK_S)
        return looking.result() if looking.done() else None


def _free() -> int | None:
    try:
        folder = state_dir()
        return shutil.disk_usage(next(there for there in (folder, *folder.parents) if there.is_dir())).free
    except (GatewayError, OSError):  # there is neither a folder nor a home
        return None


def text(viewer: Viewer, cameras: CamerasSeen | None = None, free: int | None = None) -> bytes:
    """Return the page of metrics; while the gateway is away only that it is, and what was counted.

    Args:
        viewer: Looks at the gateway.
        cameras: How the page sees the cameras; None where it shows none.
        free: Room on the disk [bytes]; None where it is not known.
    """
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Seen(viewer, cameras, free))
    return generate_latest(registry)


class _Seen(Collector):
    def __init__(self, viewer: Viewer, cameras: CamerasSeen | None, free: int | None) -> None:
        self._viewer = viewer
        self._cameras = cameras
        self._free = free

    def describe(self) -> Iterable[Metric]:
        return ()

    def collect(self) -> Iterator[Metric]:
        viewer, view = self._viewer, self._viewer.view
        yield from _one("ta2_up", "gauge", "Whether the gateway answers.", view is not None)
        yield from _family("ta2_web", "gauge", "Release of this page.", [({"version": __version__}, 1.0)])
        counted = [({"code": code, "level": level}, n) for (code, level), n in sorted(viewer.counted.items())]
        yield from _family("ta2_notices", "counter", "Notices of the gateway since this page began.", counted)
        yield from _one("ta2_disk_free_bytes", "gauge", "Room on the disk of state and black box.", self._free)
        if self._cameras is not None:
            seen = self._cameras
            yield from _one("ta2_video_receiving", "gauge", "Whether a page looks at the cameras.", seen.is_receiving)
            yield from _one("ta2_video_age_seconds", "gauge", "Age of the newest picture.", seen.age_s)
            yield from _one("ta2_video_rate_hertz", "gauge", "Pictures that were decoded in a second.", seen.rate_hz)
        if view is not None:
            yield from _of_view(view)


def _of_view(view: Snapshot) -> Iterator[Metric]:
    loop, link, guard = view.loop, view.link, view.guard
    yield from _family("ta2_state", "gauge", "1 for the state that a person reads.", [({"state": view.shown}, 1.0)])
    yield from _family(
        "ta2_latch", "gauge", "1 for each cause that holds motion off.", [({"code": c}, 1.0) for c in view.latches]
    )
    codes = dict.fromkeys(finding.code for finding in view.findings)  # one code may be found of several parts
    yield from _family(
        "ta2_finding", "gauge", "1 for each code that is found.", [({"code": code}, 1.0) for code in codes]
    )
    refusals = [({"request": kind, "code": no.code}, 1.0) for kind, no in view.refusals.items()]
    yield from _family("ta2_refused", "gauge", "1 for each kind of request that would be refused now.", refusals)
    refused_so_far = [({"code": code}, float(count)) for code, count in sorted(view.refused.items())]
    yield from _family("ta2_requests_refused", "counter", "Requests that were refused.", refused_so_far)
    targets = [({"side": t.side, "space": t.space, "stream": str(t.stream_id)}, t.refused) for t in view.targets]
    yield from _family("ta2_targets_refused", "gauge", "Refused targets of the streams that are shown.", targets)
    yield from _one("ta2_fsm_state", "gauge", "The robot's FSM as a number.", view.fsm)
    yield from _one("ta2_loop_ticks", "counter", "Ticks of the control loop.", loop.ticks)
    yield from _one("ta2_loop_skipped", "counter", "Periods that the control loop skipped.", loop.skipped)
    yield from _one("ta2_loop_late_seconds", "gauge", "Lateness of the latest tick.", loop.late_ns / S)
    yield from _one("ta2_loop_worst_late_seconds", "gauge", "Worst lateness in the last 10 s.", loop.worst_late_ns / S)
    yield from _one("ta2_link_up", "gauge", "Whether there is a transport to the robot.", link.up)
    yield from _one("ta2_link_fresh", "gauge", "Whether the robot's state is at most 100 ms old.", link.fresh)
    yield from _one("ta2_link_age_seconds", "gauge", "Age of the robot's newest state.", _s(link.age_ns))
    yield from _one("ta2_lease_owned", "gauge", "Whether somebody owns the robot.", view.lease.owned)
    yield from _one("ta2_lease_epoch", "counter", "Number of the lease.", view.lease.epoch)
    yield from _one("ta2_lease_lost_seconds", "gauge", "How long the owner has been silent.", _s(view.lease.lost_ns))
    yield from _one("ta2_guard_pid", "gauge", "Process of the guard; 0 for none.", guard.pid)
    yield from _one("ta2_guard_linked", "gauge", "Whether the guard reaches the robot.", guard.linked)
    yield from _one("ta2_guard_lost", "counter", "Guards that ended.", guard.lost)
    yield from _one("ta2_others", "gauge", "Others that command the robot, or could.", len(view.others.seen))
    endpoints = [({"name": e.name, "endpoint": str(e.endpoint_id)}, float(e.is_silent)) for e in view.endpoints]
    yield from _family("ta2_endpoint_silent", "gauge", "Whether a stop endpoint is silent.", endpoints)
    topics = view.topics.items()
    yield from _family("ta2_topic_age_seconds", "gauge", "Age of a topic.", [(_t(n), _s(t.age_ns)) for n, t in topics])
    yield from _family(
        "ta2_topic_rate_hertz", "gauge", "Measured rate of a topic.", [(_t(n), t.rate_hz) for n, t in topics]
    )
    gaps = [(_t(n), t.worst_gap_ns / S) for n, t in topics]
    yield from _family("ta2_topic_worst_gap_seconds", "gauge", "Worst gap of a topic in the last 10 s.", gaps)
    yield from _family("ta2_topic_samples", "counter", "Samples of a topic.", [(_t(n), t.count) for n, t in topics])
    refused = [(_t(n), t.refused) for n, t in topics]
    yield from _family("ta2_topic_refused", "counter", "Samples that were not believed.", refused)
    streams = view.streams.items()
    running = [(_t(n), float(s.running)) for n, s in streams]
    yield from _family("ta2_stream_running", "gauge", "Whether a command stream runs.", running)
    yield from _family(
        "ta2_stream_sent", "counter", "Frames of a command stream.", [(_t(n), s.sent) for n, s in streams]
    )
    gaps = [(_t(n), s.worst_gap_ns / S) for n, s in streams]
    yield from _family("ta2_stream_worst_gap_seconds", "gauge", "Worst gap of a command stream in the last 10 s.", gaps)
    arms = [({"side": side}, arm.tracking_rad) for side, arm in view.arms.items()]
    yield from _family("ta2_arm_tracking_radians", "gauge", "Distance between setpoint and measured.", arms)
    felt = {side: arm.contact for side, arm in view.arms.items() if arm.contact is not None}
    known = [({"side": side}, float(contact.state == "known")) for side, contact in felt.items()]
    yield from _family("ta2_contact_known", "gauge", "Whether it is known what pulls at an arm.", known)
    forces = [
        ({"side": side, "axis": axis}, value)
        for side, contact in felt.items()
        for axis, value in zip("xyz", contact.wrench[:3], strict=False)
    ]
    yield from _family("ta2_contact_force_newtons", "gauge", "Force on the hand, in the shoulder's axes.", forces)
    sigmas = [({"side": side}, contact.sigmas) for side, contact in felt.items() if contact.state == "known"]
    yield from _family("ta2_contact_sigmas", "gauge", "Standard deviations from no contact.", sigmas)
    spacing = None if view.spacing is None else view.spacing.gap_m
    yield from _one("ta2_spacing_gap_metres", "gauge", "Free distance of the nearest pair of parts.", spacing)


def _one(name: str, kind: str, what: str, value: float | None) -> Iterator[Metric]:
    return _family(name, kind, what, [({}, value)])


def _family(name: str, kind: str, what: str, rows: Rows) -> Iterator[Metric]:
    known = [(labels, value) for labels, value in rows if value is not None]
    if known:
        family = KINDS[kind](name, what, labels=tuple(known[0][0]))
        for labels, value in known:
            family.add_metric(tuple(labels.values()), float(value))
        yield family


def _t(topic: str) -> Mapping[str, str]:
    return {"topic": topic}


def _s(nanoseconds: int | None) -> float | None:
    return None if nanoseconds is None else nanoseconds / S
