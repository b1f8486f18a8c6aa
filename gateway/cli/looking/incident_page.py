"""An incident as one page for a browser: plain HTML and SVG, without a script, and nothing is fetched from anywhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from gateway.incident.replay import Incident
from gateway.incident.timeline import Moment, Points, joints
from gateway.robot.topics import ARM_JOINTS
from gateway.values import Side

__all__ = ["page"]

S = 1_000_000_000
WIDTH, HEIGHT, MOST_POINTS = 1000, 120, 1500
STYLE = """body{font:14px system-ui,sans-serif;margin:1.5em;max-width:70em}td{padding:0 .8em;vertical-align:top}
svg{width:100%;height:120px;background:#f6f6f6}.set{stroke:#c33;fill:none}.is{stroke:#36c;fill:none}
.at{stroke:#999}.zero{stroke:#000}.warning{color:#a60}.error{color:#b00;font-weight:bold}path,line{vector-effect:non-scaling-stroke}"""


def page(found: Incident, facts: Mapping[str, Any], moments: Sequence[Moment], zero_ns: int) -> str:
    """Return it; whatever it is made of is escaped.

    Args:
        found: The incident.
        facts: Of it, for the head.
        moments: The timeline.
        zero_ns: What times are relative to [ns].
    """
    asked, measured = joints(found)
    causes = "".join(f"<li><b>{escape(c['code'])}</b> {escape(c['message'])}</li>" for c in facts["causes"])
    rows = "".join(
        f"<tr class={m.level}><td>{(m.at_ns - zero_ns) / S:+.2f}&nbsp;s</td><td>{m.kind}</td><td>{escape(m.text)}</td></tr>"
        for m in moments
    )
    charts = "".join(_charts(asked, measured, [m.at_ns for m in moments if m.level != "info"], zero_ns))
    name, release = escape(facts["name"]), escape(" ".join(f"{k} {v}" for k, v in facts["release"].items()))
    return f"""<!doctype html><html lang=en><meta charset=utf-8><title>{name}</title>
<meta http-equiv=Content-Security-Policy content="default-src 'none'; style-src 'unsafe-inline'"><style>{STYLE}</style>
<h1>{name}</h1><p>{escape(str(facts["robot"]))} &middot; {release}</p><ul>{causes}</ul>
<p>Joints over time: setpoints red, measured blue; lines are warnings.</p>
{charts}<h2>What happened</h2><table>{rows}</table></html>"""


def _charts(
    asked: Mapping[Side, Points], measured: Mapping[Side, Points], marks: Sequence[int], zero_ns: int
) -> Iterator[str]:
    times = [at_ns for points in (*asked.values(), *measured.values()) for at_ns, _ in points]
    if not times:
        return
    begin_ns, span_ns = min(times), max(max(times) - min(times), 1)

    def x(at_ns: int) -> float:
        return WIDTH * (at_ns - begin_ns) / span_ns

    lines = [f"<line class=at x1={x(t):.1f} x2={x(t):.1f} y1=0 y2={HEIGHT} />" for t in marks if t >= begin_ns]
    lines.append(f"<line class=zero x1={x(zero_ns):.1f} x2={x(zero_ns):.1f} y1=0 y2={HEIGHT} />")
    for side in Side:
        for joint, name in enumerate(ARM_JOINTS[side]):
            values = [q[joint] for points in (asked[side], measured[side]) for _, q in points]
            if not values:
                continue
            low, high = min(values), max(values)
            room = max(high - low, 0.02)
            paths = []
            for kind, points in (("set", asked[side]), ("is", measured[side])):
                step = len(points) // MOST_POINTS + 1
                dots = [f"{x(t):.1f} {HEIGHT * (0.95 - 0.9 * (q[joint] - low) / room):.1f}" for t, q in points[::step]]
                paths.append(f'<path class={kind} d="M{" L".join(dots)}" />' if dots else "")
            box = f'viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio=none role=img aria-label="{name}"'
            yield f"<h3>{side} {name}: {low:.3f} to {high:.3f} rad</h3><svg {box}>{''.join(lines)}{''.join(paths)}</svg>"
