"""Policies: a policy's server is asked what to do next, and its action chunks go to the gateway while the last one plays.

In: the robot's state and cameras, a map of what the policy is shown and says (`policy_map`), answers of a server
(`openpi`, `lerobot`) or a function in Python (`local_server`).
Out: chunks, gripper commands and velocities through the ordinary client; figures of how well the server keeps up. Limits, joins
and stops are the gateway's: this process may hang or die, and the arms brake at the end of their chunk.
Read first: `runner`.
"""
