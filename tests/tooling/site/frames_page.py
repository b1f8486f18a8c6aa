"""The reference of the frames: the tree as its module has it, and the numbers as `ta2 frames` prints them."""

from __future__ import annotations

import io
from contextlib import redirect_stdout

from gateway.cli import main as cli
from gateway.kinematics import frames
from tests.tooling.site.markdown import prose

__all__ = ["page"]


def page() -> str:
    """Return the page."""
    printed = io.StringIO()
    with redirect_stdout(printed):
        status = cli.main(["frames"])
    if status != 0:
        raise RuntimeError(f"ta2 frames ended with {status}")
    return "\n".join(
        [
            "# Frames",
            "",
            prose(frames.__doc__ or "").replace("```\n", "```text\n", 1),
            "",
            "How to ask for a transform, and to use a calibration: [Frames and calibration](../how-to/frames.md).",
            "",
            "## The nominal tree",
            "",
            "What `ta2 frames` prints:",
            "",
            "```text",
            printed.getvalue().rstrip(),
            "```",
            "",
            "![The frames from the front left and from above](../frames.png)",
            "",
        ]
    )
