"""A simulated robot written from the manual: an independent witness of what the gateway does.

`robot.model.SimRobot` is the pure robot (messages in, messages out, in virtual time); `node.SimNode` puts it behind a
zenoh router as a ros2dds bridge would. Nothing here imports the gateway's own facts, maths or wire code: where the
two agree, they agree because both follow the manual.
"""
