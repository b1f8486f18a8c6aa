"""`ta2 policy run`: a policy is asked once before anybody owns the robot; then played, judged (--dry) or compared (--shadow).

What was under way when something went wrong (a lost server, Ctrl-C) leaves the arms braked and held, as any motion does.
"""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from msgspec import to_builtins

from gateway.api.protocol import TouchView, Until
from gateway.cli.terminal.asking import confirmed
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, line_of, status_of
from gateway.cli.terminal.owning import HELD, held_text, is_held, owned
from gateway.cli.terminal.progress import Teller, teller
from gateway.client import ChassisStream, Control, LiftStream, MotionHandle, Robot, contact
from gateway.errors import Code, GatewayError, Refused, Rejected, failure
from gateway.policy.asking import RATES, Answer, Asking
from gateway.policy.chunks import Chunk
from gateway.policy.journal import Journal
from gateway.policy.lerobot import SCHEME, LeRobotServer
from gateway.policy.local_server import LocalPolicy
from gateway.policy.observing import Observer
from gateway.policy.openpi import FIRST_ANSWER_S, PolicyServer
from gateway.policy.policy_map import Observed, load_map
from gateway.policy.runner import DRIVE_S, Figures, Hands, Plan, Runner, require_near
from gateway.policy.trace import Trace

__all__ = ["carry_out"]

DEFAULT_HZ = 30.0
"""Steps a second of the vendor's client, where nobody says otherwise."""
MOST_HZ = 100.0
"""No policy says more steps a second."""
APPROACH = 0.3
"""Factor on the velocity limits of the motion to a first step."""
DRIVE_HZ, PICTURES = 50.0, (".png", ".svg")
FIRST_PICTURE_S = 10.0
ENABLE_S = 12.0
"""The gateway gives up enabling after 10 s; its reason is worth waiting for [s]."""


@dataclass(frozen=True, slots=True)
class _Owner:
    """Hands that move the robot."""

    own: Control
    streams: Mapping[str, ChassisStream | LiftStream] = field(default_factory=dict)
    until: Until | None = None

    def follow(self, chunk: Chunk, late_s: float, smoothing_s: float) -> MotionHandle | None:
        return self.own.follow(
            chunk.arms,
            chunk.period_ns / 1e9,
            start_in=-late_s,
            smoothing=smoothing_s,
            open_end=True,
            until=self.until,
        )

    def approach(self, joints: Mapping[str, Any]) -> TouchView | None:
        return self.own.move_to(joints, speed=APPROACH, until=self.until).result().touch

    def grip(self, side: str, command: float) -> None:
        (self.own.left_gripper if side == "left" else self.own.right_gripper).set(command)

    def drive(self, part: str, velocity: Sequence[float]) -> None:
        stream = self.streams[part]
        stream.set(*velocity)
        stream.tick()


@dataclass(slots=True)
class _Judge:
    """Hands that only look: what each chunk asks for, and, unless somebody else drives, what the gateway would say to it."""

    robot: Robot
    tell: Teller
    v_radps: float
    is_shadow: bool
    facts: dict[str, Any] = field(default_factory=lambda: {"over_speed": 0, "first_step_rad": 0.0, "would_refuse": 0})

    def follow(self, chunk: Chunk, late_s: float, smoothing_s: float) -> MotionHandle | None:
        measured = {side: self.robot.state.arm(side).q for side in chunk.arms}
        gap_rad, side, joint = chunk.gap(time.monotonic_ns(), measured)
        verdict, facts, fast = "", self.facts, chunk.over_speed(self.v_radps)
        try:
            if not self.is_shadow:
                verdict = ": the gateway would follow it"
                self.robot.check_follow(
                    chunk.arms,
                    chunk.period_ns / 1e9,
                    from_here=False,
                    start_in=-late_s,
                    smoothing=smoothing_s,
                    open_end=True,
                )
        except Rejected as refused:
            facts["would_refuse"] += 1
            verdict = f": the gateway would refuse it: {refused.code}: {refused.message}"
        facts["over_speed"] += fast
        facts["first_step_rad"] = max(facts["first_step_rad"], gap_rad)
        facts["steps"] = chunk.steps
        for name, values in (
            *((f"{side}_arm", q) for side, q in chunk.arms.items()),
            *((f"{side}_gripper", grip) for side, grip in chunk.grips.items()),
            *chunk.drives.items(),
        ):
            low, high = facts.setdefault("range", {}).get(name, (values.min(axis=0), values.max(axis=0)))
            facts["range"][name] = (low.clip(max=values.min(axis=0)), high.clip(min=values.max(axis=0)))
        self.tell.say(
            f"{chunk.steps} steps, {gap_rad:.3f} rad from the {side} arm's joint {joint}, {fast} over {self.v_radps:g} rad/s"
            f"{verdict}"
        )
        return None

    def approach(self, joints: Mapping[str, Any]) -> TouchView | None:
        return None

    def grip(self, side: str, command: float) -> None:
        pass

    def drive(self, part: str, velocity: Sequence[float]) -> None:
        pass


