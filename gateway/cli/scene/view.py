"""`ta2 view`: the robot in three dimensions, joints over time and what was told, by Rerun; live, as a file, or of a recording.

A client as any other, and a process of its own: it owns nothing, commands nothing, and goes on when the gateway is restarted.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr

from gateway.cli.scene.from_bag import STALE_NS, show_bag
from gateway.cli.scene.scene import Scene
from gateway.cli.scene.sink import Sink
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, Interrupted
from gateway.client import Robot
from gateway.errors import Code, Disconnected, GatewayTimeout, failure
from gateway.kinematics.calibration import RobotIdentity, load
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.configured import configured
from gateway.kinematics.sight import robot_frames
from gateway.kinematics.solving.chain import ArmChain
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import needed
from gateway.settings import toml_file
from gateway.settings.settings import Settings
from gateway.values import Side

if TYPE_CHECKING:
    from gateway.video import Video

__all__ = ["carry_out"]

SILENCE_S, AWAY_S = 1.0, 0.5
"""Between two looks whether anybody still looks on: without snapshots, and without a gateway [s]."""
PICTURES_HZ = 5.0


def carry_out(options: Namespace) -> ExitStatus:
    """Show it until Ctrl-C, until the window is closed, or until the time is over; raise GatewayError where it cannot be."""
    settings = toml_file.load(options.config)
    with ExitStack() as stack:  # whatever can be refused is refused before a window opens
        bag = stack.enter_context(Bag(options.bag)) if options.bag else None
        robot = None if bag else stack.enter_context(connected("view", options.target, options.timeout_s))
        video = stack.enter_context(_cameras(robot, options.video_port)) if robot and options.video else None
        stream = rr.RecordingStream("TeleAvatar 2")
        scene = _scene(stream, settings)
        sink = Sink(stream, options.save)
        stack.callback(sink.close)
        try:
            if bag is not None:
                show_bag(bag, scene, sink, options.rate)
            elif robot is not None:
                print(f"showing {robot!r}; Ctrl-C ends it", file=sys.stderr)
                _show_live(robot, scene, sink, video, options.rate, options.seconds)
        except KeyboardInterrupt as end:
            if isinstance(end, Interrupted):
                raise
    if options.save:
        print(options.save)
    return ExitStatus.OK


def _scene(stream: rr.RecordingStream, settings: Settings) -> Scene:
    link, file = settings.link, settings.model.calibration
    description = configured(settings)
    arms = {side: ArmChain(description, side) for side in Side}
    identity = RobotIdentity(serial=link.serial, model=link.model) if link.serial else None
    own = load(Path(file).expanduser(), identity) if file else None
    return Scene(stream, robot_frames(description, arms, own), CollisionModel(description))


def _show_live(
    robot: Robot, scene: Scene, sink: Sink, video: Video | None, rate_hz: float, seconds: float | None
) -> None:
    """Draw what the gateway shows and tells, across restarts of it."""
    notices, states = robot.events(timeout=0.0), robot.states(rate_hz, SILENCE_S)
    begun_s, pictured_s, seq = time.monotonic(), 0.0, -1
    while sink.push() and (seconds is None or time.monotonic() - begun_s < seconds):
        try:
            view = next(states).view
            arms = {side: view.arms[side.value] for side in Side}
            measured = {side: arm.measured for side, arm in arms.items()}
            joints = {side: one.q_rad for side, one in measured.items() if one and _is_young(one.age_ns)}
            told = {side: arm.q_ref_rad for side, arm in arms.items() if arm.q_ref_rad}
            hands = {side: (arm.p_m, arm.quat_xyzw) for side, arm in arms.items() if _is_young(arm.pose_age_ns)}
            nearest = () if view.spacing is None else (view.spacing.first, view.spacing.second)
            scene.show(view.at_ns, joints, told, hands, nearest)
            for notice in notices:
                scene.tell(notice.at_ns, notice.level, f"{notice.code}: {notice.message}")
        except (Disconnected, GatewayTimeout) as error:
            states = robot.states(rate_hz, SILENCE_S)  # an iterator that raised is over
            if isinstance(error, Disconnected):
                time.sleep(AWAY_S)
            continue
        frame = video.latest if video is not None else None
        if frame is not None and frame.seq != seq and time.monotonic() - pictured_s > 1.0 / PICTURES_HZ:
            pictured_s, seq = time.monotonic(), frame.seq
            scene.picture(view.at_ns, frame.views)


def _is_young(age_ns: int | None) -> bool:
    return age_ns is not None and age_ns < STALE_NS


@contextmanager
def _cameras(robot: Robot, port: int) -> Iterator[Video]:
    needed("av", "video")
    from gateway.video import Video, VideoError
    from gateway.video.receiving.source import robot_address

    try:
        with Video(robot_address(robot.info.robot, None), port=port) as video:
            yield video
    except VideoError as error:
        raise failure(Code.BAD_REQUEST, error.message, hint=error.hint) from None
