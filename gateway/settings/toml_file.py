"""The settings file: TOML to frozen `Settings` and back, and the few things read from the environment.

Rules it obeys
    * Every field of the settings is one key of the file; times are in seconds or milliseconds there (`_s`, `_ms`).
    * An unknown section or key is an error that lists the known ones and names the closest.
    * The file may only tighten the robot's limits: the settings refuse, here the refusal becomes a `ConfigError` with
      file, key, value, bound, unit and what to do.
    * Keys that the file leaves out keep their defaults; `configs/default.toml` shows all of them.

It does not know what any setting is for.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard, get_type_hints

from msgspec import Struct
from msgspec.structs import replace

from gateway.errors import Code, GatewayError, failure
from gateway.settings.settings import Settings, SettingsRefused
from gateway.values import Side, Vector

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its old name
    import tomli as tomllib

__all__ = ["KEYS", "SECTIONS", "Key", "Kind", "lines", "load", "loads", "overridden", "show", "state_dir", "state_dirs"]

SERVICE_STATE = Path("/var/lib/ta2")
MS = 1_000_000
S = 1_000_000_000

ENCODING = "utf-8-sig"
"""UTF-8, with or without a mark of its order."""
_TEXT = partial(Path.read_text, encoding=ENCODING)

INT64_MAX = 2**63 - 1
"""TOML promises integers up to this size; the parser would take any."""

SECTIONS = {
    "robot": "link",
    "arm": "arm",
    "chassis": "chassis",
    "lift": "lift",
    "pose": "pose",
    "loss": "loss",
    "enable": "enable",
    "foreign": "foreign",
    "model": "model",
    "local": "local",
    "realtime": "realtime",
    "guard": "guard",
}
"""Section of the file -> field of `Settings`, in the order of `show`."""

IN_MILLISECONDS = frozenset(
    {
        "arm.settle_ns",
        "arm.tracking_ns",
        "chassis.expiry_ns",
        "lift.expiry_ns",
        "loss.keepalive_ns",
        "enable.stale_ns",
        "enable.hold_stale_ns",
        "enable.fsm_valid_ns",
        "enable.seed_ns",
        "enable.seed_lag_ns",
        "enable.late_ns",
        "guard.freeze_ns",
    }
)
"""Times that the file has in milliseconds; all others are in seconds there."""

TIGHTEN = "stay inside the bound: limits can only be tightened"


class Kind(str, Enum):
    """What a key takes."""

    NUMBER = "a number"
    WHOLE = "a whole number of at most 64 bits"
    OCTAL = "permission bits such as 0o660"
    SWITCH = "true or false"
    TEXT = "a text in quotes"
    TIME = "a finite number"
    JOINTS = "left and right with a list of numbers each"


class Key(Struct, frozen=True, kw_only=True):
    """One key of the file.

    Attributes:
        section: Section of the file.
        name: Name in the file, e.g. `keepalive_ms`.
        field: Field of the section's dataclass, e.g. `keepalive_ns`.
        kind: What it takes.
        scale: Nanoseconds per unit of the file for a time, else 1.
    """

    section: str
    name: str
    field: str
    kind: Kind
    scale: int = 1

    @property
    def unit(self) -> str:
        """Unit of a time in the file; empty for anything else."""
        return {MS: "ms", S: "s"}.get(self.scale, "")


def _keys_of(section: str, part: type) -> dict[str, Key]:
    kinds = {float: Kind.NUMBER, int: Kind.WHOLE, bool: Kind.SWITCH, str: Kind.TEXT, Mapping[Side, Vector]: Kind.JOINTS}
    keys: dict[str, Key] = {}
    for name, hint in get_type_hints(part).items():
        if name.endswith("_ns"):
            scale, suffix = (MS, "_ms") if f"{section}.{name}" in IN_MILLISECONDS else (S, "_s")
            key = Key(section=section, name=name[:-3] + suffix, field=name, kind=Kind.TIME, scale=scale)
        else:
            kind = Kind.OCTAL if name == "socket_mode" else kinds[hint]
            key = Key(section=section, name=name, field=name, kind=kind)
        keys[key.name] = key
    return keys


PARTS: dict[str, type] = {name: get_type_hints(Settings)[part] for name, part in SECTIONS.items()}
KEYS: dict[str, dict[str, Key]] = {section: _keys_of(section, part) for section, part in PARTS.items()}
"""Every key of the file, by section and name."""

DEFAULT_FILES = (Path(__file__).with_name("default.toml"), Path(__file__).parents[2] / "configs" / "default.toml")
"""Where the defaults stand: beside this module when installed, else in the checkout."""


# ------------------------------------------------------------------------------------------------------------- reading


def load(path: Path | str | None = None, read: Callable[[Path], str] = _TEXT) -> Settings:
    """Read a settings file.

    Args:
        path: TOML file; None for the defaults that come with the package.
        read: Reads the text of a file.

    Returns:
        Settings; keys that the file leaves out have their defaults.

    Raises:
        ConfigError: The file cannot be read, or something in it is unknown, malformed or too loose.
    """
    if path is None:
        path = next((file for file in DEFAULT_FILES if file.exists()), DEFAULT_FILES[0])
    try:
        text = read(Path(path))
    except OSError as error:
        reason = error.strerror or str(error)
        raise _error(str(path), f"cannot be read: {reason}", hint="check path and permissions of the file") from error
    except UnicodeDecodeError as error:
        raise _error(str(path), f"is no UTF-8 text: {error.reason} at byte {error.start}") from error
    return loads(text, str(path))


def loads(text: str, origin: str) -> Settings:
    """Read settings from TOML text.

    Args:
        text: TOML.
        origin: How the source is called in errors, usually the path of the file.

    Returns:
        Settings; keys that are not there have their defaults.

    Raises:
        ConfigError: Something is unknown, malformed or too loose.
    """
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # syntax, an endless number, brackets without end
        raise _error(origin, f"is not TOML: {error}", hint="correct the syntax there") from error
    for section in document:
        if section not in KEYS:
            raise _unknown(origin, f"section [{section}]", section, [f"[{name}]" for name in KEYS], list(KEYS))
    parts: dict[str, Any] = {SECTIONS[section]: _part(section, table, origin) for section, table in document.items()}
    return Settings(**parts)


def overridden(
    settings: Settings,
    *,
    robot: str | None = None,
    socket: str | None = None,
    namespace: str | None = None,
    model: str | None = None,
) -> Settings:
    """Return settings with what the command line asks for in place of the file's.

    Args:
        settings: As the file gave them.
        robot: Endpoint of the robot's router, `--robot`; None keeps the file's.
        socket: Path of the unix socket, `--socket`; None keeps the file's.
        namespace: Of the robot's bridge, `--namespace`; None keeps the file's.
        model: Of the robot, `--model`; None keeps the file's.

    Raises:
        ConfigError: The option makes no sense.
    """
    link, local = settings.link, settings.local
    try:
        if robot is not None:
            link = replace(link, endpoint=robot)
        if namespace is not None:
            link = replace(link, namespace=namespace)
        if model is not None:
            link = replace(link, model=model)
        if socket is not None:
            local = replace(local, socket=socket)
    except SettingsRefused as refused:
        option = "robot" if refused.name == "robot.endpoint" else refused.name.rpartition(".")[2]
        raise _too_loose(f"command line, --{option}", refused) from refused
    return replace(settings, link=link, local=local)


def state_dir() -> Path:
    """Return the folder of what survives a restart.

    It is `$TA2_STATE_DIR`, else `$XDG_STATE_HOME/ta2`, else `~/.local/state/ta2`.

    Raises:
        ConfigError: There is neither a variable nor a home.
    """
    env = os.environ
    if env.get("TA2_STATE_DIR"):
        return Path(env["TA2_STATE_DIR"]).expanduser().absolute()
    if Path(env.get("XDG_STATE_HOME", "")).is_absolute():  # the base directory specification ignores relative ones
        return Path(env["XDG_STATE_HOME"]) / "ta2"
    if not Path(env.get("HOME", "")).is_absolute():
        raise _error("environment", "has no HOME to keep the state file in", hint="set TA2_STATE_DIR to a folder")
    return Path(env["HOME"]) / ".local" / "state" / "ta2"


def state_dirs() -> tuple[Path, ...]:
    """Return it, and that of a service; `$TA2_STATE_DIR` stands for both. Raises as `state_dir`."""
    return (state_dir(), *(() if os.environ.get("TA2_STATE_DIR") else (SERVICE_STATE,)))


def _part(section: str, table: object, origin: str) -> object:
    """Build one section's settings from its table."""
    if not isinstance(table, dict):
        message = f"{section} is {_kind_of(table)}; needed: a section"
        raise _error(origin, message, field=section, hint=f"put [{section}] on a line of its own before its keys")
    values: dict[str, Any] = {}
    for name, value in table.items():
        key = KEYS[section].get(name)
        if key is None:
            raise _unknown_key(section, name, origin)
        values[key.field] = _read(key, value, origin)
    try:
        return PARTS[section](**values)
    except SettingsRefused as refused:
        raise _too_loose(origin, refused) from refused


