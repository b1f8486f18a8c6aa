"""One lease for the whole robot: who may command, and what happens in which second when he vanishes.

The rules:

* An epoch is given once, ever: it rises with every new owner and starts above the one that was remembered. A command
  carries the epoch of its owner; one of an earlier epoch never passes again.
* The criterion of life is the client library's keepalive. Silence beyond 250 ms, or the end of its liveliness token,
  is the loss. From that instant two clocks run: after 10 s the lease is free, after 60 s everything goes down.
  The owner who comes back within the first, or a new owner, ends both.
* A silence may be longer by one pause of this process (`silence.py`).
* What a pause explains is not yet a sign of life: an owner that has not been heard for 350 ms is *doubted*. It keeps its
  lease, and may move nothing until it is heard. So motion ends within half a second of the last sign of life, whatever
  the ticks do: the loop ends it by itself at a tick that is so late that more than 150 ms lie before it.

It decides nothing about motion: the engine tells the supervisor what `poll` returns.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from gateway.core.supervision.silence import Silence
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.messages.snapshot import LeaseView
from gateway.settings.settings import LossSettings

__all__ = ["Lease", "LeaseEvent", "LossStage", "Owner"]

S = 1_000_000_000
AGAIN = "try again when the keepalive is back"


class Owner(Struct, frozen=True, kw_only=True):
    """Who holds the lease.

    Attributes:
        client_id: Unique per client process and connection.
        name: As the client calls itself.
        pid: Its process id.
        since_ns: When the lease was given [ns].
        on_loss: What it wants to happen when it vanishes.
    """

    client_id: str
    name: str
    pid: int
    since_ns: int
    on_loss: OnLoss


class LossStage(str, Enum):
    """The owner is LOST, or BACK; the lease is FREE; what is still held goes down (DOWN_DUE)."""

    LOST = "lost"
    BACK = "back"
    FREE = "free"
    DOWN_DUE = "down_due"


class LeaseEvent(Struct, frozen=True, kw_only=True):
    """A stage, told once.

    Attributes:
        stage: Which one.
        at_ns: When it was due [ns]: for LOST the instant of the loss, for BACK the sign of life.
        owner: Whom it is about; None when nobody owned the robot.
    """

    stage: LossStage
    at_ns: int
    owner: Owner | None


class Lease:
    """The one lease.

    Args:
        settings: Stages of a loss.
        epoch: No epoch up to this one is ever given.
    """

    def __init__(self, settings: LossSettings, epoch: int) -> None:
        self._settings = settings
        self._epoch = epoch
        self._owner: Owner | None = None
        self._now_ns = 0  # latest tick or grant, for messages
        self._silence = Silence()  # of the owner
        self._abandoned = False
        self._lost_ns: int | None = None  # since when the clocks run against the owner
        self._told_lost = False
        self._back_ns: int | None = None  # an untold BACK
        self._held_since_ns: int | None = None  # start of the 60 s, with or without an owner

    @property
    def epoch(self) -> int:
        """The last epoch given, by this daemon or an earlier one; 0 when none ever was."""
        return self._epoch

    @property
    def owner(self) -> Owner | None:
        """Who owns the robot, lost or not; None when nobody does."""
        return self._owner

    @property
    def lost(self) -> bool:
        """Whether there is an owner and it has vanished."""
        return self._lost_ns is not None

    @property
    def silence_ns(self) -> int:
        """How long the owner had not been heard at the latest tick [ns]; 0 without one."""
        return 0 if self._owner is None else self._now_ns - self._silence.heard_ns

    @property
    def is_doubted(self) -> bool:
        """Whether the owner is silent for so long that it may not move anything, though a pause of ours explains it."""
        return self._owner is not None and not self.lost and self._silence.is_doubted(self._settings.keepalive_ns)

    @property
    def valid_epoch(self) -> int:
        """The epoch under which motion may leave: 0 while nobody owns the robot, or the owner is lost or doubted."""
        return 0 if self._owner is None or self.lost or self.is_doubted else self._epoch

    # ------------------------------------------------------------------------------------------------ who commands

    def acquire(self, client_id: str, name: str, pid: int, on_loss: OnLoss, now_ns: int) -> int | Refusal:
        """Give the lease when it is free: return the epoch, or LEASE_HELD with owner, pid, since and when it may be free.

        The owner who asks again keeps its epoch, its clocks end, and the latest `on_loss` counts.
        """
        self._now_ns = now_ns
        if self._owner is not None and not self._is_owner(client_id):
            free_ns = _left_ns(self._lost_ns, self._settings.free_after_ns, now_ns)
            when = "" if free_ns is None else f"; it is silent, and free in {free_ns / S:.1f} s"
            return Refusal(code=Code.LEASE_HELD, message=f"{self._who()}{when}")
        return self._give(client_id, name, pid, on_loss, now_ns)

    def take(self, client_id: str, name: str, pid: int, reason: str, on_loss: OnLoss, now_ns: int) -> int | Refusal:
        """Give the lease whoever holds it: return its epoch, a new one unless the caller has it; BAD_REQUEST without reason."""
        if not reason.strip():
            return Refusal(
                code=Code.BAD_REQUEST,
                message="taking the robot from its owner needs a reason: it is shown to him",
                field="reason",
                hint="take(reason='...')",
            )
        return self._give(client_id, name, pid, on_loss, now_ns)

    def release(self, client_id: str, epoch: int, now_ns: int) -> Refusal | None:
        """Give the lease back; all clocks end. A lost owner may, too."""
        refusal = self._not_owner(client_id, epoch)
        if refusal is None:
            self.clear(now_ns)
        return refusal

    def abandon(self, client_id: str, epoch: int, now_ns: int) -> Refusal | None:
        """Lose the owner at once, by its own wish. No keepalive brings it back, only asking for the lease again."""
        refusal = self._not_owner(client_id, epoch)
        if refusal is None:
            self._abandoned = True
            self._lose(now_ns)
        return refusal

    def check(self, client_id: str, epoch: int) -> Refusal | None:
        """Return None when this client may command under this epoch, else why not.

        Returns:
            LEASE_STALE for an epoch that is over, NOT_OWNER for anybody else, LEASE_LOST for the owner himself while he
            counts as lost or is doubted: what was under way from him when he vanished must not move anything.
        """
        refusal = self._not_owner(client_id, epoch)
        if refusal is None and self._lost_ns is not None:
            ago_s = (self._now_ns - self._lost_ns) / S
            how = "you left the lease" if self._abandoned else "your keepalive was lost"
            refusal = Refusal(
                code=Code.LEASE_LOST,
                message=f"{how} {ago_s:.1f} s ago; the robot is held",
                hint="acquire the lease again" if self._abandoned else AGAIN,
            )
        elif refusal is None and self.is_doubted:
            how = f"the gateway stood still, and has not heard your keepalive for {self.silence_ns / S:.1f} s"
            refusal = Refusal(code=Code.LEASE_LOST, message=how, hint=AGAIN)
        return refusal

    # ---------------------------------------------------------------------------------------------- signs of life

    def seen(self, client_id: str, now_ns: int) -> None:
        """Take a keepalive that arrived at `now_ns`: a lost owner is back, unless it abandoned the lease."""
        if self._is_owner(client_id) and now_ns > self._silence.heard_ns and not self._abandoned:
            self._silence.heard_ns = now_ns
            self._revive(now_ns)

    def gone(self, client_id: str, now_ns: int) -> None:
        """Take the end of a client's liveliness token: the owner is lost at once; only a later keepalive counts."""
        if self._is_owner(client_id):
            self._silence.heard_ns = max(self._silence.heard_ns, now_ns)
            self._lose(now_ns)

    def poll(self, now_ns: int, late_ns: int = 0) -> list[LeaseEvent]:
        """Let time pass, after the events of the tick were received.

        Args:
            now_ns: Monotonic time of the tick [ns].
            late_ns: How late the tick is [ns]. More than 20 ms is a pause, of which only the longest since the owner's last
                sign of life is not counted as silence.

        Returns:
            What is due, each once, in order.
        """
        self._now_ns = now_ns
        self._silence.look(now_ns, late_ns)
        patience_ns = self._silence.patience_ns(self._settings.keepalive_ns)
        if self.silence_ns > patience_ns:
            self._lose(self._silence.heard_ns + patience_ns)
        return list(self._due(now_ns))

    # ------------------------------------------------------------------------------------------------------ clocks

    def clear(self, now_ns: int) -> None:
        """Make the lease free at once and end all clocks (this host slept). The epoch stays spent."""
        self._now_ns = now_ns
        self._owner = self._lost_ns = self._back_ns = self._held_since_ns = None
        self._told_lost = self._abandoned = False

    def hold_unowned(self, now_ns: int) -> None:
        """Start the 60 s for a robot that is held without an owner who is there, e.g. after a restart of the daemon."""
        if self._owner is None or self.lost:
            self._held_since_ns = now_ns

    def end_clocks(self) -> None:
        """End the 60 s: nothing is held any more. A lost owner's 10 s go on, or it would own the robot for ever."""
        self._held_since_ns = None

    def view(self, now_ns: int) -> LeaseView:
        """Return what the outside may see."""
        owner = self._owner
        return LeaseView(
            owned=owner is not None,
            name=owner.name if owner else "",
            client_id=owner.client_id if owner else "",
            pid=owner.pid if owner else 0,
            epoch=self._epoch,
            since_ns=owner.since_ns if owner else 0,
            on_loss=owner.on_loss.value if owner else "",
            lost_ns=None if self._lost_ns is None else now_ns - self._lost_ns,
            free_in_ns=_left_ns(self._lost_ns, self._settings.free_after_ns, now_ns),
            down_in_ns=_left_ns(self._held_since_ns, self._settings.down_after_ns, now_ns),
        )

    def _give(self, client_id: str, name: str, pid: int, on_loss: OnLoss, now_ns: int) -> int:
        if self._owner is not None and self._is_owner(client_id):
            self._owner = replace(self._owner, name=name, pid=pid, on_loss=on_loss)
            self._abandoned = False
            self._revive(now_ns)
        else:
            self.clear(now_ns)
            self._epoch += 1
            self._owner = Owner(client_id=client_id, name=name, pid=pid, since_ns=now_ns, on_loss=on_loss)
        self._silence.heard_ns = now_ns
        return self._epoch

    def _is_owner(self, client_id: str) -> bool:
        return self._owner is not None and self._owner.client_id == client_id

    def _lose(self, at_ns: int) -> None:
        if self._lost_ns is None:
            self._lost_ns = self._held_since_ns = at_ns

    def _revive(self, at_ns: int) -> None:
        self._lost_ns = self._held_since_ns = None
        if self._told_lost:
            self._told_lost, self._back_ns = False, at_ns

    def _due(self, now_ns: int) -> Iterator[LeaseEvent]:
        owner = self._owner
        if self._back_ns is not None:
            yield LeaseEvent(stage=LossStage.BACK, at_ns=self._back_ns, owner=owner)
            self._back_ns = None
        if self._lost_ns is not None:
            free_ns = self._lost_ns + self._settings.free_after_ns
            if not self._told_lost:
                yield LeaseEvent(stage=LossStage.LOST, at_ns=self._lost_ns, owner=owner)
                self._told_lost = True
            if now_ns >= free_ns:
                held_since_ns = self._held_since_ns
                self.clear(now_ns)
                self._held_since_ns = held_since_ns
                yield LeaseEvent(stage=LossStage.FREE, at_ns=free_ns, owner=owner)
        if self._held_since_ns is not None and now_ns >= self._held_since_ns + self._settings.down_after_ns:
            down_ns = self._held_since_ns + self._settings.down_after_ns
            self._held_since_ns = None
            yield LeaseEvent(stage=LossStage.DOWN_DUE, at_ns=down_ns, owner=owner)

    def _not_owner(self, client_id: str, epoch: int) -> Refusal | None:
        if self._is_owner(client_id) and epoch == self._epoch:
            return None
        if 0 < epoch < self._epoch or (self._owner is None and epoch == self._epoch > 0):
            return Refusal(
                code=Code.LEASE_STALE,
                message=f"epoch {epoch} is over; {self._who()}",
                field="epoch",
                value=str(epoch),
                bound=str(self._epoch),
            )
        return Refusal(code=Code.NOT_OWNER, message=f"you do not own the robot; {self._who()}", field="epoch")

    def _who(self) -> str:
        owner = self._owner
        if owner is None:
            return "nobody owns the robot"
        since_s = (self._now_ns - owner.since_ns) / S
        return f"{owner.name!r} (pid {owner.pid}) has owned the robot for {since_s:.1f} s under epoch {self._epoch}"


def _left_ns(since_ns: int | None, after_ns: int, now_ns: int) -> int | None:
    return None if since_ns is None else max(0, since_ns + after_ns - now_ns)
