"""A simulated robot written from the manual: an independent witness of what the gateway does.

In: messages of its users; faults and questions over its control channel. Out: what the robot says, as a bridge puts it out.
`robot/` has the rules, `physics/` a body with forces, `camera/` the pictures. Nothing here imports the gateway's own facts,
maths or wire code: where the two agree, they agree because both follow the manual.
Read first: `robot/model.py`, the pure robot; `node.py` puts it on a clock behind a zenoh router.
"""
