"""The description of the HTTP API (OpenAPI 3.1), made from the very structs that go over the wire."""

from __future__ import annotations

import functools
from typing import Any

import msgspec

from gateway import __version__
from gateway.api.protocol import Finding, Info, Notice, RefusalMessage, Snapshot
from gateway.api.recorder_protocol import RecordingState
from gateway.web.body import BodySeen, BodyShape
from gateway.web.job import JobSeen
from gateway.web.messages import Asked, CamerasSeen, LoginAsked, StopAsked, StopDone

__all__ = ["description"]


class State(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="state"):
    """A state, as `GET /api/state` and the live socket give it."""

    info: Info | None
    state: Snapshot
    body: BodySeen | None = None
    recording: RecordingState | None = None


class Gone(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="gone"):
    """No gateway answers now; said again each second."""


class Noticed(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="notice"):
    """A notice; numbers rise by one."""

    number: int
    notice: Notice


class Replied(msgspec.Struct, frozen=True, kw_only=True, tag_field="type", tag="reply"):
    """The reply to what a page asked for; `id` is null where that had none that could be read."""

    id: int | None
    ok: bool
    facts: dict[str, Any] = {}
    error: RefusalMessage | None = None


class Error(msgspec.Struct, frozen=True, kw_only=True):
    """An answer with a status of 400 or more."""

    error: RefusalMessage


class Reasons(msgspec.Struct, frozen=True, kw_only=True):
    """What keeps the robot from doing what it is told."""

    state: str
    findings: tuple[Finding, ...]
    latches: dict[str, str]
    refusals: dict[str, RefusalMessage]


class Nothing(msgspec.Struct, frozen=True):
    """Done; there is nothing to tell."""


SEEN = (CamerasSeen, BodyShape, JobSeen)
TYPES = (State, Gone, Noticed, Replied, Error, Reasons, Nothing, StopAsked, StopDone, LoginAsked, *SEEN, Asked)
SECURITY: list[dict[str, list[str]]] = [{"secret": []}]
FAILURES = {
    "400": "What was asked for is wrong.",
    "401": "The secret is missing or wrong.",
    "403": "Not for pages of other sites.",
    "404": "There is nothing.",
    "405": "Not by this method.",
    "409": "Refused; nothing moved.",
    "429": "Too many logins failed.",
    "503": "No gateway answers.",
    "504": "The reply was lost, or came too late.",
}
REFERENCE = "#/components/schemas/{name}"


@functools.cache
def description() -> bytes:
    """Return the document as JSON."""
    schemas, components = msgspec.json.schema_components(TYPES, ref_template=REFERENCE)
    named = dict(zip(TYPES, schemas, strict=True))
    components["Asked"] = named[Asked]

    def content(kind: type) -> dict[str, Any]:
        return {"application/json": {"schema": named[kind]}}

    def operation(summary: str, gives: type, takes: type | None = None, *, is_open: bool = False) -> dict[str, Any]:
        responses = {"200": {"description": "Done.", "content": content(gives)}}
        for status, text in FAILURES.items():
            responses[status] = {"description": text, "content": content(Error)}
        made: dict[str, Any] = {"summary": summary, "responses": responses, "security": [] if is_open else SECURITY}
        if takes is not None:
            made["requestBody"] = {"required": False, "content": content(takes)}
        return made

    def job(what: str) -> dict[str, Any]:
        anew = operation(f"Look at {what} anew; answered at once.", JobSeen)
        return {"get": operation(f"What was last seen of {what}.", JobSeen), "post": anew}

    paths = {
        "/api/state": {"get": operation("What the gateway sees now.", State)},
        "/api/why": {"get": operation("What keeps the robot from doing what it is told.", Reasons)},
        "/api/video": {"get": operation("How the cameras are seen.", CamerasSeen)},
        "/api/body": {"get": operation("Parts and fixed frames of the body.", BodyShape)},
        "/api/recordings": job("the recordings on the disk"),
        "/api/check": job("the robot, as `ta2 check` does"),
        "/api/stop": {
            "post": operation(
                "Stop: arms brake and are held, chassis and lift stop.", StopDone, StopAsked, is_open=True
            )
        },
        "/api/estop": {
            "post": operation("Stop, and pause the robot; the grip is lost.", StopDone, StopAsked, is_open=True)
        },
        "/api/recover": {"post": operation("Clear what holds motion off, if its cause is gone.", Nothing, StopAsked)},
        "/api/login": {"post": operation("Log in, where there are users.", Nothing, LoginAsked, is_open=True)},
        "/api/logout": {"post": operation("Log out; what is open by the login is closed.", Nothing)},
    }
    live = (
        "The WebSocket `/api/live` gives the messages State, Gone, Noticed and Replied, and takes what Asked describes; "
        "whoever owns the robot says Alive once a second. Closing it is losing the client: the robot is held. "
        "`/api/video/NAME` is a view of the cameras as motion JPEG."
    )
    document = {
        "openapi": "3.1.0",
        "info": {"title": "TeleAvatar gateway", "version": __version__, "description": live},
        "paths": paths,
        "components": {
            "schemas": components,
            "securitySchemes": {
                "secret": {
                    "type": "http",
                    "scheme": "bearer",
                    "description": "What `ta2 web` prints, or the cookie of a login.",
                }
            },
        },
    }
    return msgspec.json.encode(document)
