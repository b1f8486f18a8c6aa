"""One of each: requests of the protocol with all their fields, for round trips and as seeds of fuzzing."""

from __future__ import annotations

from gateway.api import protocol

POSE = (0.3, -0.1, -0.2, 0.0, 0.0, 0.0, 1.0)
HOME = (-0.5, -0.92, 0.52, -1.28, 0.32, 0.55, -0.52)
Q = (0.1, 0.5, -0.3, 0.9, 0.2, -0.1, 0.3)

REQUESTS = (
    protocol.Acquire(name="policy-a", pid=4711),
    protocol.Acquire(name="policy-a", pid=4711, on_loss="pause"),
    protocol.Take(name="人", pid=1, reason="needs a look"),
    protocol.Release(epoch=3),
    protocol.Abandon(epoch=3),
    protocol.Enable(epoch=3),
    protocol.Disable(epoch=3),
    protocol.Move(epoch=3, targets_rad={"left": Q}),
    protocol.Move(
        epoch=3, targets_rad={"right": Q, "left": Q}, relative=True, speed=0.3, tolerance_rad=0.01, on_limit="clip"
    ),
    protocol.Follow(epoch=3, points={"left": (Q, Q)}, dt_s=0.1),
    protocol.Follow(
        epoch=3,
        points={"right": (HOME, HOME, HOME), "left": (Q, Q, Q)},
        times_s=(0.0, 0.1, 0.3),
        stretch=1.5,
        open_end=True,
        start_at_ns=5,
        start_in_ns=-300_000_000,
        path_tolerance={"left": (0.1, None, 0.1, 0.1, 0.1, 0.1, 0.1)},
        goal_tolerance={"right": (0.05,) * 7},
        goal_time_ns=2_000_000_000,
    ),
    protocol.Follow(
        epoch=3,
        points={"right": (POSE, POSE)},
        space="pose",
        frames={"right": "right_shoulder_base"},
        dt_s=0.1,
        path_tolerance={"right": (0.02, None)},
    ),
    protocol.CheckFollow(follow=protocol.Follow(epoch=0, points={"left": (Q, Q)}, dt_s=0.1)),
    protocol.CheckFollow(
        follow=protocol.Follow(
            epoch=3,
            points={"right": (POSE, POSE)},
            space="pose",
            frames={"right": "right_shoulder_base"},
            times_s=(0.0, 0.5),
            start_in_ns=-1,
        ),
        from_here=False,
    ),
    protocol.OpenStream(epoch=3, side="right"),
    protocol.OpenStream(
        epoch=3,
        side="right",
        until=protocol.Until(force_n=8.0, direction=(0.0, 0.0, 1.0), back_off_m=0.02, seen=4),
    ),
    protocol.OpenStream(epoch=3, side="left", speed=0.5, on_limit="clip", expiry_ns=300_000_000),
    protocol.OpenStream(
        epoch=3,
        side="left",
        space="pose",
        frame="left_shoulder_base",
        admittance=protocol.Admittance(mass=(8.0, None), damping=(200.0, 0.0), stiffness=(0.0, 0.0)),
    ),
    protocol.CloseStream(epoch=3, stream_id=5),
    protocol.Hold(epoch=3, sides=("left", "right")),
    protocol.Cancel(epoch=3, motion_id=9),
    protocol.SetGripper(epoch=3, side="left", raw=0.55),
    protocol.SetPayload(epoch=3, side="left", mass_kg=0.3, com_m=(0.15, 0.0, -0.02)),
    protocol.Weigh(
        epoch=3,
        side="right",
        q_rad=((0.1,) * 7,),
        up_nm=((-1.0,) * 7,),
        down_nm=((1.0,) * 7,),
        noise_nm=((0.01,) * 7,),
        beside_empty=True,
    ),
    protocol.DriveChassis(epoch=3, vx_mps=0.1, vy_mps=-0.05, wz_radps=0.2),
    protocol.DriveChassis(epoch=3, vx_mps=0.0, vy_mps=0.0, wz_radps=0.0, expiry_ns=500_000_000, drive_id=4),
    protocol.StopChassis(epoch=3),
    protocol.DriveLift(epoch=3, velocity=-0.3),
    protocol.DriveLift(epoch=3, velocity=0.3, expiry_ns=500_000_000, drive_id=4),
    protocol.StopLift(epoch=3),
    protocol.DisableLift(epoch=3),
    protocol.Stop(),
    protocol.Stop(reason="hand in the way"),
    protocol.Estop(reason="smoke"),
    protocol.Recover(),
)


def command(request, request_id=1, client_id="c0ffee", version=protocol.PROTOCOL_VERSION):
    """Return a request in its envelope."""
    return protocol.Command(version=version, client_id=client_id, secret="s", request_id=request_id, request=request)
