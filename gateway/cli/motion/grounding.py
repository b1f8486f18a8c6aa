"""`ta2 gripper`, `payload`, `drive` and `lift`: say what will move, ask, own, do it, and leave the robot as it was found.

A robot whose arms were held when the command came is left held: another one's grip is not this command's to lose.
"""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from msgspec import MsgspecError, Struct
from msgspec.json import decode as json_decode
from msgspec.structs import asdict

from gateway.cli.motion.job import ENABLE_S, PROGRESS_HZ
from gateway.cli.terminal.asking import confirmed
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, report
from gateway.cli.terminal.owning import HELD, LOOK_S, held_text, is_held, owned
from gateway.cli.terminal.progress import Teller, teller
from gateway.client import Control, Payload, Robot
from gateway.errors import Code, GatewayError, Refused, failure

__all__ = ["carry_out"]


Facts = dict[str, object]
Deed = Callable[[Robot, Control, Teller], tuple[str, Facts]]
"""Does it, and returns what to say of it, to people and to scripts."""
Demand = Callable[[Robot], None]
"""Raises what refuses it for good, before anything is said of it and anybody is asked."""


def carry_out(options: Namespace) -> ExitStatus:
    """Do what the command says.

    Raises:
        GatewayError: Nothing was begun.
    """
    return {"gripper": _gripper, "payload": _payload, "drive": _drive, "lift": _lift}[options.command](options)


def _gripper(options: Namespace) -> ExitStatus:
    """Command a gripper and watch what comes of it."""
    side, action, force, raw = options.side, options.action, options.force, options.value or 0.0

    def deed(robot: Robot, own: Control, tell: Teller) -> tuple[str, Facts]:
        tell.advance("enable", None, "waiting for READY")
        own.enable(timeout=ENABLE_S)
        tell.advance("enable", 1.0, "READY")
        hand = own.left_gripper if side == "left" else own.right_gripper
        if action == "set":
            hand.set(raw)
        elif action == "relax":
            hand.relax()
        else:
            (hand.grip if action == "grip" else hand.open)(force)
        holding, input_ratio, torque_nm = None, None, None
        begin_ns: int | None = None
        for state in robot.states(max_rate=PROGRESS_HZ, timeout=LOOK_S):
            begin_ns = state.view.at_ns if begin_ns is None else begin_ns
            grip = state.grip(hand.side)
            holding, input_ratio, torque_nm = grip.holding, grip.input_ratio, grip.torque_nm
            done = min(1.0, (state.view.at_ns - begin_ns) / (options.for_s * 1e9))
            tell.advance(action, done, _holding_text(holding))
            if done >= 1.0:
                break
        sent = "" if input_ratio is None or torque_nm is None else f" sent {input_ratio:.2f} ({torque_nm:+.2f} N·m),"
        text = f"{side} gripper:{sent} {_holding_text(holding)}"
        return text, {"side": side, "input": input_ratio, "torque_nm": torque_nm, "holding": holding}

    what = {"grip": f"closes with {force:g} of its torque", "open": f"opens with {force:g} of its torque"}
    plan = what.get(action, "gets no torque" if action == "relax" else f"is sent {raw:g}")
    return _own_for(options, f"the {side} gripper {plan}", deed)


def _holding_text(holding: bool | None) -> str:
    if holding is None:
        return "nobody can tell whether it holds something"
    return "it seems to hold something (an estimate)" if holding else "it seems to hold nothing (an estimate)"


def _payload(options: Namespace) -> ExitStatus:
    """Weigh what a hand holds, or say that it holds nothing."""
    side, empty = options.arm, None if options.empty is None else _kept(Path(options.empty))

    def deed(_: Robot, own: Control, tell: Teller) -> tuple[str, Facts]:
        arm = own.left_arm if side == "left" else own.right_arm
        if options.none:
            arm.payload(None)
            return f"{side} hand: nothing is counted on", {"side": side, "payload": None}
        tell.advance("enable", None, "waiting for READY")
        own.enable(timeout=ENABLE_S)
        tell.advance("weigh", None, "swinging in three postures")
        found = arm.payload(empty=empty)
        tell.advance("weigh", 1.0, "done")
        text = f"{side} hand: {found.mass:.3f} ± {found.mass_sd:.3f} kg"
        if found.com is None or found.com_sd is None:
            text += ", which may be nothing: not counted on"
        else:
            places = (f"{place:.3f} ± {sd:.3f}" for place, sd in zip(found.com, found.com_sd, strict=True))
            text += f" at {', '.join(places)} m in {found.frame}; counted on"
        return text, {"side": side, "payload": asdict(found)}

    def demand(robot: Robot) -> None:
        if robot.state.arm(side).contact is None:
            message = "this gateway does not feel what the hands hold: it was started without dynamics"
            hint = "set `dynamics = true` in section [model] of its configuration, and start it anew"
            raise failure(Code.MODEL_OFF, message, field="model.dynamics", value="false", hint=hint)

    what = (
        "hand is said to hold nothing"
        if options.none
        else "arm swings by 0.05 rad, its hand tilts by 0.3 rad, some 15 s"
    )
    return _own_for(options, f"the {side} {what}", deed, demand)


