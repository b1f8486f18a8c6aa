"""The client for asyncio: the same as `client`, with `await` where that one waits.

```python
async with aio.connect(name="policy-a") as robot:
    async with robot.control() as own:
        await own.enable()
        await (await own.left_arm.move_to(q_goal, speed=0.3))
        async with own.left_arm.stream(rate_hz=50) as out:
            async for target in policy():
                out.set(target)
                await out.tick()
```

Rules
    * Both clients run the same procedures; names, units and exceptions are those of `client`, which documents them.
    * An `async with control()` that is left by an exception, cancellation included (Ctrl-C under `asyncio.run` is one),
      leaves the robot held. A wait that is cancelled alone, by a timeout of yours, takes nothing back: what was asked for
      goes on, a motion without a handle, too, until `hold()`, `stop()` or the next one.
    * The keepalive has its own thread: a busy event loop does not lose the robot, and a wedged one keeps it; give
      streams an expiry.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Generator, Mapping
from typing import TYPE_CHECKING, Any, Literal

from gateway.api import protocol
from gateway.client.aio_control import ArmControl, Control, JointStream, MotionHandle, PoseStream
from gateway.client.aio_parts import ChassisControl, ChassisStream, GripperControl, LiftControl, LiftStream
from gateway.client.aio_stop_endpoint import StopEndpoint
from gateway.client.asking import procedures, watching
from gateway.client.asking.chunks import FollowCheck, Wishes, check_follow
from gateway.client.asking.options import OnExitName, program_name, require_options, transport_to
from gateway.client.asking.requests import seconds
from gateway.client.asking.results import StopResult
from gateway.client.asking.waits import dropped
from gateway.client.awaiting import run
from gateway.client.connection.over_zenoh import Credentials
from gateway.client.connection.session import Session
from gateway.client.connection.transport import Transport
from gateway.client.state.health import Health, health_of
from gateway.client.state.reading import RobotState, state_of
from gateway.client.state.reasons import Why, why_of
from gateway.client.state.showing import robot_table
from gateway.errors import Disconnected, OutcomeUnknown

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from gateway.client.aio_recording import Recording

__all__ = [
    "ArmControl",
    "ChassisControl",
    "ChassisStream",
    "Connecting",
    "Control",
    "EventStream",
    "GripperControl",
    "JointStream",
    "LiftControl",
    "LiftStream",
    "MotionHandle",
    "PoseStream",
    "Robot",
    "StopEndpoint",
    "connect",
]


def connect(
    target: str | None = None,
    *,
    name: str | None = None,
    timeout_s: float = 5.0,
    credentials: Credentials | None = None,
    transport: Transport | None = None,
    greet: bool = True,
) -> Connecting:
    """Connect to the daemon of a robot, in `async with`, or by awaiting it.

    Arguments and exceptions as in `client.connect`.
    """
    session = Session(transport or transport_to(target, credentials), name or program_name())
    return Connecting(session, timeout_s, greet)


class Connecting:
    """A connection that is being made; await it, or use it in `async with`."""

    def __init__(self, session: Session, timeout_s: float, greet: bool = True) -> None:
        self._session = session
        self._timeout_s = timeout_s
        self._greet = greet

    def __await__(self) -> Generator[Any, None, Robot]:
        return self._connect().__await__()

    async def __aenter__(self) -> Robot:
        return await self._connect()

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self._session.close)

    async def _connect(self) -> Robot:
        session = self._session
        try:
            timeout_ns = seconds("timeout_s", self._timeout_s)
            await asyncio.to_thread(session.open, self._timeout_s)
            if self._greet:
                await run(session, procedures.greet(session, timeout_ns))
        except BaseException:  # cancellation included: nobody will get the robot that could close it
            await asyncio.to_thread(session.close)  # which waits for the network
            raise
        return Robot(session)


class EventStream(watching.Feed):
    """Notices in their order, for one reader. As `client.EventStream`."""

    def __aiter__(self) -> EventStream:
        return self

    async def __anext__(self) -> protocol.Notice:
        """Return the next notice."""
        notice = await run(self._session, self._next())
        if notice is None:
            raise StopAsyncIteration
        return notice


class Robot:
    """A connected robot, to look at, to stop, and to own. As `client.Robot`."""

    def __init__(self, session: Session) -> None:
        self._session = session

    async def __aenter__(self) -> Robot:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Disconnect. A robot that is still owned is left held. May be called again."""
        await asyncio.to_thread(self._session.close)

    def __repr__(self) -> str:
        """Show where it is connected to and as whom."""
        return f"<robot at {self._session.transport.address} for {self._session.name!r}>"

    def _repr_html_(self) -> str:
        """Show it with its state as a table, in a notebook."""
        return robot_table(self._session, state_of)

    @property
    def client_id(self) -> str:
        """Identity of this client, as in `state.lease.client_id`."""
        return self._session.client_id

    async def info(self) -> protocol.Info:
        """Return what does not change while the daemon runs; asked once per daemon."""
        return await run(self._session, procedures.get_info(self._session))

    async def routes(self) -> protocol.Routes:
        """Return how the robot's bridge stands to each topic, as the daemon's discovery knows it."""
        return await run(self._session, procedures.get_routes(self._session))

    async def state(self) -> RobotState:
        """Return the newest state; waits only for the first one of a daemon that has just come."""
        self._session.require_daemon()
        sighting = self._session.sighting()
        if sighting is None:
            sighting = await run(self._session, watching.first(self._session))
        return state_of(sighting, self._session.transport.now_ns())

    async def why(self) -> Why:
        """Return what is known to keep the robot from doing what it is told. As `client.Robot.why`."""
        return why_of(await self.state())

    async def check_follow(
        self,
        points: Mapping[str, ArrayLike],
        dt: float | None = None,
        *,
        from_here: bool = True,
        **wishes: Unpack[Wishes],
    ) -> FollowCheck:
        """Have points judged as `Control.follow` would, and move nothing. As `client.Robot.check_follow`."""
        return await run(self._session, check_follow(self._session, points, dt, from_here, wishes))

    async def fresh_state(self, max_age: float = 0.1, timeout: float = 1.0) -> RobotState:
        """Return a state in which the newest word of the robot is at most so old. As `client.Robot.fresh_state`."""
        max_age_ns, timeout_ns = seconds("max_age", max_age), seconds("timeout", timeout)
        sighting = await run(self._session, watching.fresh(self._session, max_age_ns, timeout_ns))
        return state_of(sighting, self._session.transport.now_ns())

    async def states(self, max_rate: float | None = None, timeout: float = 5.0) -> AsyncIterator[RobotState]:
        """Yield each new state, the newest when several came meanwhile. As `client.Robot.states`."""
        session = self._session
        pace = watching.Pace(session, max_rate, seconds("timeout", timeout))
        while True:
            sighting = await run(session, pace.next())
            if sighting is None:
                return
            yield state_of(sighting, session.transport.now_ns())

    def events(self, timeout: float | None = 1.0, *, backlog: bool = True) -> EventStream:
        """Return what the daemon has to tell, as an async iterator of notices. As `client.Robot.events`."""
        timeout_ns = None if timeout is None else seconds("timeout", timeout)
        return EventStream(self._session, timeout_ns, backlog)

    def health(self) -> Health:
        """Return whether everything is well, and what is not. Never waits and never raises for lack of a daemon."""
        return health_of(self._session)

    async def stop(self, reason: str = "") -> StopResult:
        """Stop everything; anybody may. As `client.Robot.stop`."""
        return await self._stopped(protocol.Stop(reason=protocol.printable(str(reason))), "stop")

    async def estop(self, reason: str = "") -> StopResult:
        """Stop everything and pause the FSM; latches, the grip is lost. Does not replace the physical emergency stop."""
        return await self._stopped(protocol.Estop(reason=protocol.printable(str(reason))), "estop")

    async def _stopped(self, command: protocol.Stop | protocol.Estop, ask: Literal["stop", "estop"]) -> StopResult:
        if self._session.daemon and not self._session.is_connected:
            # Daemon or guard reads it there, whichever lives. A dead daemon would be waited for: its guard answers.
            dropped(self._session, command)
            result = await self._ask_guard(command, ask)
            if result is not None:
                return result
        try:
            return await run(self._session, procedures.stop(self._session, command))
        except (Disconnected, OutcomeUnknown):
            result = await self._ask_guard(command, ask)
            if result is None:
                raise
            return result

    async def _ask_guard(
        self, command: protocol.Stop | protocol.Estop, ask: Literal["stop", "estop"]
    ) -> StopResult | None:
        from gateway.client.asking.guard_stop import stop_at_guard  # a dead daemon is rare, and imports take time

        session = self._session
        return await asyncio.to_thread(stop_at_guard, session.transport.address, ask, command.reason, session.name)

    async def recover(self, reason: str = "") -> None:
        """Clear all latches, or none when a cause persists. As `client.Robot.recover`."""
        await run(self._session, procedures.request(self._session, protocol.Recover(reason=reason)))

    @property
    def recording(self) -> Recording:
        """The recording of this robot that `ta2 record` makes on this host. As `client.Robot.recording`."""
        from gateway.client.aio_recording import Recording  # few programs record, and imports take time

        return Recording(self._session.transport.address)

    def stop_endpoint(self, timeout: float = 0.5, on_silence: protocol.OnLossName = "hold") -> StopEndpoint:
        """Return a stop endpoint, to be used in `async with`. As `client.Robot.stop_endpoint`."""
        return StopEndpoint(self._session, timeout, on_silence)

    def control(
        self,
        on_loss: protocol.OnLossName = "hold",
        on_exit: OnExitName = "release",
        take: str | None = None,
        timeout_s: float = 10.0,
    ) -> Control:
        """Return the right to command, to be used in `async with`. As `client.Robot.control`."""
        require_options(on_loss, on_exit)
        return Control(self._session, on_loss, on_exit, take, seconds("timeout_s", timeout_s))
