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
      leaves the robot held. A wait that is cancelled alone, by a timeout of yours, leaves everything as it is.
    * The keepalive has its own thread: a busy event loop does not lose the robot, and a wedged one keeps it; give
      streams an expiry.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Generator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

from gateway.api import protocol
from gateway.client import procedures, watching
from gateway.client.blocking import SLICE_S
from gateway.client.door import OnExitName, program_name, require_options, transport_to
from gateway.client.motion import MotionRecord
from gateway.client.over_zenoh import Credentials
from gateway.client.ownership import Ownership
from gateway.client.procedures import MotionResult, Procedure, StopResult
from gateway.client.reading import Health, RobotState, health_of, state_of
from gateway.client.requests import seconds
from gateway.client.session import Session
from gateway.client.stream import TargetStream
from gateway.client.transport import Transport
from gateway.client.waits import Wait
from gateway.errors import GatewayError, GatewayTimeout

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["ArmControl", "Connecting", "Control", "JointStream", "MotionHandle", "Robot", "connect"]

T = TypeVar("T")


async def run(session: Session, procedure: Procedure[T]) -> T:
    """Run a procedure to its end, waiting in this event loop."""
    try:
        wait = next(procedure)
        while True:
            try:
                answer = await _wait(session, wait)
            except GatewayError as error:
                wait = procedure.throw(error)
            else:
                wait = procedure.send(answer)
    except StopIteration as end:
        value: T = end.value
        return value
    except asyncio.CancelledError:
        procedure.close()
        raise


async def _wait(session: Session, wait: Wait[Any]) -> object:
    loop = asyncio.get_running_loop()
    changed = asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):  # the event loop was closed meanwhile
            loop.call_soon_threadsafe(changed.set)

    with session.listening(wake):
        while True:
            changed.clear()
            now_ns = session.transport.now_ns()
            with session.changed:
                answer = wait.poll(now_ns)
            if answer is not None:
                return answer
            if now_ns >= wait.deadline_ns:
                raise wait.expire()
            # Not asyncio.wait_for: before Python 3.12 it can swallow a cancellation that comes together with the event.
            alarm = loop.call_later(min((wait.deadline_ns - now_ns) / 1e9, SLICE_S), changed.set)
            try:
                await changed.wait()
            finally:
                alarm.cancel()


def connect(
    target: str | None = None,
    *,
    name: str | None = None,
    timeout_s: float = 5.0,
    credentials: Credentials | None = None,
    transport: Transport | None = None,
) -> Connecting:
    """Connect to the daemon of a robot, in `async with`, or by awaiting it.

    Arguments and exceptions as in `client.connect`.
    """
    session = Session(transport or transport_to(target, credentials), (name or program_name())[:64])
    return Connecting(session, timeout_s)


class Connecting:
    """A connection that is being made; await it, or use it in `async with`."""

    def __init__(self, session: Session, timeout_s: float) -> None:
        self._session = session
        self._timeout_s = timeout_s

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
            await asyncio.to_thread(session.transport.open, session.client_id, session, self._timeout_s)
            await run(session, procedures.greet(session, timeout_ns))
        except BaseException:  # cancellation included: nobody will get the robot that could close it
            session.close()
            raise
        return Robot(session)


class Robot:
    """A connected robot, to look at, to stop, and to own. As `client.Robot`."""

    def __init__(self, session: Session) -> None:
        self._session = session

    async def close(self) -> None:
        """Disconnect. A robot that is still owned is left held. May be called again."""
        await asyncio.to_thread(self._session.close)

    def __repr__(self) -> str:
        """Show where it is connected to and as whom."""
        return f"<robot at {self._session.transport.address} for {self._session.name!r}>"

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
            sighting = await run(self._session, watching.next_sighting(self._session, 0, 0, procedures.REQUEST_NS))
        return state_of(sighting, self._session.transport.now_ns())

    async def states(self, max_rate: float | None = None, timeout: float = 5.0) -> AsyncIterator[RobotState]:
        """Yield each new state, the newest when several came meanwhile. As `client.Robot.states`."""
        session = self._session
        pace = watching.Pace(session, max_rate, seconds("timeout", timeout))
        while True:
            sighting = await run(session, pace.next())
            yield state_of(sighting, session.transport.now_ns())

    async def events(self, timeout: float = 1.0) -> AsyncIterator[protocol.Notice]:
        """Yield what the daemon had to tell, until it is silent for `timeout` seconds."""
        timeout_ns = seconds("timeout", timeout)
        while True:
            try:
                notice = await run(self._session, watching.next_notice(self._session, timeout_ns))
            except GatewayTimeout:
                return
            yield notice

    def health(self) -> Health:
        """Return whether everything is well, and what is not. Never waits and never raises for lack of a daemon."""
        return health_of(self._session)

    async def stop(self, reason: str = "") -> StopResult:
        """Stop everything; anybody may. As `client.Robot.stop`."""
        return await run(self._session, procedures.stop(self._session, protocol.Stop(reason=reason)))

    async def estop(self, reason: str = "") -> StopResult:
        """Stop everything and pause the FSM; latches, the grip is lost. Does not replace the physical emergency stop."""
        return await run(self._session, procedures.stop(self._session, protocol.Estop(reason=reason)))

    async def recover(self) -> None:
        """Clear all latches, or none when a cause persists. Never moves and never enables."""
        await run(self._session, procedures.request(self._session, protocol.Recover()))

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