def carry_out(options: Namespace) -> ExitStatus:
    """Play a policy, or judge it.

    Raises:
        GatewayError: Nothing was begun.
    """
    is_lerobot = (options.server or "").startswith(f"{SCHEME}:")
    layout = load_map(options.map or ("lerobot" if is_lerobot else "vendor_openpi"), options.resize)
    first_s = max(FIRST_ANSWER_S, options.timeout_s)
    server = _server(options, is_lerobot, first_s)
    _require_plot(options.plot)
    is_looking = options.dry or options.shadow
    with ExitStack() as stack:
        robot = stack.enter_context(connected("policy run", options.target, options.timeout_s))
        stack.callback(server.close)
        server.connect()
        hz, said_by = _rate(options.hz, server.metadata)
        _require_task(options.prompt, server.metadata)
        newest = _cameras(stack, robot, layout.observation, options.video_port)
        observer = Observer(layout.observation, options.prompt, robot.fresh_state, newest)
        asking = Asking(server, observer, layout.actions, round(1e9 / hz))
        stack.callback(asking.close)
        asking.order()
        first = asking.answer(first_s + FIRST_PICTURE_S)
        if not isinstance(first, Answer):
            raise first or failure(Code.TIMEOUT, "no answer came from the policy server")
        if not (is_looking or options.approach):
            require_near(first, first.chunk.observed_ns)  # a server that loads its model first may answer long after
        print("\n".join(_preview(options, server.url, first, f"{hz:g} steps a second, {said_by}")), file=sys.stderr)
        if not (is_looking or options.yes or confirmed()):
            print("nothing was done", file=sys.stderr)
            return ExitStatus.REFUSED
        facts = {"hz": hz, "hz_from": said_by, "uncovered": list(first.observation.uncovered)}
        facts |= {"dry": options.dry, "shadow": options.shadow}
        journal = Journal(options.target, "shadow" if options.shadow else "dry" if options.dry else "play")
        stack.callback(journal.close)
        return _play(options, robot, asking, facts, journal, first.chunk.drives)


def _server(options: Namespace, is_lerobot: bool, first_s: float) -> PolicyServer | LeRobotServer | LocalPolicy:
    """Return who is asked, not connected yet.

    Raises:
        Rejected: Options are missing, or of another kind of server; a package is missing.
    """
    foreign = ("api_key_file",) if is_lerobot else ("policy", "device")
    wrong = next((name for name in foreign if getattr(options, name) is not None), None)
    if wrong is not None or (is_lerobot and options.policy is None):
        option = "--" + (wrong or "policy").replace("_", "-")
        message = f"{option} is {'not for this server' if wrong else 'needed: the server loads what it is told'}"
        hint = "--policy TYPE:NAME and --device go with grpc://, --api-key-file with ws://"
        raise failure(Code.BAD_REQUEST, message, field=option.strip("-"), hint=hint)
    waits = {"answer_s": options.timeout_s, "first_answer_s": first_s}
    if options.local is not None:
        return LocalPolicy(options.local, **waits)
    waits["connect_s"] = options.timeout_s
    if is_lerobot:
        return LeRobotServer(options.server, options.policy, device=options.device or "cpu", **waits)
    key = "" if options.api_key_file is None else _key(options.api_key_file)
    return PolicyServer(options.server, api_key=key, **waits)


