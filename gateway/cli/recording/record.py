"""`ta2 record`: everything that a robot and its users say, into a bag; `ta2 record recover`: one that was cut off, made whole.

Ends after a time, with q, Ctrl-C or SIGTERM, or before the disk is full; always well, also when its terminal is gone. It
commands nothing, and owns nothing.
Episodes are told by keys of its terminal, and at its door by `ta2 episode` and `robot.recording`.
"""

from __future__ import annotations

import json
import os
import sys
import time
from argparse import Namespace
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from datetime import datetime
from functools import partial
from pathlib import Path

from msgspec.structs import asdict

from gateway.api.recorder_protocol import RecorderAsk, recorder_socket
from gateway.cli.recording.camera import Camera
from gateway.cli.recording.episode import line_of
from gateway.cli.recording.undisturbed import undisturbed
from gateway.cli.terminal.connection import link_of
from gateway.cli.terminal.ending import ExitStatus, Interrupted
from gateway.cli.terminal.keys import Keys, keys
from gateway.cli.terminal.progress import Teller, dispensable_teller
from gateway.errors import Code, GatewayError, Rejected, failure
from gateway.process.notify import Notifier, notifier_of
from gateway.process.threads import supervised
from gateway.process.zenoh_threads import share_reactor
from gateway.recording.door import Door
from gateway.recording.episode_desk import EpisodeDesk
from gateway.recording.gateway_tap import GatewayTap
from gateway.recording.recorder import Progress, Recorder
from gateway.recording.recovering import recover
from gateway.recording.tap import Tap
from gateway.recording.topics import EPISODES, POLICY, recorded_topics
from gateway.robot.topics import STATE_TOPICS

__all__ = ["carry_out"]

KEYS: Mapping[str, RecorderAsk] = {"s": "success", "f": "failure", "d": "discard", "m": "mark"}
"""Key -> what it tells. Space starts or stops, q ends the recording."""
HELP = "space start/stop, s success, f failure, d discard, m mark, q end"

STEP_S = 0.25
"""What came is written so often [s]."""
FIRST_S = 10.0
"""The first message must come within this [s], or nothing is recorded."""


def carry_out(options: Namespace) -> ExitStatus:
    """Record, or recover.

    Raises:
        Rejected: BAD_REQUEST, the folder is not empty, cannot be written, or has too little room; nothing to recover.
        GatewayTimeout: Nothing came from the robot.
        Disconnected: No gateway says where the robot is, and nobody else does.
    """
    if options.verb == "recover":
        return _recover(options)
    share_reactor()  # before the first session: whoever waits at the robot's socket reads it, too
    settings = link_of(options)
    folder = options.out or Path(datetime.now().astimezone().strftime("ta2-%Y%m%d-%H%M%S"))
    topics = recorded_topics(settings, aliases=options.aliases)
    facts = {"robot": settings.endpoint, "model": settings.model, "namespace": settings.namespace}
    recorder = Recorder(folder, topics, facts | ({"task": options.task} if options.task else {}))
    desk = EpisodeDesk(folder, options.task, lambda said: recorder.tell(EPISODES, said))
    robot, gateway = Tap(settings, topics, recorder.take), GatewayTap(options.target, recorder.tell)
    opening = supervised(robot.open, "ta2-record-robot")
    ended: Interrupted | None = None
    manager = notifier_of(os.environ, os.getpid())
    camera: Camera | None = None
    is_to_end, file = True, None
    try:
        with dispensable_teller() as tell, keys() as pressed, ExitStack() as doors:
            try:
                if options.video:
                    camera = doors.enter_context(Camera(folder, settings.endpoint, options.video_port))
                try:
                    note = partial(recorder.tell, POLICY)
                    door = Door(recorder_socket(options.target), desk.carry_out, lambda: desk.state, note)
                    doors.callback(door.close)
                except Rejected as error:
                    tell.say(f"{error.message} -> {error.hint}")
                opening.start()
                gateway.start()
                _follow(recorder, desk, tell, pressed, camera, options.seconds, manager)
            except Interrupted as end:
                ended = end
            except KeyboardInterrupt:
                pass
            except Exception as error:  # whatever it was: it goes on to who reports it
                is_to_end = False
                _break_off(recorder, folder, tell, error)
                raise
            finally:
                robot.close()
                gateway.close()
                if manager is not None:
                    manager.close()
    finally:
        if is_to_end:
            with undisturbed():
                file = _end(recorder, desk)
    progress = recorder.progress(time.monotonic_ns())
    _show(folder, progress, camera, is_complete=file is not None, as_json=options.json)
    if ended is not None:
        raise ended
    return ExitStatus.OK if file is not None and progress.messages and not progress.error else ExitStatus.REFUSED


