"""Learning without hardware: a Gymnasium environment in which the gateway's own engine moves the robot with forces.

In: actions, as targets of joints and commands of grippers. Out: what the robot measures, rewards, and what the engine limited
or refused. All in virtual time: no socket, thread or clock. Libraries: Gymnasium, MuJoCo (extra `gym`). Importing this
registers it: `gymnasium.make("gateway.gym:TeleAvatar-PickPlace-v0")` does both. Read first: `pick_place`.
"""

from __future__ import annotations

try:
    import gymnasium
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    hint = "gateway.gym needs Gymnasium, which is not installed: pip install 'teleavatar-gateway[gym]'"
    raise ModuleNotFoundError(hint, name="gymnasium") from error

__all__ = ["ENV_ID"]

ENV_ID = "TeleAvatar-PickPlace-v0"
"""A block is to be picked from the table and put on the mark."""

gymnasium.register(ENV_ID, entry_point="gateway.gym.pick_place:PickPlace", max_episode_steps=400)
