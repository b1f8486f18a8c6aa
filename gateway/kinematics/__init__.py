"""The body as pure maths: description, forward and inverse kinematics, frames, gripper. No I/O but its own data file."""
