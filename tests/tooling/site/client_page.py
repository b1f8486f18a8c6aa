"""The reference of the Python client: which docstrings stand where. mkdocstrings reads them."""

from __future__ import annotations

from gateway import client as package
from gateway.client import aio, client
from tests.tooling.site.markdown import prose

__all__ = ["PARTS", "RECORD", "page"]

PARTS = {
    "Connect and look": (
        "connect",
        "Robot",
        "RobotState",
        "MotorState",
        "ArmState",
        "Contact",
        "Pose",
        "Health",
        "Why",
        "Finding",
    ),
    "Own": ("Control", "ArmControl", "GripperControl", "ChassisControl", "LiftControl", "Credentials"),
    "Motions and streams": (
        "MotionHandle",
        "MotionResult",
        "contact",
        "Payload",
        "FollowCheck",
        "PoseTarget",
        "JointStream",
        "PoseStream",
        "ChassisStream",
        "LiftStream",
    ),
    "Stop and watch": ("StopResult", "StopEndpoint", "EventStream"),
}
"""Every name of `gateway.client`, in the order in which they are met."""

RECORD = ("client.recording.Recording", "api.recorder_protocol.RecordingState")
"""What `Robot.recording` gives: loaded by whoever asks for it alone."""


def page() -> str:
    """Return the page."""
    lines = ["# Client", "", (package.__doc__ or "").partition("\n\n")[0], "", prose(client.__doc__ or ""), ""]
    for title, names in PARTS.items():
        lines += [f"## {title}", ""]
        lines += [line for name in names for line in (f"::: gateway.client.{name}", "")]
    lines += ["## Record", ""] + [line for name in RECORD for line in (f"::: gateway.{name}", "")]
    lines += ["## asyncio", "", prose(aio.__doc__ or ""), ""]
    lines += ["## Errors", "", "What each code means, and what to do: [codes](codes.md).", ""]
    lines += [
        "::: gateway.errors",
        "    options:",
        "      show_root_heading: false",
        "      show_root_toc_entry: false",
        "",
    ]
    return "\n".join(lines)
