"""One of each: requests of the protocol with all their fields, for round trips and as seeds of fuzzing."""

from __future__ import annotations

from gateway.api import protocol

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
    protocol.OpenStream(epoch=3, side="right"),
    protocol.OpenStream(epoch=3, side="left", speed=0.5, on_limit="clip", expiry_ns=300_000_000),
    protocol.CloseStream(epoch=3, stream_id=5),
    protocol.Hold(epoch=3, sides=("left", "right")),
    protocol.Cancel(epoch=3, motion_id=9),
    protocol.Stop(),
    protocol.Stop(reason="hand in the way"),
    protocol.Estop(reason="smoke"),
    protocol.Recover(),
)


def command(request, request_id=1, client_id="c0ffee", version=protocol.PROTOCOL_VERSION):
    """Return a request in its envelope."""
    return protocol.Command(version=version, client_id=client_id, request_id=request_id, request=request)
