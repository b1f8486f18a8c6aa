"""The blocking client: connect, look, own, move, stream, stop.

```python
from gateway.client import connect

with connect(name="policy-a") as robot:
    print(robot.state.left_arm.q, robot.health().lease_holder)      # reading needs no lease
    with robot.control(on_loss="hold") as own:                      # one owner at a time
        own.enable(timeout=10.0)                                    # FSM to READY
        own.left_arm.move_to(q_goal, speed=0.3).result(timeout=20.0)
        with own.left_arm.stream(rate_hz=50) as out:                # starts where the arm is held
            for target in policy():
                sent = out.set(target)                              # what really goes out
                out.tick()                                          # paces; raises if the stream ended
```

Rules
    * SI units: rad, rad/s, m, N·m, seconds. Joints in the order of manual §4.0.3, never by name.
    * Setters never wait; results are handles. Every wait has a timeout. Every refusal is an exception with `.code`,
      `.hint`, `.field`, `.value`, `.bound` (classes in `gateway.errors`).
    * A `with control()` that ends normally brakes, rests and pauses the robot. One that is left by an exception or
      Ctrl-C leaves it held, as if this process had died; so does Ctrl-C in any wait here.
    * Works in scripts, threads and notebooks; one `Robot` may be used by several threads. Not after a fork.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Literal

from gateway.api import protocol
from gateway.client.asking import procedures, watching
from gateway.client.asking.chunks import FollowCheck, Wishes, check_follow
from gateway.client.asking.options import OnExitName, program_name, require_options, transport_to
from gateway.client.asking.requests import seconds
from gateway.client.asking.results import StopResult
from gateway.client.asking.waits import dropped
from gateway.client.blocking import opened, run
from gateway.client.connection.over_zenoh import Credentials
from gateway.client.connection.session import Session
from gateway.client.connection.transport import Transport
from gateway.client.control import Control
from gateway.client.state.health import Health, health_of
from gateway.client.state.reading import RobotState, state_of
from gateway.client.state.reasons import Why, why_of
from gateway.client.state.showing import robot_table
from gateway.client.stop_endpoint import StopEndpoint
from gateway.errors import Disconnected, OutcomeUnknown

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from gateway.client.recording import Recording

__all__ = ["EventStream", "Robot", "connect"]


def connect(
    target: str | None = None,
    *,
    name: str | None = None,
    timeout_s: float = 5.0,
    credentials: Credentials | None = None,
    transport: Transport | None = None,
    greet: bool = True,
) -> Robot:
    """Connect to the daemon of a robot.

    Args:
        target: `unix:/path`, a bare path, `tcp/HOST:PORT` or `tls/HOST:PORT`, or a robot's name in the fleet
            that `TA2_FLEET` names; None finds the socket by itself (`TA2_SOCKET`, this user's runtime directory,
            `/tmp/ta2-<uid>`, `/run/ta2`).
        name: How others see this client; by default the name of the program.
        timeout_s: How long to wait for the daemon [s].
        credentials: User, password and certificates, where the daemon asks for them.
        transport: Another way to a daemon, for tests; `target` is ignored then.
        greet: Whether to wait for the daemon's facts and a first state; False for a stop, which must not wait for them.

    Returns:
        A robot to look at; use it in a `with` block, or `close()` it.

    Raises:
        Disconnected: No daemon answers there (retryable).
        ProtocolError: The daemon is of another release.
        Rejected: `target` is no address, `timeout_s` no time.
    """
    timeout_ns = seconds("timeout_s", timeout_s)
    session = Session(transport or transport_to(target, credentials), name or program_name())
    try:
        opened(partial(session.open, timeout_s))
        if greet:
            run(session, procedures.greet(session, timeout_ns))
    except BaseException:  # Ctrl-C included: nobody will get the robot that could close it
        session.close()
        raise
    return Robot(session)


class EventStream(watching.Feed):
    """Notices in their order, for one reader; made by `Robot.events`.

    The iteration ends with silence (as `events` was told) and may be begun again: it goes on where it ended. What this
    reader missed stands between the notices as a NOTICES_LOST with their number, and is counted in `lost`. A connection
    that broke and came back stands there too (DISCONNECTED, CONNECTED): it outlives the daemon.
    """

    def __iter__(self) -> EventStream:
        return self

    def __next__(self) -> protocol.Notice:
        """Return the next notice.

        Raises:
            StopIteration: There was silence for too long, or this client was closed.
            Disconnected: There was silence for too long, and there is no daemon.
        """
        notice = run(self._session, self._next())
        if notice is None:
            raise StopIteration
        return notice


class Robot:
    """A connected robot, to look at, to stop, and to own. Context manager; made by `connect`."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def __enter__(self) -> Robot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect. A robot that is still owned is left held. May be called again."""
        self._session.close()

    def __repr__(self) -> str:
        """Show where it is connected to and as whom."""
        return f"<robot at {self._session.transport.address} for {self._session.name!r}>"

    def _repr_html_(self) -> str:
        """Show it with its state as a table, in a notebook."""
        return robot_table(self._session, state_of)

    # ------------------------------------------------------------------------------------------------ looking

    @property
    def client_id(self) -> str:
        """Identity of this client, as in `state.lease.client_id`."""
        return self._session.client_id

    @property
    def info(self) -> protocol.Info:
        """What does not change while the daemon runs: model, limits, rates, versions."""
        return run(self._session, procedures.get_info(self._session))

    @property
    def state(self) -> RobotState:
        """The newest state, as it is now known; never waits.

        Raises:
            Disconnected: The daemon is gone: there is nothing newer to come.
        """
        self._session.require_daemon()
        sighting = self._session.sighting()
        if sighting is None:  # a daemon that has just come
            sighting = run(self._session, watching.first(self._session))
        return state_of(sighting, self._session.transport.now_ns())

    def fresh_state(self, max_age: float = 0.1, timeout: float = 1.0) -> RobotState:
        """Return a state in which the newest word of the robot is at most so old; waits for one.

        Args:
            max_age: Of the newest state that the robot sent, whatever its topic [s].
            timeout: How long to wait [s].

        Raises:
            Stale: STATE_STALE, none came in time.
            Disconnected: No daemon is there.
        """
        max_age_ns, timeout_ns = seconds("max_age", max_age), seconds("timeout", timeout)
        sighting = run(self._session, watching.fresh(self._session, max_age_ns, timeout_ns))
        return state_of(sighting, self._session.transport.now_ns())

    def states(self, max_rate: float | None = None, timeout: float = 5.0) -> Iterator[RobotState]:
        """Yield each new state, the newest when several came meanwhile, until this client is closed.

        It outlives the daemon: when that is restarted within `timeout`, it goes on with the new one.

        Args:
            max_rate: At most so many a second [Hz]; None for as they come (50 Hz).
            timeout: Longest wait for the next one [s].

        Raises:
            GatewayTimeout: A daemon is there, and none came in time.
            Disconnected: No daemon came in time.
        """
        session = self._session
        pace = watching.Pace(session, max_rate, seconds("timeout", timeout))
        while True:
            sighting = run(session, pace.next())
            if sighting is None:
                return
            yield state_of(sighting, session.transport.now_ns())

    def events(self, timeout: float | None = 1.0, *, backlog: bool = True) -> EventStream:
        """Return what the daemon has to tell, as an iterator of notices.

        Each call gives a reader with a place of its own; see `EventStream`.

        Args:
            timeout: The iteration ends after so long a silence [s]; None goes on until this client is closed.
            backlog: Whether it begins with what was told since `connect()` (the newest thousand), or from now on.
        """
        timeout_ns = None if timeout is None else seconds("timeout", timeout)
        return EventStream(self._session, timeout_ns, backlog)

    def health(self) -> Health:
        """Return whether everything is well, and what is not. Never waits and never raises for lack of a daemon."""
        return health_of(self._session)

    def why(self) -> Why:
        """Return what is known to keep the robot from doing what it is told; never waits. Print it, or read its fields.

        Raises:
            Disconnected: The daemon is gone.
        """
        return why_of(self.state)

    def check_follow(
        self,
        points: Mapping[str, ArrayLike],
        dt: float | None = None,
        *,
        from_here: bool = True,
        **wishes: Unpack[Wishes],
    ) -> FollowCheck:
        """Have points judged as `Control.follow` would, and move nothing. Needs no lease; `robot.state` stays as it is.

        Whether the robot may move now is not judged: `why()` says that.

        Args:
            points: Per side (`left`, `right`) shape (N, 7); see `Control.follow`.
            dt: Time from point to point [s]; or `times`, which is one of the wishes.
            from_here: Whether they must also begin near the arms as they are now; False when these go there first.
            wishes: The other keywords of `Control.follow`.

        Returns:
            How long it takes, and how far the arms are from its beginning.

        Raises:
            Rejected: As by `Control.follow`, with the first point and joint to blame, value, bound and remedy.
            Stale: PART_STALE, nobody knows where an arm is.
        """
        return run(self._session, check_follow(self._session, points, dt, from_here, wishes))

    def routes(self) -> protocol.Routes:
        """Return how the robot's bridge stands to each topic, as the daemon's discovery knows it.

        Raises:
            Disconnected: No daemon answers.
        """
        return run(self._session, procedures.get_routes(self._session))

    # ------------------------------------------------------------------------------------------------ stopping

    def stop(self, reason: str = "") -> StopResult:
        """Stop everything: arms brake and hold, chassis and lift stop. Anybody may; the grip is kept.

        By the owner it latches nothing; by anybody else, motion stays refused until `recover()`.

        Args:
            reason: Shown to the owner and in the log.

        Raises:
            Disconnected: Neither a daemon answers nor a guard that acts for it. Use the physical emergency stop.
            OutcomeUnknown: No reply came. Use the physical emergency stop.
        """
        return self._stopped(protocol.Stop(reason=protocol.printable(str(reason))), "stop")

    def estop(self, reason: str = "") -> StopResult:
        """Stop everything and pause the robot's FSM. Anybody may; always latches; **the grip is lost**.

        Does not replace the physical emergency stop: it needs this host, the network and the robot's software
        (manual §1.4).

        Args:
            reason: Shown to the owner and in the log.

        Raises:
            Disconnected: Neither a daemon answers nor a guard that acts for it. Use the physical emergency stop.
            OutcomeUnknown: No reply came. Use the physical emergency stop.
        """
        return self._stopped(protocol.Estop(reason=protocol.printable(str(reason))), "estop")

    def _stopped(self, command: protocol.Stop | protocol.Estop, ask: Literal["stop", "estop"]) -> StopResult:
        if self._session.daemon and not self._session.is_connected:
            # Daemon or guard reads it there, whichever lives. A dead daemon would be waited for: its guard answers.
            dropped(self._session, command)
            result = self._ask_guard(command, ask)
            if result is not None:
                return result
        try:
            return run(self._session, procedures.stop(self._session, command))
        except (Disconnected, OutcomeUnknown):
            result = self._ask_guard(command, ask)
            if result is None:
                raise
            return result

    def _ask_guard(self, command: protocol.Stop | protocol.Estop, ask: Literal["stop", "estop"]) -> StopResult | None:
        from gateway.client.asking.guard_stop import stop_at_guard  # a dead daemon is rare, and imports take time

        session = self._session
        return stop_at_guard(session.transport.address, ask, command.reason, session.name)

    def recover(self, reason: str = "") -> None:
        """Clear all latches, or none when a cause persists. Never moves and never enables.

        Args:
            reason: Needed to let stop endpoints go that are silent; told to everybody.

        Raises:
            NotReady: LATCH_PERSISTS, or the robot cannot be seen; ENDPOINT_SILENT without a reason.
        """
        run(self._session, procedures.request(self._session, protocol.Recover(reason=reason)))

    @property
    def recording(self) -> Recording:
        """The recording of this robot that `ta2 record` makes on this host: its episodes begun, ended, marked and judged."""
        from gateway.client.recording import Recording  # few programs record, and imports take time

        return Recording(self._session.transport.address)

    def stop_endpoint(self, timeout: float = 0.5, on_silence: protocol.OnLossName = "hold") -> StopEndpoint:
        """Return a stop endpoint, to be used in a `with` block whose loop calls `check_in()`: a deadman. Anybody may.

        While it is registered and not heard, nothing moves, whoever owns the robot. A button that is released must end the
        check-ins, not the loop: a block that ends normally leaves in order, and what moves goes on.

        Args:
            timeout: Its period [s], 0.1 to 10: it is silent when it was not heard for longer.
            on_silence: `hold` brakes and holds with the grip kept; `pause` pauses the robot (the grip is lost).

        Raises:
            Rejected: An argument is none of what it may be.
        """
        return StopEndpoint(self._session, timeout, on_silence)

    # ------------------------------------------------------------------------------------------------ owning

    def control(
        self,
        on_loss: protocol.OnLossName = "hold",
        on_exit: OnExitName = "release",
        take: str | None = None,
        timeout_s: float = 10.0,
    ) -> Control:
        """Return the right to command, to be used in a `with` block (or by `acquire` and `release`, in a notebook).

        Args:
            on_loss: What happens when this client vanishes: `hold` keeps arms and grip for 60 s, `pause` pauses the
                robot at once (the grip is lost).
            on_exit: What a normal end of the block does: `release` brakes, rests and pauses; `hold` leaves it held.
            take: Reason to take the robot from its owner, for people; None asks for a free one.
            timeout_s: How long entering and leaving may take, each [s].

        Raises:
            Rejected: An option is none of the above.
        """
        require_options(on_loss, on_exit)
        return Control(self._session, on_loss, on_exit, take, seconds("timeout_s", timeout_s))