class _Kept(Struct):
    payload: Payload


def _kept(path: Path) -> Payload:
    """Return what a weighing printed as JSON."""
    try:
        return json_decode(path.read_bytes(), type=_Kept).payload
    except (OSError, MsgspecError) as error:
        hint = "`ta2 payload --arm SIDE --json > FILE` with the empty hand makes one"
        raise failure(Code.BAD_CONFIG, f"{path} is no weighing: {error}", hint=hint) from None


def _drive(options: Namespace) -> ExitStatus:
    """Drive the chassis for a time."""
    vx, vy, wz = options.vx, options.vy, options.wz
    velocity = f"({vx:g}, {vy:g}) m/s, {wz:g} rad/s"

    def deed(_: Robot, own: Control, tell: Teller) -> tuple[str, Facts]:
        tell.advance("drive", None, velocity)
        own.chassis.drive_for(vx, vy, wz, options.for_s)
        tell.advance("drive", 1.0, "at rest")
        return f"drove with {velocity} for {options.for_s:g} s", {"vx": vx, "vy": vy, "wz": wz, "for_s": options.for_s}

    return _own_for(options, f"the chassis drives with {velocity} for {options.for_s:g} s", deed)


def _lift(options: Namespace) -> ExitStatus:
    """Drive the lift for a time, or take its servo off."""
    action, speed = options.action, options.speed

    def deed(_: Robot, own: Control, tell: Teller) -> tuple[str, Facts]:
        tell.advance("lift", None, action)
        if action == "off":
            own.lift.disable()
        else:
            own.lift.drive_for(speed if action == "up" else -speed, options.for_s)
        tell.advance("lift", 1.0, "stopped")
        moved = "its servo is off" if action == "off" else f"drove {action} with {speed:g} for {options.for_s:g} s"
        return f"lift: {moved}", {"action": action, "speed": speed, "for_s": options.for_s}

    def demand(robot: Robot) -> None:
        if not robot.info.has_lift:
            raise failure(Code.NO_LIFT, f"the {robot.info.model} model has no lift (manual §1.2)", field="lift")

    how = (
        "the lift stops and its servo goes off"
        if action == "off"
        else f"the lift drives {action} for {options.for_s:g} s"
    )
    return _own_for(options, how, deed, demand)


def _own_for(options: Namespace, what: str, deed: Deed, demand: Demand = lambda _: None) -> ExitStatus:
    """Own the robot for a deed, and leave it held where it was, or shall be."""
    with connected(options.command, options.target, options.timeout_s) as robot:
        demand(robot)
        print(f"{options.command}: {what}", file=sys.stderr)
        if not options.yes and not confirmed():
            print("nothing was done", file=sys.stderr)
            return ExitStatus.REFUSED
        is_left_held = (options.command == "gripper" and options.hold) or robot.state.state in HELD
        try:
            with teller() as tell, owned(robot, tell, take=options.take, is_left_held=is_left_held) as own:
                try:
                    text, facts = deed(robot, own, tell)
                except GatewayError as error:
                    if not is_left_held and (isinstance(error, Refused) or options.command != "gripper"):
                        with suppress(GatewayError):  # nothing is held: end what this command began
                            own.release()
                    raise
        except GatewayError as error:
            status = report(error, as_json=options.json)
            if is_held(robot):
                print(held_text(robot, options.command), file=sys.stderr)
            return status
        except KeyboardInterrupt:
            if is_held(robot):
                print(f"\ninterrupted: {held_text(robot, options.command)}", file=sys.stderr)
            raise
        if is_left_held and options.command == "gripper":
            print(held_text(robot, options.command), file=sys.stderr)
    if options.json:
        print(json.dumps({"ok": True, **facts, "held": is_left_held}))
    else:
        print(f"{text}; {'held' if is_left_held else 'released'}")
    return ExitStatus.OK