def _play(
    options: Namespace, robot: Robot, asking: Asking, facts: dict[str, Any], journal: Journal, driven: Iterable[str]
) -> ExitStatus:
    is_looking = options.dry or options.shadow
    trace, until = Trace(), _until(options)
    plan = Plan(
        seconds=options.seconds,
        horizon=options.horizon,
        smoothing_s=options.smoothing,
        patience_s=options.patience,
        drive_bounds=(robot.info.chassis_v_mps, robot.info.chassis_w_radps, robot.info.lift_v_max),
        far="follow" if is_looking else "approach" if options.approach else "refuse",
    )
    error: GatewayError | None = None
    figures, judged, began_s = Figures(), dict[str, Any](), time.monotonic()
    try:
        with teller() as tell, ExitStack() as stack:
            if is_looking:
                judge = _Judge(robot, tell, robot.info.v_radps, options.shadow)
                hands: Hands = judge
                judged = judge.facts
            else:
                was_held = robot.state.state in HELD
                own = stack.enter_context(owned(robot, tell, take=options.take, is_left_held=options.hold))
                tell.advance("enable", None, "waiting for READY")
                stack.enter_context(_undone(own, was_held, lambda: figures.chunks > 0))
                own.enable(timeout=ENABLE_S)
                streams: dict[str, ChassisStream | LiftStream] = {
                    "chassis": own.chassis.stream(DRIVE_HZ, expiry=DRIVE_S),
                    "lift": own.lift.stream(DRIVE_HZ, expiry=DRIVE_S),
                }
                for part in driven:
                    stack.enter_context(streams[part])
                hands = _Owner(own, streams, until)

            def show(share: float | None, text: str) -> None:
                tell.advance("policy", share, text)
                trace.look(runner.playing, robot.state, time.monotonic_ns())

            runner = Runner(asking, hands, plan, tell.say, show, note=journal.note)
            figures, began_s = runner.figures, time.monotonic()
            runner.run()
            if runner.touch is not None:
                facts["touch"] = to_builtins(runner.touch)
                tell.say(f"the {runner.touch.side} hand was touched with {runner.touch.force_n:.1f} N: it ends here")
    except GatewayError as ended:
        error = ended
    except KeyboardInterrupt:
        _show(options, figures, facts | _ranges(judged, began_s), trace, None)
        if not is_looking and is_held(robot):
            print(f"\ninterrupted: {held_text(robot, 'policy run')}", file=sys.stderr)
        raise
    _show(options, figures, facts | _ranges(judged, began_s), trace, error)
    if (error is not None or options.hold) and not is_looking and is_held(robot):
        print(held_text(robot, "policy run"), file=sys.stderr)
    return ExitStatus.OK if error is None else status_of(error)


@contextmanager
def _undone(own: Control, was_held: bool, has_moved: Callable[[], bool]) -> Iterator[None]:
    """Undo what this command began when it was refused before anything moved; what another one left held stays so."""
    try:
        yield
    except Refused:
        if not (was_held or has_moved()):
            with suppress(GatewayError):
                own.release()
        raise


def _ranges(judged: Mapping[str, Any], began_s: float) -> dict[str, Any]:
    """Return what was judged and how long, for scripts."""
    seconds = round(time.monotonic() - began_s, 2)
    ranges = {name: [values.tolist() for values in pair] for name, pair in judged.get("range", {}).items()}
    return {"seconds": seconds, **judged, **({"range": ranges} if judged else {})}


def _show(
    options: Namespace, figures: Figures, facts: dict[str, Any], trace: Trace, error: GatewayError | None
) -> None:
    if options.plot is not None:
        from gateway.cli.policy.plot import write_plot

        try:
            write_plot(trace, Path(options.plot))
        except OSError as no_plot:
            print(f"no plot: {options.plot}: {no_plot.strerror or no_plot}", file=sys.stderr)
    if error is not None:
        print(line_of(error), file=sys.stderr)
    if options.shadow:
        facts["differences"] = trace.differences()
        facts.pop("would_refuse", None)  # nobody asked the gateway
    if not options.json:
        print(figures.line())
        for side, against in facts.get("differences", {}).items():
            away = (f"{found['rms_rad']:.4f} rad RMS from what was {what}" for what, found in against.items())
            print(f"{side} arm: the policy was {', '.join(away)}")
        return
    told: dict[str, Any] = {"ok": error is None, **figures.facts(), **facts}
    if error is not None:
        told["error"] = asdict(error.refusal) | {"retryable": error.retryable}
        told["exit_status"] = int(status_of(error))
    print(json.dumps(told, ensure_ascii=False))


