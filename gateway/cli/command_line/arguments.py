"""The command line of `ta2` as data: commands, options, defaults, help texts. Knows nothing of what a command does.

What a value must look like is checked here (numbers, sides, addresses of the robot); what it may be, by whoever gets it.
Imports nothing but the standard library and the release's number, so that `ta2 --help` is there at once.
"""

from __future__ import annotations

import argparse
import functools
import re
from collections.abc import Mapping, Sequence
from typing import Any

from gateway import __version__
from gateway.cli.command_line.adding import add_client_command, add_command, add_target, add_yes
from gateway.cli.command_line.body_arguments import add_frames, add_identify, add_model
from gateway.cli.command_line.check_arguments import add_check
from gateway.cli.command_line.dataset_arguments import add_dataset
from gateway.cli.command_line.first_arguments import add_first
from gateway.cli.command_line.ground_arguments import add_ground, take_velocity
from gateway.cli.command_line.motion_arguments import add_motions
from gateway.cli.command_line.numbers import seconds, span
from gateway.cli.command_line.policy_arguments import add_policy
from gateway.cli.command_line.record_arguments import add_bag, add_episode, complete_record
from gateway.cli.command_line.robot_arguments import (
    MODELS,
    MODES,
    PARTS,
    ROBOT_PORT,
    SIM_ENDPOINT,
    add_robot,
    endpoint,
    namespace,
)
from gateway.cli.command_line.service_arguments import add_fleet, add_keys, add_service
from gateway.cli.command_line.sim_arguments import add_camera, add_clock, add_physics, add_readings
from gateway.cli.command_line.stop_arguments import add_stops
from gateway.cli.command_line.teleop_arguments import add_teleop
from gateway.cli.command_line.video_arguments import add_video
from gateway.cli.command_line.view_arguments import add_incident, add_view, add_web
from gateway.cli.terminal.ending import STATUS_HELP

__all__ = ["joints", "parse", "parser"]

ARM_DOF = 7
"""Joints per arm (manual §4.0.3)."""

EPILOG = f"""without a robot, in three terminals:
  ta2 sim          a simulated robot on {SIM_ENDPOINT}
  ta2 run          the gateway
  ta2 watch        what they do

Anybody may `ta2 stop` and `ta2 estop` at any time. Software stops do not replace the physical emergency stop.

{STATUS_HELP}"""

NEGATIVE = re.compile(r"-[.\d]")
"""How a negative number begins. argparse knows some notations of them and takes the others (`-1.`, `-1e-3`, `-0.1,0.2`)
for options; nothing that begins with a space is one."""


# -------------------------------------------------------------------------------------------------------------- values


def joints(words: Sequence[str]) -> tuple[float, ...]:
    """Return the numbers in the words of `--left` or `--right`; spaces, commas and brackets stand between them.

    Raises:
        ValueError: One is no number. How many there are, and whether they are finite, is for others to judge.
    """
    return tuple(float(word) for word in re.sub(r"[\[\],;]", " ", " ".join(words)).split())


# -------------------------------------------------------------------------------------------------------------- parser


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options; ends the process with status 2 and a line of usage when they make no sense."""
    top, commands = _parsers()
    options, unknown = top.parse_known_args([f" {word}" if NEGATIVE.match(word) else word for word in arguments])
    sub = commands[options.command]  # the usage of the command that a person wanted, not a list of all
    if unknown:
        sub.error(f"unrecognized arguments: {' '.join(unknown)}")
    if options.command in ("move", "move-pose"):
        _take_joints(sub, options)
    if options.command == "drive":
        take_velocity(sub, options)
    if (
        options.command == "link"
        and options.robot is options.config is None
        and (options.namespace, options.model) != (None, None)
    ):
        sub.error("--namespace and --model are for a look without a gateway: name the robot with --robot")
    if options.command == "frames" and options.live and (options.left or options.right):
        sub.error("joints come from --live or from --left and --right, not from both")
    if options.command == "gripper" and (options.value is not None) != (options.action == "set"):
        sub.error("`set` takes the robot's own input, 0 to 1, the other actions take --force")
    return options


def _take_joints(sub: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    what = "numbers of a pose" if options.command == "move-pose" else "joints [rad]"
    for side in ("left", "right"):
        words = getattr(options, side)
        if words is None:
            continue
        try:
            values = joints(words)
        except ValueError as error:
            sub.error(f"--{side}: {error}; {ARM_DOF} {what} are needed")
        if len(values) != ARM_DOF:
            sub.error(f"--{side}: {len(values)} values; {ARM_DOF} {what} are needed (manual §4.0.3, §4.2)")
        setattr(options, side, values)
    if options.left is None and options.right is None:
        sub.error(f"which arm? --left and seven {what}, --right and seven, or both")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line; `options.command` says which command it is."""
    return _parsers()[0]


