"""What a page shows beside the gateway's state: the shape of the body, recordings on the disk, and a check of the robot.

    GET  /api/body         names, radii and fixed frames of the body; where it is comes with each state
    GET  /api/recordings   those in the folder that `ta2 web --recordings` names; POST looks anew
    GET  /api/check        what `ta2 check` found; POST looks anew: nothing is sent, nothing moves

Episodes are begun and judged by the owner, over the page's own socket: `messages.Episode`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from gateway.web.body import Body, BodyShape
from gateway.web.job import Job, JobSeen

__all__ = ["Beside"]


OTHERWISE = {"recordings": "no folder is listed: ta2 web --recordings DIR", "check": "nothing is checked here"}
"""Jobs by their paths, and what is said where there is no such one."""


@dataclass(frozen=True, kw_only=True)
class Beside:
    """What there is: the robot's body (None shows none, and why), and commands that list recordings or check the robot."""

    body: Body | None = None
    why_no_body: str = ""
    jobs: Mapping[str, Job] = field(default_factory=dict)

    def routes(self) -> list[Route]:
        """Return what there is under which path."""

        async def body(_: Request) -> Response:
            return _json(BodyShape(parts=(), frames={}, why=self.why_no_body) if self.body is None else self.body.shape)

        async def job(request: Request) -> Response:
            name = request.url.path.rpartition("/")[2]
            asked = self.jobs.get(name)
            if asked is None:
                return _json(JobSeen(is_running=False, report=None, error=OTHERWISE[name]))
            if request.method == "POST":
                asked.begin()
            return _json(asked.seen)

        jobs = [Route(f"/api/{name}", job, methods=["GET", "POST"]) for name in OTHERWISE]
        return [Route("/api/body", body), *jobs]

    async def close(self) -> None:
        """End what runs."""
        for job in self.jobs.values():
            await job.end()


def _json(value: object) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")
