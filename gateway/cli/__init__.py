"""`ta2`: programs beside the daemon. They command the robot through the client library, like anybody else.

In come the words of a command line (`command_line/`); out go a terminal's text, files and an exit status. Commands that show
are in `looking/`, those that move in `motion/`, the body model's in `body/`, the video's in `cameras/`; how all of them speak
is in `terminal/`. Only `main.py` knows the daemon and the simulated robot, which it starts.
Read `main.py` first.
"""
