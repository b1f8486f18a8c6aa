"""Coroutines of the asyncio twin, played while a world's virtual time goes on."""

from __future__ import annotations

import asyncio

__all__ = ["play"]


def play(world, scene, step_s=0.01):
    """Run a coroutine function and return its result; the world goes on by a step whenever it waits. At most 30 real s."""

    async def pump():
        while True:
            world.run(step_s)
            await asyncio.sleep(0)

    async def both():
        pumping = asyncio.create_task(pump())
        try:
            return await asyncio.wait_for(scene(), timeout=30)
        finally:
            pumping.cancel()

    return asyncio.run(both())
