"""`ta2 check`: the manual's bring-up (§2.7) as one command. Looks, and can send nothing; moves only when a person typed it."""

from __future__ import annotations

import logging
import socket
import sys
import termios
import time
from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from datetime import datetime
from urllib.parse import urlsplit

from msgspec import structs

from gateway import __version__
from gateway.api.protocol import Wire
from gateway.cli.check.capture import Capture
from gateway.cli.check.looked import Seen, Wish, looked, parts_of
from gateway.cli.check.report import show, write_page
from gateway.cli.check.rows import MOVING, POINTS, Row, row, skipped
from gateway.cli.check.trials import Trials
from gateway.cli.terminal.connection import connected, link_of
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.progress import Teller, teller
from gateway.errors import GatewayError
from gateway.process.threads import supervised
from gateway.process.zenoh_threads import share_reactor
from gateway.recording.tap import Tap
from gateway.recording.topics import recorded_topics
from gateway.robot.topics import STATE_TOPICS
from gateway.settings.settings import LinkSettings

__all__ = ["WORD", "carry_out", "knock"]

WORD = "move"
"""What a person types who agrees that the robot moves."""
LEAST_S = 3.0
"""So long it is listened at least [s]: some samples of the slowest topic."""
CONSENT = f"""
All that can be looked at is well. What is still to be checked MOVES the robot: each enabled arm goes by 0.05 rad or 2 cm
and back, its gripper opens; the chassis drives forward for about 20 cm in all; twice the gateway is killed on purpose, and the
robot has to stop by itself. An arm that nobody commands is not held (§4.10): it may sink.
Nobody and nothing in reach, a hand at the physical emergency stop (§1.3)?
Type {WORD} to go on, anything else to leave it: """


def carry_out(options: Namespace, look: Callable[..., Wire]) -> ExitStatus:
    """Check; return REFUSED when a row fails.

    Args:
        options: Of the command line.
        look: At the wire without a gateway: `gateway.link.surveyor.look`.

    Raises:
        Disconnected: No gateway says where the robot is, and nobody else does.
        Rejected: The page cannot be written.
    """
    share_reactor()
    logging.getLogger("gateway").addHandler(logging.NullHandler())  # rows say it
    settings, wish = link_of(options), Wish(without=frozenset(options.without), mode=options.mode)
    knock_s, error = knock(settings.endpoint)
    asks_gateway = options.robot is None and options.config is None
    with ExitStack() as stack:
        with teller() as tell:
            tell.advance("look", None, settings.endpoint)
            wire = look(settings, is_named=bool(asks_gateway or options.namespace is not None or settings.namespace))
            settings = structs.replace(settings, namespace=wire.namespace)
            capture = Capture((*STATE_TOPICS, *settings.variant.command_topics))
            tap = Tap(settings, recorded_topics(settings), capture.take)
            stack.callback(tap.close)
            seen = Seen(wire=wire, capture=capture, began_ns=time.monotonic_ns(), knock_s=knock_s, knock_error=error)
            if wire.is_up and wire.robots:
                supervised(tap.open, "ta2-check-tap").start()
                _listen(capture, wire, tell)
            tell.advance("look", 1.0, "")
        rows = looked(seen, wish)
        rows += _video(options, settings) if options.video else skipped(("video",), "not asked for", "--video")
        may_not = _objection(options, rows)  # beside no live bars: whoever is asked shall read the question
        rows += may_not
        if not may_not:
            tell = stack.enter_context(teller())
            robot = stack.enter_context(connected("check", options.target, options.timeout_s)) if asks_gateway else None
            parts = parts_of(capture.mode(), wish, has_lift=settings.variant.has_lift)
            trials = Trials(capture=capture, parts=parts, tell=tell, settings=settings, config=options.config)
            rows += trials.all(robot)
    at = datetime.now().astimezone().isoformat(timespec="seconds")
    facts: dict[str, object] = {"robot": settings.endpoint, "model": settings.model, "ta2": __version__, "at": at}
    show(rows, facts, as_json=options.json)
    if options.html is not None:
        write_page(options.html, rows, facts)
    return ExitStatus.REFUSED if any(each.verdict == "fail" for each in rows) else ExitStatus.OK


def knock(endpoint: str) -> tuple[float | None, str]:
    """Return how long the port took to answer [s], or why it did not; neither of what is no TCP port."""
    kind, _, place = endpoint.partition("/")
    url = urlsplit(f"//{place.partition('#')[0].partition('?')[0]}")
    if kind not in ("tcp", "tls") or not url.hostname or not url.port:
        return None, ""
    began_s = time.monotonic()
    try:
        socket.create_connection((url.hostname, url.port), timeout=POINTS["network"].most).close()
    except OSError as error:
        return None, f"{endpoint}: {error.strerror or error}"
    return time.monotonic() - began_s, ""


def _listen(capture: Capture, wire: Wire, tell: Teller) -> None:
    """Wait until every state came, and some of each; at most as long as the manual says."""
    wanted = [topic.name for topic in wire.topics if topic.is_state]
    began_s, most_s = time.monotonic(), POINTS["states"].most
    while (passed_s := time.monotonic() - began_s) < most_s:
        if passed_s > LEAST_S and all(capture.arrivals(topic) for topic in wanted):
            return
        tell.advance("listen", passed_s / most_s, "to every topic")
        time.sleep(0.1)


def _video(options: Namespace, settings: LinkSettings) -> list[Row]:
    """Return what `ta2 video check` finds, a row each of its points."""
    from gateway.cli.cameras.check import examined
    from gateway.cli.command_line.video_arguments import CHECK_S, FIRST_FRAME_S, PORT
    from gateway.video.errors import VideoError
    from gateway.video.receiving.source import robot_address
    from gateway.video.video import Video

    try:
        video = Video(robot_address(settings.endpoint, options.config), port=PORT)
        report = examined(video, seconds=CHECK_S, first_s=FIRST_FRAME_S, folder=None)
    except (VideoError, GatewayError) as error:
        return [row("video", False, f"{error.code}: {error.message}", remedy=error.hint)]
    return [
        replace(row("video", point.ok, point.found, remedy="; ".join(point.why)), name=f"video_{n}", title=point.name)
        for n, point in enumerate(report.points, 1)
    ]


def _objection(options: Namespace, rows: list[Row]) -> list[Row]:
    """Return why nothing may move: something is not well, or nobody has agreed; nothing when all may."""
    if any(each.verdict == "fail" or (each.name in ("mode", "fsm") and each.verdict == "unknown") for each in rows):
        return skipped(MOVING, "nothing moves unless all above is well")
    if options.consent == WORD or (options.consent is None and not options.json and _agreed()):
        return []
    return skipped(MOVING, "nobody agreed that the robot moves", f"type {WORD} at the terminal, or --consent {WORD}")


def _agreed() -> bool:
    """Ask a person to type the word; nobody agrees where there is no terminal."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    termios.tcflush(sys.stdin, termios.TCIFLUSH)  # what was typed before the question is no answer to it
    print(CONSENT, end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip() == WORD
