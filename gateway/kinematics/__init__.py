"""The body as pure maths: description, forward and inverse kinematics, frames, gripper, distances, dynamics.

In: joints [rad], poses [m, xyzw], the body's numbers (`teleavatar2.toml`, a URDF, a calibration).
Out: poses, joints, frames, gaps, torques, or why there are none. No I/O but files of numbers.
Read first: `description.py`, the body as data; then `arm.py`.
"""