@functools.cache
def _parsers() -> tuple[argparse.ArgumentParser, Mapping[str, argparse.ArgumentParser]]:
    """Return the parser of the whole command line, and those of its commands."""
    top = argparse.ArgumentParser(
        prog="ta2",
        description="The gateway to a TeleAvatar 2 robot: run it, look at it, move the arms, stop.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    top.add_argument("--version", action="version", version=f"ta2 {__version__}")
    commands = top.add_subparsers(title="commands", dest="command", metavar="COMMAND", required=True)
    _add_run(add_command(commands, "run", "run the gateway until Ctrl-C"))
    _add_sim(add_command(commands, "sim", "run a simulated robot until Ctrl-C, or ask a running one"))
    _add_config(add_command(commands, "config", "show the effective settings, or check a file of them"))
    _add_views(commands)
    add_check(commands)
    add_motions(commands)
    add_ground(commands)
    add_teleop(commands)
    add_video(commands)
    _add_recording(commands)
    policy = add_command(commands, "policy", "let a policy drive the arms")
    verbs = policy.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    add_policy(verbs)
    add_frames(commands)
    add_identify(commands)
    add_web(commands)
    _add_example(commands)
    add_first(commands)
    add_keys(add_command(commands, "keys", "make keys for the network: authority, certificates, roles"))
    add_service(add_command(commands, "service", "run gateway, recorder and page as services of systemd"))
    add_fleet(
        add_command(commands, "fleet", "many robots on one zenoh network: look at them, stop them, be one of them")
    )
    add_model(add_command(commands, "model", "check the numbers of the robot's body, or of a URDF"))
    add_stops(commands)
    return top, commands.choices


def _add_run(run: argparse.ArgumentParser) -> None:
    run.add_argument(
        "--robot",
        type=endpoint,
        metavar="ROBOT",
        help=f"the robot's router: tcp/HOST:{ROBOT_PORT}, HOST:PORT or HOST (default: as configured, {SIM_ENDPOINT})",
    )
    run.add_argument(
        "--socket", metavar="PATH", help="where clients connect (default: as configured, else this user's)"
    )
    run.add_argument("--config", metavar="FILE", help="settings that differ from the defaults, see `ta2 config`")
    run.add_argument(
        "--namespace",
        type=namespace,
        metavar="NAME",
        help="ROS namespace of the robot's bridge (default: as configured, none)",
    )
    run.add_argument("--model", choices=MODELS, help="model of the robot (default: as configured, standard)")
    run.add_argument(
        "--no-guard", action="store_true", help="no second process that holds when this one dies (for debuggers)"
    )
    run.add_argument("--json-log", action="store_true", help="write the log as JSON lines")


def _add_sim(sim: argparse.ArgumentParser) -> None:
    sim.add_argument("--listen", type=endpoint, default=SIM_ENDPOINT, help="its router (default %(default)s)")
    sim.add_argument("--mode", choices=MODES, default="joint", help="control mode of both arms (default %(default)s)")
    sim.add_argument("--left-mode", choices=MODES, help="control mode of the left arm")
    sim.add_argument("--right-mode", choices=MODES, help="control mode of the right arm")
    sim.add_argument("--model", choices=MODELS, default="standard", help="model (default %(default)s)")
    sim.add_argument(
        "--namespace", type=namespace, default="", metavar="NAME", help="ROS namespace of its bridge (default: none)"
    )
    sim.add_argument("--seed", type=int, default=0, help="of the measurement noise (default %(default)s)")
    sim.add_argument(
        "--disable", action="append", default=[], choices=PARTS, help="a part that is switched off; may be repeated"
    )
    add_physics(sim)
    add_clock(sim)
    add_readings(sim)
    add_camera(sim)
    asks = sim.add_subparsers(title="ask a running one", dest="ask", metavar="ASK")
    for name, text in (
        ("fault", """let a fault begin, e.g. '{"fault": "pause", "duration_s": 1}'"""),
        ("clear", "end all faults, or those of a name"),
        ("faults", "list the faults there are"),
        ("stats", "print what the robot has seen of its users"),
    ):
        ask = add_command(asks, name, text)
        ask.add_argument("--at", type=endpoint, default=SIM_ENDPOINT, help="where it listens (default %(default)s)")
        if name == "fault":
            ask.add_argument("fault", metavar="JSON", help="name and parameters; `ta2 sim faults` lists them")
        elif name == "clear":
            ask.add_argument("fault", metavar="NAME", nargs="?", help="which faults (default: all)")


def _add_config(config: argparse.ArgumentParser) -> None:
    what = config.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--show", metavar="FILE", nargs="?", const="", help="print all settings: the defaults, or with FILE's over them"
    )
    what.add_argument("--check", metavar="FILE", help="say what is wrong with FILE, or what it changes")