def _read(key: Key, value: object, origin: str) -> object:
    """Return a value of the file as the dataclass has it."""
    match key.kind:
        case Kind.SWITCH if isinstance(value, bool):
            return value
        case Kind.TEXT if isinstance(value, str):
            return value
        case Kind.WHOLE | Kind.OCTAL if _is_whole(value):
            return value
        case Kind.NUMBER if _is_number(value):
            return float(value)
        case Kind.TIME if _is_number(value) and math.isfinite(value * key.scale):
            return round(value * key.scale)
        case Kind.JOINTS if isinstance(value, dict):
            return _joints(key, value, origin)
    raise _wrong_type(key, f"{key.section}.{key.name}", value, key.kind.value, origin)


def _joints(key: Key, table: dict[str, object], origin: str) -> dict[Side, Vector]:
    """Return joint values per side; a side that the file leaves out has its default."""
    joints: dict[Side, Vector] = dict(getattr(PARTS[key.section](), key.field))
    for side, values in table.items():
        field = f"{key.section}.{key.name}.{side}"
        if side not in {s.value for s in Side}:
            raise _unknown(origin, field, side, [s.value for s in Side], [s.value for s in Side])
        if not isinstance(values, list) or not all(_is_number(v) for v in values):
            raise _wrong_type(key, field, values, "a list of numbers", origin)
        joints[Side(side)] = tuple(float(v) for v in values)
    return joints


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= INT64_MAX


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, float) or _is_whole(value)


