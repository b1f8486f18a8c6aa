"""A page that commands: a client of the gateway of its own, which is lost when the page is.

Rules
    * Each page that asks for the robot is another client: two pages race for it like any two programs.
    * A page that is closed, cut off, or silent for 5 s leaves the robot held, as a killed program does; one that releases it
      leaves it paused.
    * What takes long (enabling, releasing) keeps nothing else from being asked: each request runs by itself.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping

import msgspec

from gateway.client import aio
from gateway.client.state.home import home_goals
from gateway.errors import Code, GatewayError, failure
from gateway.web.messages import Acquire, Asked, Disable, Drive, Enable, Episode, Grip, Hold, Home, Jog, Lift, Release

__all__ = ["Owning"]

_log = logging.getLogger(__name__)

SPEED = 0.3
"""Factor on the velocity limit of what a page moves."""
HELD_S = 0.4
"""How long a velocity counts that a page has asked for [s]."""


class Owning:
    """What one page does with the robot.

    Args:
        target: Where the gateway is; None finds its socket.
        name: As the others see this client.
    """

    def __init__(self, target: str | None, name: str) -> None:
        self._target = target
        self._name = name
        self._robot: aio.Robot | None = None
        self._own: aio.Control | None = None
        self._task: asyncio.Task[None] | None = None
        self._is_over = asyncio.Event()
        self._changing = asyncio.Lock()
        """One at a time takes the robot or gives it back: what one of them ends is not what the next one began."""

    @property
    def is_owner(self) -> bool:
        """Whether this page owns the robot."""
        return self._own is not None and self._own.is_open

    async def carry_out(self, asked: Asked) -> Mapping[str, object]:
        """Do what a page asks for; return the facts of the reply.

        Raises:
            GatewayError: It was refused; nothing moved.
        """
        if isinstance(asked, Acquire):
            await self._acquire(asked.take)
        own, robot = self._owned()
        if isinstance(asked, Acquire):
            return {"owner": True, "epoch": own.epoch}
        if isinstance(asked, Release):
            await self._release()
        elif isinstance(asked, Enable):
            await own.enable()
        elif isinstance(asked, Disable):
            await own.disable()
        elif isinstance(asked, Hold):
            await own.hold()
        elif isinstance(asked, Home):
            motion = await own.move_to(home_goals(await robot.state()), speed=SPEED)
            return {"motion_id": motion.motion_id}
        elif isinstance(asked, Jog):
            offsets = [asked.step_rad if number == asked.joint else 0.0 for number in range(1, 8)]
            motion = await own.move_by({asked.side: offsets}, speed=SPEED)
            return {"motion_id": motion.motion_id}
        elif isinstance(asked, Grip):
            gripper = own.left_gripper if asked.side == "left" else own.right_gripper
            await (gripper.grip(asked.force) if asked.force >= 0.0 else gripper.open(-asked.force))
        elif isinstance(asked, Drive):
            await own.chassis.set_velocity(asked.vx_mps, asked.vy_mps, asked.wz_radps, expiry=HELD_S)
        elif isinstance(asked, Lift):
            await own.lift.set_velocity(asked.velocity_ratio, expiry=HELD_S)
        elif isinstance(asked, Episode):
            tell = getattr(robot.recording, asked.event)  # the words are its methods
            told: dict[str, object] = msgspec.to_builtins(await tell(asked.text))
            return told
        return {}

    async def lose(self) -> None:
        """The page is gone: leave the robot held, at once. Whoever waits here may be cancelled; the loss goes on."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait({task})
            error = None if task.cancelled() else task.exception()
            if error is not None and not isinstance(error, GatewayError):  # of others somebody has heard
                _log.error("a page lost the robot by an error", exc_info=error)

    def _owned(self) -> tuple[aio.Control, aio.Robot]:
        if self._own is None or self._robot is None:
            raise failure(Code.NOT_OWNER, "this page does not own the robot", hint="ask for it first: Take control")
        return self._own, self._robot

    async def _acquire(self, take: str) -> None:
        async with self._changing:
            if await self._is_ours():
                return
            await self.lose()
            owned: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._is_over = asyncio.Event()
            self._task = asyncio.create_task(self._keep(take, owned))
            await owned

    async def _is_ours(self) -> bool:
        """Return whether the gateway says so, too: somebody may have taken it since this page was told anything."""
        robot = self._robot
        try:
            return self.is_owner and robot is not None and (await robot.state()).lease.client_id == robot.client_id
        except GatewayError:
            return False

    async def _keep(self, take: str, owned: asyncio.Future[None]) -> None:
        """Own the robot until it is released; cancelled, leave it held."""
        try:
            async with aio.connect(self._target, name=self._name) as robot, robot.control(take=take or None) as own:
                self._robot, self._own = robot, own
                owned.set_result(None)
                await self._is_over.wait()
        except GatewayError as error:
            if owned.done():
                raise
            owned.set_exception(error)
        finally:
            self._robot = self._own = None
            if not owned.done():
                owned.cancel()

    async def _release(self) -> None:
        async with self._changing:
            self._is_over.set()
            if self._task is not None:
                await self._task