def _preview(options: Namespace, policy: str, first: Answer, rate: str) -> list[str]:
    gap_rad, side, joint = first.chunk.gap(first.chunk.observed_ns, first.observation.measured)
    uncovered = first.observation.uncovered
    return [
        f"policy: {policy}, {' and '.join(first.chunk.arms)}, {first.chunk.steps} steps in a chunk, {rate}",
        f"  begins {gap_rad:.3f} rad from the {side} arm's joint {joint}",
        *([f"  not known, and shown as 0: {', '.join(uncovered)}"] if uncovered else []),
        *([] if options.dry or options.shadow else [f"  then the arms are {'held' if options.hold else 'disabled'}"]),
    ]


def _rate(hz: float | None, metadata: Mapping[Any, Any]) -> tuple[float, str]:
    """Return how many steps a second there are, and who says so.

    Raises:
        Rejected: BAD_REQUEST, the server says what is no such rate.
    """
    if hz is not None:
        return hz, "as asked for"
    for key in RATES:
        value = metadata.get(key)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value <= MOST_HZ:
            told, bound = repr(value)[:80], f"above 0 and up to {MOST_HZ:g}"
            message = f"{key} in the policy's metadata is {told}, a rate is {bound} Hz"
            hint = "--hz says at which rate the policy's data were recorded"
            raise failure(Code.BAD_REQUEST, message, field="hz", value=told, bound=bound, unit="Hz", hint=hint)
        return float(value), "as the server says"
    return DEFAULT_HZ, "as nobody says otherwise: it must be the rate of the policy's data (--hz)"


def _until(options: Namespace) -> Until | None:
    """Return the touch at which it is to end; None for none.

    Raises:
        Rejected: The direction is none, or what belongs to a touch is given without one.
    """
    if options.until_contact is not None:
        return contact(options.until_contact, options.direction, options.back_off)
    if options.direction is not None or options.back_off:
        message = "--direction and --back-off say more of a touch at which it is to end, and none is asked for"
        raise failure(Code.BAD_REQUEST, message, field="until-contact", hint="add --until-contact N")
    return None


def _require_task(prompt: str, metadata: Mapping[Any, Any]) -> None:
    tasks = metadata.get("available_tasks")
    if isinstance(tasks, list) and tasks and prompt not in tasks:
        message, hint = f"the policy knows no task {prompt!r}", f"--prompt one of {', '.join(map(repr, tasks))}"
        raise failure(Code.BAD_REQUEST, message, field="prompt", value=prompt, hint=hint)


def _cameras(stack: ExitStack, robot: Robot, layout: Observed, port: int) -> Any:  # noqa: ANN401  a function
    if not layout.images:
        return lambda: None
    from gateway.video.errors import VideoError
    from gateway.video.receiving.source import robot_address
    from gateway.video.video import Video

    try:
        video = stack.enter_context(Video(robot_address(robot.info.robot, None), port=port, strict=True))
        if video.wait_frame(timeout=FIRST_PICTURE_S) is None:
            raise video.silence(FIRST_PICTURE_S)
    except VideoError as error:
        hint = f"{error.hint}; see `ta2 video check`"
        raise failure(Code.PART_STALE, error.message, field="cameras", hint=hint) from None
    return lambda: video.latest


def _require_plot(file: str | None) -> None:
    """Refuse what cannot be drawn, before anything moves."""
    if file is not None and (find_spec("matplotlib") is None or not file.endswith(PICTURES)):
        message = f"no plot {file}: matplotlib draws {' or '.join(PICTURES)}, where it is installed"
        hint = "pip install 'teleavatar-gateway[demo]'"
        raise failure(Code.BAD_REQUEST, message, field="plot", value=file, hint=hint)


def _key(file: str) -> str:
    try:
        return Path(file).read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        message = f"the key in {file} cannot be read: {error}"
        raise failure(Code.BAD_REQUEST, message, field="file", value=file) from None