def _follow(
    recorder: Recorder,
    desk: EpisodeDesk,
    tell: Teller,
    pressed: Keys,
    camera: Camera | None,
    seconds: float | None,
    manager: Notifier | None,
) -> None:
    """Write what comes until the time is over, q, or the recording ends by itself; time counts from the first message.

    Raises:
        GatewayTimeout: Nothing came.
    """
    begun_s, first_s, told = time.monotonic(), None, set[str]()
    if manager is not None:
        manager.ready(time.monotonic_ns(), lambda: desk.state.bag)
    while True:
        typed = pressed.wait(STEP_S if seconds is None else min(STEP_S, max(seconds / 20, 0.01)))
        _obey(typed, desk, tell)
        with undisturbed():
            progress, now_s = recorder.step(time.monotonic_ns()), time.monotonic()
        if progress.error:
            tell.say(f"{progress.error}: the recording ends here, and is complete so far")
            return
        heard = progress.messages > 0 and len(progress.silent) < len(STATE_TOPICS)
        if manager is not None:
            manager.beat(time.monotonic_ns())
        first_s = now_s if heard and first_s is None else first_s
        if "q" in typed:
            return
        if first_s is None:
            if now_s - begun_s > FIRST_S:
                raise failure(
                    Code.TIMEOUT,
                    f"nothing came from the robot in {FIRST_S:g} s",
                    hint="is it on, and its bridge running? `ta2 link` tells what is there",
                )
            tell.advance("record", None, "waiting for the robot")
            continue
        for topic, (_, worst_ns) in progress.gaps.items():
            if topic not in told:
                told.add(topic)
                tell.say(f"{topic}: nothing for {worst_ns / 1e6:.0f} ms; the recording goes on")
        if seconds is not None and now_s - first_s >= seconds:
            return
        share = None if seconds is None else (now_s - first_s) / seconds
        tell.advance("record", share, _line(progress, now_s - first_s))
        if camera is not None:
            camera.look(tell, now_s)
            tell.advance("cameras", None, camera.line)
        if desk.state.episode:
            tell.advance("episode", None, line_of(desk.state))
        if pressed.are_there:
            tell.advance("keys", None, HELP)


def _break_off(recorder: Recorder, folder: Path, tell: Teller, error: Exception) -> None:
    """Take away a bag that holds nothing, or could not begin; keep any other."""
    if isinstance(error, GatewayError) or not recorder.progress(time.monotonic_ns()).messages:
        recorder.discard()
    else:
        recorder.abandon()
        tell.say(f"the recording broke off: ta2 record recover {folder}")


def _end(recorder: Recorder, desk: EpisodeDesk) -> Path | None:
    """Complete the bag; return its file, or None where the disk did not let it."""
    recorder.step(time.monotonic_ns())  # makes room for a last word
    with suppress(Rejected):  # without it the episode ends with the bag
        desk.end()
    return recorder.finish()


def _obey(typed: str, desk: EpisodeDesk, tell: Teller) -> None:
    """Tell the desk what keys say, and a person what came of it."""
    for key in typed:
        ask = KEYS.get(key) if key != " " else ("stop" if desk.state.is_running else "start")
        if ask is not None:
            try:
                tell.say(f"episode {desk.carry_out(ask).episode}: {ask}")
            except Rejected as error:
                tell.say(f"{error.message} -> {error.hint}")


def _line(progress: Progress, for_s: float) -> str:
    rate_hz = progress.messages / for_s if for_s > 0 else 0.0
    gaps = sum(count for count, _ in progress.gaps.values())
    lost = f", {progress.lost} LOST" if progress.lost else ""
    return (
        f"{for_s:.1f} s, {progress.messages} messages ({rate_hz:.0f}/s), {progress.size_bytes / 1e6:.1f} MB, "
        f"{gaps} gaps{lost}, {progress.free_bytes / 1e9:.0f} GB free"
    )


def _show(folder: Path, progress: Progress, camera: Camera | None, *, is_complete: bool, as_json: bool) -> None:
    if as_json:
        facts = asdict(progress) | {"ok": is_complete and not progress.error, "bag": str(folder)}
        facts |= {"video": camera.facts} if camera is not None else {}
        print(json.dumps(facts, ensure_ascii=False))
        return
    state = "complete" if is_complete else f"not complete: ta2 record recover {folder}"
    seen = f", {camera.line}" if camera is not None else ""
    print(f"{folder}: {progress.messages} messages, {progress.size_bytes / 1e6:.1f} MB{seen}, {state}")
    if progress.silent:
        print(f"nothing came of {', '.join(progress.silent)}", file=sys.stderr)


def _recover(options: Namespace) -> ExitStatus:
    if options.folder is None:
        raise failure(Code.BAD_REQUEST, "which folder?", field="folder", hint="ta2 record recover DIR")
    found = recover(options.folder)
    if options.json:
        print(json.dumps({"ok": True, **asdict(found), "file": str(found.file)}))
    else:
        torn = f"; torn there: {found.torn}" if found.torn else ""
        print(f"{found.file}: {found.messages} messages, {found.duration_s:.1f} s{torn}")
    return ExitStatus.OK