# ------------------------------------------------------------------------------------------------------------- showing


def show(settings: Settings) -> str:
    """Return the settings as TOML that `loads` reads back to the same settings."""
    blocks = []
    for section, keys in KEYS.items():
        part = getattr(settings, SECTIONS[section])
        own = [line for key in keys.values() for line in lines(key, getattr(part, key.field))]
        blocks.append("\n".join([f"[{section}]", *own]))
    return "\n\n".join(blocks) + "\n"


def lines(key: Key, value: Any) -> list[str]:  # noqa: ANN401  any field of any section
    """Return a value as the file has it."""
    match key.kind:
        case Kind.JOINTS:
            return [f"{key.name}.{side} = [{', '.join(map(repr, value[side]))}]" for side in Side]
        case Kind.TIME:
            whole, rest = divmod(value, key.scale)
            return [f"{key.name} = {value / key.scale!r}" if rest else f"{key.name} = {whole}"]
        case Kind.OCTAL:
            return [f"{key.name} = 0o{value:o}"]
        case Kind.SWITCH:
            return [f"{key.name} = {str(value).lower()}"]
        case Kind.TEXT:
            # JSON escapes as TOML does, but for DEL.
            return [f"{key.name} = {json.dumps(value, ensure_ascii=False)}".replace("\x7f", "\\u007F")]
    return [f"{key.name} = {value!r}"]


# -------------------------------------------------------------------------------------------------------------- errors


def _error(
    origin: str, message: str, *, field: str = "", value: str = "", bound: str = "", unit: str = "", hint: str = ""
) -> GatewayError:
    return failure(Code.BAD_CONFIG, f"{origin}: {message}", field=field, value=value, bound=bound, unit=unit, hint=hint)


def _unknown(origin: str, field: str, name: str, shown: list[str], known: list[str]) -> GatewayError:
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}?" if close else ""
    return _error(origin, f"{field} is unknown; known: {', '.join(shown)}", field=field, value=name, hint=hint)


def _unknown_key(section: str, name: str, origin: str) -> GatewayError:
    home = next((other for other, keys in KEYS.items() if name in keys), None)
    if home is not None:
        message = f"{section}.{name} is unknown; it is a key of [{home}]"
        return _error(origin, message, field=f"{section}.{name}", value=name, hint=f"move it to section [{home}]")
    return _unknown(origin, f"{section}.{name}", name, list(KEYS[section]), list(KEYS[section]))


def _wrong_type(key: Key, field: str, value: object, wanted: str, origin: str) -> GatewayError:
    wanted += f" [{key.unit}]" if key.unit else ""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to print a number of more than 4300 digits
        text = "something endless"
    text = text if len(text) <= 60 else text[:57] + "..."
    message = f"{field} = {text} is {_kind_of(value)}; needed: {wanted}"
    return _error(origin, message, field=field, value=text, unit=key.unit, hint=f"give {wanted}")


def _kind_of(value: object) -> str:
    names = {bool: "a switch", int: "a whole number", float: "a number", str: "a text", list: "a list", dict: "a table"}
    return names.get(type(value), "a date or time")


def _too_loose(origin: str, refused: SettingsRefused) -> GatewayError:
    """Return a refusal of the settings with the names and units of the file."""
    section, _, field = refused.name.partition(".")
    key = next((key for key in KEYS[section].values() if key.field == field), None)
    if key is not None and key.unit:
        refused = refused.in_unit(f"{section}.{key.name}", key.unit, key.scale)
    return _error(
        origin,
        str(refused),
        field=refused.name,
        value=str(refused.value),
        bound=refused.bound_text,
        unit=refused.unit,
        hint=TIGHTEN if refused.bound is not None else f"give a value that is allowed for {refused.name}",
    )
