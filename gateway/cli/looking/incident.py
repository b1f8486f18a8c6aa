"""`ta2 incident`: what the black box has kept: list it, show it (also as a page), and run the engine on it again.

It reads files and needs no gateway. `replay` gives status 0 when every frame is the same, bit by bit, else 1.
"""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from gateway.cli.looking.boxes import boxes, places
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, Refusal, failure, to_exception
from gateway.incident.recorder import release
from gateway.incident.replay import Incident, incident, replay
from gateway.incident.timeline import timeline

__all__ = ["carry_out"]

S = 1_000_000_000


def carry_out(options: Namespace) -> ExitStatus:
    """List, show or replay.

    Raises:
        Rejected: BAD_REQUEST, there is no such incident, or it cannot be read.
    """
    among = places() if options.dir is None else [options.dir]
    if options.verb == "list":
        return _list(among, as_json=options.json)
    path = _find(among, options.name)
    try:
        found = incident(path)
        return _show(found, options) if options.verb == "show" else _replay(found, as_json=options.json)
    except BrokenPipeError:  # nobody reads on: no fault of the incident
        raise
    except (OSError, ValueError) as error:
        raise failure(Code.BAD_REQUEST, f"{path}: {error}", field="incident") from None


def _kept(among: Sequence[Path]) -> tuple[list[Path], ExitStatus]:
    found, status = boxes(among)
    notes = (note for box in found for note in box.glob("kept/[!.]*/incident.json"))
    return sorted((note.parent for note in notes), key=lambda path: path.name), status


def _find(among: Sequence[Path], name: str) -> Path:
    """Return the folder of an incident: a path, a name, or the newest."""
    if name and (Path(name) / "incident.json").is_file():
        return Path(name)
    found = [path for path in _kept(among)[0] if name in ("", path.name)]
    if found:
        return found[-1]
    what = f"no incident {name!r} is kept" if name else "no incident is kept"
    hint = "`ta2 incident list`; --dir DIR for another place"
    message = f"{what} in {' or '.join(map(str, among))}"
    raise to_exception(Refusal(code=Code.BAD_REQUEST, message=message, field="incident", hint=hint))


def _list(among: Sequence[Path], *, as_json: bool) -> ExitStatus:
    kept, status = _kept(among)
    rows: list[dict[str, Any]] = []
    for path in kept:
        try:
            found = incident(path)
            code, message, kept_ns = *found.causes[0][:2], found.kept_ns
        except (OSError, ValueError, IndexError) as error:
            code, message, kept_ns = "UNREADABLE", str(error), 0
        size = sum(box.stat().st_size for box in path.iterdir())
        rows.append(
            {
                "name": path.name,
                "robot": path.parents[1].name,
                "code": code,
                "message": message,
                "bytes": size,
                "kept_ns": kept_ns,
            }
        )
    if as_json:
        print(json.dumps(rows, ensure_ascii=False, indent=2))
    for row in () if as_json else rows:
        print(f"{row['name']}  {row['robot']}  {row['bytes'] / 1e6:.1f} MB  {row['message']}")
    if not (rows or as_json):
        print(f"no incident is kept in {' or '.join(map(str, among))}")
    return status


def _facts(found: Incident) -> dict[str, Any]:
    header = found.pieces[-1].header if found.pieces else {}
    causes = [cause._asdict() for cause in found.causes]
    return {"name": found.path.name, "robot": header.get("robot", ""), "causes": causes, "release": dict(found.release)}


def _show(found: Incident, options: Namespace) -> ExitStatus:
    moments = list(timeline(found))
    zero_ns = next((cause.at_ns for cause in found.causes if cause.at_ns), moments[-1].at_ns if moments else 0)
    if options.html is not None:
        from gateway.cli.looking.incident_page import page

        options.html.write_text(page(found, _facts(found), moments, zero_ns), encoding="utf-8")
    if options.json:
        lines = [{"t_s": round((m.at_ns - zero_ns) / S, 3), **m._asdict()} for m in moments]
        print(json.dumps({**_facts(found), "timeline": lines}, ensure_ascii=False, indent=2))
        return ExitStatus.OK
    console = Console(highlight=False)
    for code, message, _ in found.causes:
        console.print(Text.assemble("kept for ", (code, "bold red"), f": {message}"), soft_wrap=True)
    for moment in moments:
        when = (
            datetime.fromtimestamp((moment.at_ns + found.wall_ns) / S, timezone.utc)
            .astimezone()
            .strftime("%H:%M:%S.%f")[:-3]
        )
        style = {"warning": "yellow", "error": "bold red"}.get(moment.level, "")
        line = Text.assemble((f"{when} {(moment.at_ns - zero_ns) / S:+8.2f} s  ", "dim"), (moment.text, style))
        console.print(line, soft_wrap=True)
    return ExitStatus.OK


def _replay(found: Incident, *, as_json: bool) -> ExitStatus:
    here, begun_s = release(), time.monotonic()
    others = {name: value for name, value in found.release.items() if here.get(name) != value}
    done = replay(found)
    is_same = done.difference is None and done.ticks > 0
    if as_json:
        facts = {"ticks": done.ticks, "frames": done.frames, "gaps": done.gaps, "other_release": others}
        difference = None if done.difference is None else done.difference._asdict()
        print(json.dumps({"is_identical": is_same, **facts, "difference": difference}, ensure_ascii=False, indent=2))
        return ExitStatus.OK if is_same else ExitStatus.REFUSED
    for name, value in others.items():
        print(f"recorded by another release: {name} {value}, here {here.get(name)}")
    print(f"{done.ticks} ticks, {done.frames} frames, {done.gaps} gaps, in {time.monotonic() - begun_s:.1f} s")
    if done.difference is not None:
        now_ns, what, was, now = done.difference
        print(f"differs at {now_ns} ns: {what}\n  recorded {was}\n  replayed {now}")
    print("identical, bit by bit" if is_same else "NOT identical" if done.ticks else "nothing to replay")
    return ExitStatus.OK if is_same else ExitStatus.REFUSED
