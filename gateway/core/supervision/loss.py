"""What the stages of a lost owner do: the lease's clocks, turned into the supervisor's triggers and into words.

Every stage is told, loudly: lost, back, free, down (DESIGN §5). Whose clock is due is known to the lease; what follows
stands in the supervisor's table.
"""

from __future__ import annotations

from gateway.core.messages.outputs import Level
from gateway.core.supervision.coordinator import AT_BASE, Coordinator
from gateway.core.supervision.lease import LossStage, Owner
from gateway.core.supervision.supervisor import Trigger
from gateway.errors import Code
from gateway.messages.incoming import OnLoss

__all__ = ["STAGE_NAMES", "Loss"]

MS = 1_000_000

STAGE_NAMES = {
    LossStage.LOST: "lost",
    LossStage.BACK: "back",
    LossStage.FREE: "free",
    LossStage.DOWN_DUE: "down",
}
"""Stages as notices name them."""


class Loss:
    """Looks at the lease's clocks."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator

    def look(self, now_ns: int, late_ns: int) -> None:
        """Do what is due.

        Args:
            now_ns: Monotonic time [ns].
            late_ns: How late the tick is [ns]: a pause of this process is no silence of the owner.
        """
        coordinator = self._coordinator
        for event in coordinator.lease.poll(now_ns, late_ns):
            if event.stage is LossStage.LOST:
                self._lose(event.owner, now_ns)
            elif event.stage is LossStage.BACK:
                self._tell(event.stage, "the owner is back; the clocks ended", now_ns)
            elif event.stage is LossStage.FREE:
                self._tell(event.stage, "the lost owner's lease is free", now_ns)
                coordinator.fire(Trigger.LEASE_FREE, now_ns, "the lost owner's lease is free")
            elif coordinator.fire(Trigger.HOLD_OVER, now_ns, "nobody took over").do:
                self._tell(event.stage, "nobody took over: everything goes down, the grip is lost", now_ns)
        if coordinator.lease.is_doubted:  # as at the pause itself: what moves comes to rest, what is held stays held
            ago_ms = coordinator.lease.silence_ns / MS
            coordinator.fire(
                Trigger.LONG_GAP, now_ns, f"the owner was heard {ago_ms:.0f} ms ago, before a tick came late"
            )

    def _tell(self, stage: LossStage, message: str, now_ns: int) -> None:
        level = Level.INFO if stage is LossStage.BACK else Level.WARNING
        self._coordinator.notice(Code.LOSS_STAGE, level, message, now_ns, stage=STAGE_NAMES[stage])

    def _lose(self, owner: Owner | None, now_ns: int) -> None:
        coordinator = self._coordinator
        name = owner.name if owner is not None else "the owner"
        self._tell(LossStage.LOST, f"{name} is lost", now_ns)
        pauses = owner is not None and owner.on_loss is OnLoss.PAUSE
        coordinator.fire(Trigger.CLIENT_LOST_PAUSE if pauses else Trigger.CLIENT_LOST, now_ns, f"{name} is lost")
        if coordinator.state in AT_BASE:
            coordinator.lease.end_clocks()  # nothing is held, so nothing has to go down