def _add_views(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    add_client_command(commands, "status", "show on one screen what the gateway sees, and what to do next")
    why = add_client_command(
        commands, "why", "say why the robot does not do what it is told, as far as it can be known"
    )
    why.add_argument(
        "--since",
        type=span,
        metavar="SPAN",
        help="print what was told and refused in that time by gateways of this user, or a service: 90s, 10m, 1h; needs none",
    )
    watch = add_client_command(
        commands,
        "watch",
        "watch it live: state, lease, joints, topics, streams, motions, notices",
        "q or Ctrl-C ends it. Prints plain lines when the output is no terminal.",
        shows_json=False,
    )
    watch.add_argument("--once", action="store_true", help="print one frame and end")
    add_client_command(commands, "topics", "list every topic with rate, age, worst gap and counters")
    link = add_client_command(
        commands,
        "link",
        "show the state of the wire on one page: bridge, topics, rates, who else is there, what is wrong",
        "Paste it when you ask for help. With --robot or --config it looks by itself for some seconds, without a gateway, "
        "and sends nothing.",
    )
    add_robot(link, "look at", "of the only robot there")
    events = add_client_command(
        commands,
        "events",
        "print what the gateway tells, a line each, until Ctrl-C",
        "Goes on when the gateway is restarted, and says how many lines were lost.",
    )
    events.add_argument("--silence", type=seconds, metavar="S", help="end after so long without any [s]")
    add_incident(commands)
    add_view(commands)


def _add_recording(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    record = add_client_command(
        commands,
        "record",
        "record what the robot and its users say, into a bag that ROS tools, Foxglove and PlotJuggler open",
        "Commands nothing. Ends well with Ctrl-C. Without --robot or --config it asks the gateway where the robot is.",
    )
    add_robot(record, "record at", "as the gateway has it")
    complete_record(record)
    add_episode(
        add_client_command(
            commands,
            "episode",
            "tell a running `ta2 record` that an episode begins or ends, or what came of it",
            "Needs no gateway, and is for the recorder of this user on this host. A verdict ends an episode that goes on.",
            timeout_s=2.0,
            timeout_of="longest wait for the recorder",
        )
    )
    add_bag(commands)
    add_dataset(commands)


def _add_example(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    example = add_command(commands, "example", "run an example of the manual's chapter 6; without a number, list them")
    example.add_argument("number", nargs="?", metavar="NUMBER", help="section of the manual, e.g. 6.6")
    add_target(example)
    example.add_argument("--show", action="store_true", help="print the program instead of running it")
    add_yes(example)