class Control(Ownership):
    """The right to command the robot. As `client.Control`.

    Attributes:
        left_arm: The left arm.
        right_arm: The right arm.
    """

    def __init__(
        self, session: Session, on_loss: protocol.OnLossName, on_exit: OnExitName, take: str | None, timeout_ns: int
    ) -> None:
        super().__init__(session, on_loss, on_exit, take, timeout_ns)
        self.left_arm = ArmControl(self, "left")
        self.right_arm = ArmControl(self, "right")

    async def acquire(self) -> Control:
        """Become the owner; what `async with` does."""
        await run(self._session, self._acquire())
        return self

    async def release(self) -> None:
        """Brake, rest, pause the robot, and give the lease back."""
        await run(self._session, self._release())

    async def leave(self) -> None:
        """Leave the robot held, as if this client had vanished."""
        await run(self._session, self._leave())

    async def __aenter__(self) -> Control:
        return await self.acquire()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._break_off()
            return
        try:
            await run(self._session, self._end())
        except asyncio.CancelledError:
            self._break_off()
            raise

    async def enable(self, timeout: float = 12.0) -> None:
        """Bring the robot's FSM to READY and wait until it is there."""
        await run(self._session, self._enable(timeout))

    async def disable(self, timeout: float = 10.0) -> None:
        """Brake to rest and pause the robot's FSM; the lease stays."""
        await run(self._session, self._disable(timeout))

    async def hold(self) -> None:
        """Brake both arms and hold them."""
        await run(self._session, self._hold())

    async def move_to(
        self,
        targets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms to joint positions [rad]; returns when it was accepted."""
        return MotionHandle(*await run(self._session, self._move(targets, False, speed, tolerance, on_limit)))

    async def move_by(
        self,
        offsets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms by offsets from where they are being held [rad]."""
        return MotionHandle(*await run(self._session, self._move(offsets, True, speed, tolerance, on_limit)))


class ArmControl:
    """One arm of a `Control`. As `client.ArmControl`."""

    def __init__(self, control: Control, side: protocol.SideName) -> None:
        self._control = control
        self.side = side

    async def move_to(
        self,
        q: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm to seven joint positions [rad]."""
        return await self._control.move_to({self.side: q}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    async def move_by(
        self,
        dq: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm by seven joint offsets [rad]."""
        return await self._control.move_by({self.side: dq}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    async def hold(self) -> None:
        """Brake this arm and hold it."""
        await run(self._control._session, self._control._hold((self.side,)))

    def stream(
        self,
        rate_hz: float = 50.0,
        *,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> JointStream:
        """Return a stream of joint targets for this arm, to be used in `async with`. As `client.ArmControl.stream`."""
        owner = self._control
        return JointStream(
            owner._session, owner._owned(), self.side, rate_hz=rate_hz, speed=speed, on_limit=on_limit, expiry=expiry
        )


class MotionHandle(MotionRecord):
    """A motion that was accepted; awaiting it is `result()`."""

    def __await__(self) -> Generator[Any, None, MotionResult]:
        return self.result().__await__()

    async def result(self, timeout: float = 60.0) -> MotionResult:
        """Wait until the motion has ended well. As `client.MotionHandle.result`."""
        return await run(self._session, self._result(timeout))

    async def cancel(self, timeout: float = 5.0) -> None:
        """Brake and end the motion; waits until the arms' references stand still."""
        await run(self._session, self._cancel(timeout))


class JointStream(TargetStream):
    """A stream of joint targets; `set` does not wait, `tick` does. As `client.JointStream`."""

    async def tick(self) -> None:
        """Wait for the next instant of the grid; raises when the stream has ended or a target was refused."""
        await run(self._session, self._tick())

    async def __aenter__(self) -> JointStream:
        await run(self._session, self._open())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            await run(self._session, self._close())
        except GatewayError:
            if kind is None:  # else the error that ended the block is the one to tell
                raise
