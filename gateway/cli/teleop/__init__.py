"""`ta2 teleop`: a person's keys or gamepad in, streams of small targets out; an ordinary client with a deadman."""
