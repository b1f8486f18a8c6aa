"""Writes a description as a URDF, for tests of what reads one."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from gateway.kinematics.description import Description, Kind

__all__ = ["written"]


def written(description: Description, path: Path) -> Path:
    """Write joints and inertias of a description to a file; return its path."""
    links = {link for joint in description.joints.values() for link in (joint.parent, joint.child)}
    lines = ['<?xml version="1.0"?>', '<robot name="teleavatar">']
    for link in sorted(links):
        lines.append(f"<link name={quoteattr(link)}>")
        inertia = description.inertias.get(link)
        if inertia is not None:
            names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            moments = " ".join(f'{n}="{v!r}"' for n, v in zip(names, inertia.inertia_kgm2, strict=True))
            lines.append(f'<inertial><origin xyz="{_text(inertia.com_m)}"/><mass value="{inertia.mass_kg!r}"/>')
            lines.append(f"<inertia {moments}/></inertial>")
        lines.append("</link>")
    for joint in reversed(description.joints.values()):  # a URDF promises no order
        lines.append(f'<joint name={quoteattr(joint.name)} type="{joint.kind.value}">')
        lines.append(f'<origin xyz="{_text(joint.xyz_m)}" rpy="{_text(joint.rpy_rad)}"/>')
        lines.append(f"<parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>")
        if joint.kind is not Kind.FIXED:
            lines.append(f'<axis xyz="{_text(joint.axis)}"/>')
            ends = "" if joint.kind is Kind.CONTINUOUS else f'lower="{joint.lower!r}" upper="{joint.upper!r}" '
            lines.append(f'<limit {ends}effort="{joint.effort!r}" velocity="{joint.velocity!r}"/>')
        lines.append("</joint>")
    path.write_text("\n".join([*lines, "</robot>", ""]), encoding="utf-8")
    return path


def _text(values) -> str:
    return " ".join(map(repr, values))
