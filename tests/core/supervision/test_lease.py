"""The lease in virtual time: one owner, epochs that only rise, and the stages of a loss."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from gateway.core.supervision.lease import Lease, LeaseEvent, LossStage
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLoss
from gateway.settings.settings import LossSettings

MS = 1_000_000
S = 1_000_000_000
T0 = 50 * S
LOST, BACK, FREE, DOWN = LossStage.LOST, LossStage.BACK, LossStage.FREE, LossStage.DOWN_DUE


def acquire(lease: Lease, client: str, now_ns: int = T0, on_loss: OnLoss = OnLoss.HOLD) -> int | Refusal:
    """Ask as a client whose name and pid are not those of the others."""
    return lease.acquire(client, f"{client}'s program", 4000 + len(client), on_loss, now_ns)


def take(lease: Lease, client: str, now_ns: int, reason: str = "he is in the way") -> int | Refusal:
    """Take over as such a client."""
    return lease.take(client, f"{client}'s program", 4000 + len(client), reason, OnLoss.HOLD, now_ns)


def stages(events: list[LeaseEvent]) -> list[tuple[LossStage, int]]:
    """What was told, and for which instant after T0 [ms]."""
    return [(event.stage, (event.at_ns - T0) // MS) for event in events]


@pytest.fixture
def lease() -> Lease:
    """A lease of a daemon whose forerunner gave the epochs up to 7."""
    return Lease(LossSettings(), epoch=7)


@pytest.fixture
def owned(lease) -> Lease:
    """Alice owns it under epoch 8 since T0."""
    assert acquire(lease, "alice") == 8
    return lease


# -------------------------------------------------------------------------------------------------- who commands


def test_nobody_owns_the_robot_at_first_and_no_remembered_epoch_passes(lease):
    """A restarted daemon refuses what was given before it, and knows no owner."""
    assert (lease.epoch, lease.owner, lease.lost, lease.valid_epoch) == (7, None, False, 0)
    assert lease.poll(T0) == []
    stale = lease.check("alice", 7)
    assert stale.code is Code.LEASE_STALE and "nobody owns the robot" in stale.message
    assert lease.check("alice", 3).code is lease.check("alice", 1).code is Code.LEASE_STALE
    assert lease.check("alice", 0).code is lease.check("alice", 8).code is Code.NOT_OWNER


def test_a_fresh_installation_starts_at_epoch_one():
    """Nothing was ever given: epoch 0 is no epoch."""
    lease = Lease(LossSettings(), epoch=0)
    assert lease.check("alice", 0).code is Code.NOT_OWNER
    assert acquire(lease, "alice") == lease.epoch == lease.valid_epoch == 1
    assert lease.release("alice", 1, T0) is None
    assert lease.check("alice", 1).code is Code.LEASE_STALE


def test_the_free_lease_is_given_under_an_epoch_above_all_earlier_ones(owned):
    """And the owner, and only he, passes under it."""
    assert owned.check("alice", 8) is None and owned.valid_epoch == 8
    assert owned.owner.name == "alice's program" and owned.owner.pid == 4005 and owned.owner.since_ns == T0
    assert owned.check("bob", 8).code is Code.NOT_OWNER
    assert owned.check("alice", 7).code is Code.LEASE_STALE
    assert owned.check("alice", 9).code is Code.NOT_OWNER


def test_asking_again_gives_the_owner_the_same_epoch(owned):
    """Idempotent, so that a lost reply can be asked for again; the latest wish for a loss counts."""
    assert acquire(owned, "alice", T0 + S, OnLoss.PAUSE) == 8
    assert owned.owner.on_loss is OnLoss.PAUSE and owned.owner.since_ns == T0


def test_a_held_lease_names_its_owner(owned):
    """Name, pid and since: what a second user needs to go and ask."""
    refusal = acquire(owned, "bob", T0 + 1500 * MS)
    assert refusal.code is Code.LEASE_HELD
    assert refusal.message == '"alice\'s program" (pid 4005) has owned the robot for 1.5 s under epoch 8'


def test_a_lost_owners_lease_is_held_until_it_is_free_and_says_when(owned):
    """While the clocks run others get LEASE_HELD, `take` works (BEHAVIOUR, stopping and losing)."""
    owned.gone("alice", T0 + 1 * S)
    owned.poll(T0 + 1 * S)
    assert "free in 7.5 s" in acquire(owned, "bob", T0 + 3500 * MS).message
    assert take(owned, "bob", T0 + 4 * S) == 9


def test_taking_gives_a_new_epoch_at_once_and_the_old_one_is_over(owned):
    """A late packet of the former owner is LEASE_STALE, with who owns the robot now."""
    assert take(owned, "bob", T0 + S) == 9
    stale = owned.check("alice", 8)
    assert stale.code is Code.LEASE_STALE and stale.bound == "9"
    assert stale.message == 'epoch 8 is over; "bob\'s program" (pid 4003) has owned the robot for 0.0 s under epoch 9'
    assert owned.check("bob", 9) is None
    assert owned.release("alice", 8, T0 + S).code is Code.LEASE_STALE
    assert owned.abandon("alice", 8, T0 + S).code is Code.LEASE_STALE
    owned.gone("alice", T0 + S)
    owned.seen("alice", T0 + S)
    assert not owned.lost


@pytest.mark.parametrize("on_loss", list(OnLoss))
def test_what_shall_happen_on_loss_is_asked_for_by_whoever_takes_the_robot(owned, on_loss):
    """His own wish counts, not that of the one he took it from."""
    owned.take("bob", "bob's program", 4003, "he is in the way", on_loss, T0 + S)
    assert owned.owner.on_loss is on_loss and owned.view(T0 + S).on_loss == on_loss.value


def test_taking_needs_a_reason_and_over_oneself_changes_nothing(owned):
    """The reason is shown to the one who loses the robot."""
    refusal = take(owned, "bob", T0, reason="  ")
    assert refusal.code is Code.BAD_REQUEST and refusal.field == "reason"
    assert take(owned, "alice", T0) == 8
    assert take(Lease(LossSettings(), epoch=2), "bob", T0) == 3


def test_releasing_frees_the_lease_and_spends_the_epoch(owned):
    """No clock runs after it, and the next owner has another epoch."""
    assert owned.release("alice", 8, T0 + S) is None
    assert owned.owner is None and owned.epoch == 8 and owned.valid_epoch == 0
    assert owned.check("alice", 8).code is Code.LEASE_STALE
    assert owned.poll(T0 + 100 * S) == []
    assert acquire(owned, "alice", T0 + 100 * S) == 9


# ------------------------------------------------------------------------------------------------ stages of a loss


def test_silence_of_250_ms_is_the_loss_and_its_stages_are_told_once(owned):
    """Lost, free after 10 s, down after 60 s, counted from the loss: the last keepalive and 250 ms."""
    owned.seen("alice", T0 + 100 * MS)
    assert owned.poll(T0 + 350 * MS) == []
    assert stages(owned.poll(T0 + 351 * MS)) == [(LOST, 350)]
    assert owned.lost and owned.owner.client_id == "alice" and owned.valid_epoch == 0
    assert owned.poll(T0 + 10_349 * MS) == []
    free = owned.poll(T0 + 10_350 * MS)
    assert stages(free) == [(FREE, 10_350)] and free[0].owner.client_id == "alice"
    assert owned.owner is None and not owned.lost and owned.check("alice", 8).code is Code.LEASE_STALE
    assert owned.poll(T0 + 60_349 * MS) == []
    down = owned.poll(T0 + 60_350 * MS)
    assert stages(down) == [(DOWN, 60_350)] and down[0].owner is None
    assert owned.poll(T0 + 200 * S) == []


def test_the_end_of_the_token_is_the_loss_at_once(owned):
    """A killed client is known before its keepalive is missed; keepalives of before do not revive it."""
    owned.gone("alice", T0 + 40 * MS)
    owned.seen("alice", T0 + 40 * MS)
    assert stages(owned.poll(T0 + 41 * MS)) == [(LOST, 40)]
    assert owned.poll(T0 + 400 * MS) == []


def test_stages_that_are_due_together_are_told_in_order(owned):
    """A daemon that looks late tells the whole story."""
    assert stages(owned.poll(T0 + 70 * S)) == [(LOST, 250), (FREE, 10_250), (DOWN, 60_250)]


def test_an_owner_that_is_seen_within_ten_seconds_is_back_under_its_epoch(owned):
    """A frozen client's return ends both clocks; what it sent while lost is refused until then."""
    owned.poll(T0 + 251 * MS)
    lost = owned.check("alice", 8)
    assert lost.code is Code.LEASE_LOST and "keepalive" in lost.message
    owned.seen("alice", T0 + 9 * S)
    assert owned.check("alice", 8) is None and owned.valid_epoch == 8
    assert stages(owned.poll(T0 + 9 * S)) == [(BACK, 9000)]
    assert owned.poll(T0 + 9 * S) == []
    assert stages(owned.poll(T0 + 80 * S)) == [(LOST, 9250), (FREE, 19_250), (DOWN, 69_250)]


def test_only_the_owners_own_keepalive_counts(owned):
    """Others neither keep a lost owner's lease alive, nor hear that they have lost one."""
    owned.seen("bob", T0 + 200 * MS)
    assert stages(owned.poll(T0 + 251 * MS)) == [(LOST, 250)]
    owned.seen("bob", T0 + 300 * MS)
    owned.gone("bob", T0 + 300 * MS)
    assert owned.poll(T0 + 300 * MS) == [] and owned.lost
    assert owned.check("bob", 8).code is Code.NOT_OWNER
    assert owned.check("alice", 7).code is Code.LEASE_STALE


def test_after_ten_seconds_the_frozen_client_finds_the_lease_free_for_all(owned):
    """It has to ask again, and gets another epoch."""
    owned.poll(T0 + 11 * S)
    owned.seen("alice", T0 + 12 * S)
    assert owned.poll(T0 + 12 * S) == [] and owned.owner is None
    assert acquire(owned, "alice", T0 + 13 * S) == 9
    assert owned.poll(T0 + 13_250 * MS) == []


def test_a_loss_that_was_never_told_is_not_taken_back_either(owned):
    """Gone and back within one tick: nobody needs to know."""
    owned.gone("alice", T0 + 1 * MS)
    owned.seen("alice", T0 + 2 * MS)
    assert owned.poll(T0 + 3 * MS) == [] and not owned.lost


@pytest.mark.parametrize("newcomer", ["alice", "bob"])
def test_a_new_owner_or_the_old_one_asking_again_ends_both_clocks(owned, newcomer):
    """After the lease got free nobody of before has a claim, and the 60 s are over."""
    owned.poll(T0 + 20 * S)
    assert acquire(owned, newcomer, T0 + 20 * S) == 9
    owned.seen(newcomer, T0 + 70 * S)
    assert owned.poll(T0 + 70 * S) == []


def test_a_client_that_abandons_the_lease_is_lost_at_once_and_only_asking_revives_it(owned):
    """An exception in the user's block: the robot is held, though the process and its keepalive live."""
    assert owned.abandon("alice", 8, T0 + 1 * S) is None
    owned.seen("alice", T0 + 1100 * MS)
    assert stages(owned.poll(T0 + 1100 * MS)) == [(LOST, 1000)]
    left = owned.check("alice", 8)
    assert left.code is Code.LEASE_LOST and "you left the lease 0.1 s ago" in left.message
    assert acquire(owned, "alice", T0 + 2 * S) == 8
    assert stages(owned.poll(T0 + 2 * S)) == [(BACK, 2000)]
    owned.seen("alice", T0 + 2200 * MS)
    assert owned.check("alice", 8) is None and owned.poll(T0 + 2400 * MS) == []


def test_a_lost_owner_may_release(owned):
    """He has nothing to lose by it, and others need not wait."""
    owned.abandon("alice", 8, T0)
    assert owned.release("alice", 8, T0 + S) is None
    assert owned.poll(T0 + 100 * S) == []


def test_a_suspend_frees_the_lease_and_ends_all_clocks(owned):
    """Row `suspend and resume`: nobody owns the robot, nothing is due, the epoch is spent."""
    owned.poll(T0 + 5 * S)
    owned.clear(T0 + 6 * S)
    assert owned.owner is None and not owned.lost and owned.poll(T0 + 100 * S) == []
    assert acquire(owned, "alice", T0 + 100 * S) == 9


def test_an_unowned_hold_has_its_own_sixty_seconds(lease):
    """A restarted daemon takes a hold over without an owner; acquiring ends the clock."""
    lease.hold_unowned(T0)
    assert lease.view(T0 + S).down_in_ns == 59 * S
    assert stages(lease.poll(T0 + 60 * S)) == [(DOWN, 60_000)]
    lease.hold_unowned(T0 + 61 * S)
    acquire(lease, "alice", T0 + 62 * S)
    lease.hold_unowned(T0 + 62 * S)
    assert lease.view(T0 + 62 * S).down_in_ns is None


def test_a_hold_that_a_lost_owner_comes_to_has_its_sixty_seconds(owned):
    """Nothing was held when it vanished, so its clock had ended; its ten seconds go on."""
    owned.poll(T0 + S)
    owned.end_clocks()
    owned.hold_unowned(T0 + 2 * S)
    assert stages(owned.poll(T0 + 70 * S)) == [(FREE, 10_250), (DOWN, 62_000)]


def test_ending_the_clocks_leaves_a_lost_owner_its_ten_seconds(owned):
    """Nothing is held any more, so nothing goes down; but a dead client must not own the robot for ever."""
    owned.poll(T0 + S)
    owned.end_clocks()
    assert stages(owned.poll(T0 + 100 * S)) == [(FREE, 10_250)]


# ------------------------------------------------------------------------------------------------ our own pauses


def test_a_late_tick_does_not_lose_a_client_whose_keepalives_wait_to_be_read(owned):
    """This process stood still for 2 s: the owner gets as much more, and is lost if it is really silent."""
    owned.seen("alice", T0 + 100 * MS)
    assert owned.poll(T0 + 2100 * MS, late_ns=2 * S) == []
    assert owned.poll(T0 + 2350 * MS) == []
    assert stages(owned.poll(T0 + 2351 * MS)) == [(LOST, 2350)]


def test_a_keepalive_of_before_our_pause_does_not_take_the_grace_away(owned):
    """It was stamped before the pause and read after it."""
    owned.poll(T0 + 2 * S, late_ns=2 * S)
    owned.seen("alice", T0 + 50 * MS)
    assert owned.poll(T0 + 2200 * MS) == []


def test_ordinary_jitter_grants_nothing(owned):
    """20 ms late is what the gap promises allow anyway (DESIGN §8)."""
    for n in range(1, 26):
        assert owned.poll(T0 + n * 10 * MS, late_ns=20 * MS) == []
    assert stages(owned.poll(T0 + 251 * MS)) == [(LOST, 250)]


def test_a_dead_client_is_found_though_every_tick_is_late(owned):
    """Late by 30 ms every 40 ms: one pause explains 30 ms of the silence, however many there are."""
    told = []
    for n in range(1, 40):
        told += owned.poll(T0 + n * 40 * MS, late_ns=30 * MS)
    assert stages(told) == [(LOST, 280)]
    assert Lease(LossSettings(), epoch=0).poll(T0, late_ns=S) == []


def test_the_longest_pause_explains_what_the_others_do_not(owned):
    """And one of before the last sign of life explains nothing."""
    owned.poll(T0 + 40 * MS, late_ns=40 * MS)
    owned.poll(T0 + 140 * MS, late_ns=90 * MS)
    owned.poll(T0 + 180 * MS, late_ns=30 * MS)
    assert owned.poll(T0 + 340 * MS) == [] and stages(owned.poll(T0 + 341 * MS)) == [(LOST, 340)]
    owned.seen("alice", T0 + 400 * MS)
    assert stages(owned.poll(T0 + 651 * MS)) == [(BACK, 400), (LOST, 650)]


def test_an_owner_that_only_a_pause_explains_may_move_nothing_until_it_is_heard(owned):
    """It is not lost, but a command of before the pause must not begin to move now."""
    assert owned.poll(T0 + 2 * S, late_ns=2 * S) == []
    doubted = owned.check("alice", 8)
    assert doubted.code is Code.LEASE_LOST and "stood still" in doubted.message and "2.0 s" in doubted.message
    assert owned.is_doubted and owned.valid_epoch == 0 and not owned.lost
    assert acquire(owned, "bob", T0 + 2 * S).code is Code.LEASE_HELD
    owned.seen("alice", T0 + 2 * S + 10 * MS)
    assert owned.poll(T0 + 2 * S + 10 * MS) == [] and owned.check("alice", 8) is None and owned.valid_epoch == 8


PAUSES = st.lists(st.sampled_from([0, 1, 5, 20, 21, 30, 49, 50, 100, 140, 141, 200, 700, 2_000, 5_000]), max_size=60)
"""How late tick after tick comes [ms]."""


@given(late_ms=PAUSES)
def test_in_any_schedule_of_ticks_nobody_moves_anything_350_ms_after_its_last_sign_of_life(late_ms):
    """And he is lost as soon as the silence is longer than the longest pause and 250 ms."""
    lease, now_ns = Lease(LossSettings(), epoch=7), T0
    acquire(lease, "alice")
    for late in [*late_ms, *[0] * 30]:
        now_ns += (10 + late) * MS
        lease.poll(now_ns, late * MS)
        assert lease.valid_epoch == 0 or now_ns - T0 <= 350 * MS
        assert (lease.check("alice", 8) is None) is (lease.valid_epoch == 8)
        assert lease.owner is None or lease.lost or now_ns - T0 <= (250 + max(late_ms, default=0)) * MS
    assert lease.owner is None or lease.lost


@given(late_ms=PAUSES, read_late=st.booleans())
def test_in_any_schedule_of_ticks_a_living_owner_is_not_lost(late_ms, read_late):
    """Its keepalives come every 50 ms; those that came in a pause are read before the tick, or just after it."""
    lease, now_ns, next_ns = Lease(LossSettings(), epoch=7), T0, T0
    acquire(lease, "alice")
    for late in late_ms:
        unread_ns = now_ns + 10 * MS if read_late else now_ns + (10 + late) * MS
        now_ns += (10 + late) * MS
        while next_ns <= unread_ns:
            lease.seen("alice", next_ns)
            next_ns += 50 * MS
        assert lease.poll(now_ns, late * MS) == []
        assert read_late or lease.valid_epoch == 8


# ------------------------------------------------------------------------------------------------------- the view


def test_the_view_shows_owner_and_clocks(owned):
    """Alive: no clock. Lost: how long, and what comes when. Unowned: empty."""
    alive = owned.view(T0 + S)
    assert (alive.owned, alive.name, alive.client_id, alive.pid) == (True, "alice's program", "alice", 4005)
    assert (alive.epoch, alive.since_ns, alive.on_loss) == (8, T0, "hold")
    assert alive.lost_ns is alive.free_in_ns is alive.down_in_ns is None
    owned.gone("alice", T0 + 1 * S)
    lost = owned.view(T0 + 3 * S)
    assert (lost.lost_ns, lost.free_in_ns, lost.down_in_ns) == (2 * S, 8 * S, 58 * S)
    owned.poll(T0 + 12 * S)
    free = owned.view(T0 + 62 * S)
    assert (free.owned, free.name, free.client_id, free.pid, free.since_ns, free.on_loss) == (False, "", "", 0, 0, "")
    assert (free.epoch, free.lost_ns, free.free_in_ns, free.down_in_ns) == (8, None, None, 0)


# -------------------------------------------------------------------------------------------------- for all orders


def test_two_clients_race_a_thousand_times():
    """Exactly one wins each race, with an epoch of its own; whatever the loser sends late never passes."""
    rng = random.Random(3)
    lease, now_ns, given = Lease(LossSettings(), epoch=0), T0, []
    for _ in range(1000):
        clients = rng.sample(["alice", "bob"], 2)
        answers = [acquire(lease, client, now_ns) for client in clients]
        assert isinstance(answers[0], int) and isinstance(answers[1], Refusal)
        assert answers[1].code is Code.LEASE_HELD
        given.append((clients[0], answers[0]))
        if rng.random() < 0.5:
            given.append((clients[1], take(lease, clients[1], now_ns)))
        valid = [pair for pair in given[-40:] if lease.check(*pair) is None]
        assert valid == [given[-1]]
        now_ns += rng.randrange(1, 300) * MS
        assert lease.release(*given[-1], now_ns) is None
        lease.poll(now_ns)
    epochs = [epoch for _, epoch in given]
    assert epochs == sorted(set(epochs)) and lease.epoch == epochs[-1]


class LeaseMachine(RuleBasedStateMachine):
    """Any order of requests, keepalives, losses, pauses and time."""

    clients = st.sampled_from(["alice", "bob", "carol"])

    def __init__(self) -> None:
        super().__init__()
        self.lease = Lease(LossSettings(), epoch=4)
        self.now_ns = T0
        self.given: list[tuple[str, int]] = []
        self.over: set[tuple[str, int]] = set()
        self.told: list[LeaseEvent] = []
        self.silent_ns = dict.fromkeys(["alice", "bob", "carol"], 0)  # time awake since the last sign of life

    def _given(self, client: str, answer: int | Refusal) -> None:
        self.silent_ns[client] = 0
        if isinstance(answer, Refusal):
            assert answer.code is Code.LEASE_HELD and self.lease.owner.client_id != client
        elif (client, answer) not in self.given:
            assert answer > max([4, *(epoch for _, epoch in self.given)])
            self.given.append((client, answer))

    @rule(client=clients, on_loss=st.sampled_from(OnLoss))
    def acquire(self, client: str, on_loss: OnLoss) -> None:
        self._given(client, acquire(self.lease, client, self.now_ns, on_loss))

    @rule(client=clients)
    def take(self, client: str) -> None:
        answer = take(self.lease, client, self.now_ns)
        assert isinstance(answer, int)
        self._given(client, answer)

    @precondition(lambda self: self.given)
    @rule(data=st.data())
    def release(self, data: st.DataObject) -> None:
        pair = data.draw(st.sampled_from(self.given))
        if self.lease.release(*pair, self.now_ns) is None:
            assert pair not in self.over
            self.over.add(pair)

    @precondition(lambda self: self.given)
    @rule(data=st.data())
    def abandon(self, data: st.DataObject) -> None:
        pair = data.draw(st.sampled_from(self.given))
        if self.lease.abandon(*pair, self.now_ns) is None:
            assert self.lease.check(*pair).code is Code.LEASE_LOST

    @rule(client=clients)
    def seen(self, client: str) -> None:
        self.lease.seen(client, self.now_ns)
        self.silent_ns[client] = 0

    @rule(client=clients)
    def gone(self, client: str) -> None:
        self.lease.gone(client, self.now_ns)
        assert all(self.lease.check(client, epoch) for owner, epoch in self.given if owner == client)

    @rule(ms=st.sampled_from([1, 10, 100, 251, 9_700, 10_000, 50_000]), late=st.booleans())
    def tick(self, ms: int, late: bool) -> None:
        self.now_ns += ms * MS
        late_ns = (ms - 1) * MS if late else 0
        events = self.lease.poll(self.now_ns, late_ns)
        self.told += events
        for client in self.silent_ns:
            self.silent_ns[client] += ms * MS - (late_ns if late_ns > 20 * MS else 0)
        if self.lease.valid_epoch:
            assert self.silent_ns[self.lease.owner.client_id] <= 250 * MS
        assert [event.at_ns for event in events] == sorted(event.at_ns for event in events)

    @rule()
    def suspend(self) -> None:
        self.lease.clear(self.now_ns)
        self.told.clear()

    @invariant()
    def at_most_one_owner_and_only_the_latest_epoch_passes(self) -> None:
        valid = [pair for pair in self.given if self.lease.check(*pair) is None]
        assert len(valid) <= 1 and valid == [pair for pair in self.given[-1:] if self.lease.valid_epoch == pair[1]]
        self.over.update(self.given[:-1])
        if self.given and self.lease.owner is None:
            self.over.add(self.given[-1])
        assert not self.over.intersection(valid)

    @invariant()
    def nothing_passes_that_was_never_given(self) -> None:
        epochs = {epoch for _, epoch in self.given}
        for epoch in {0, 1, 4, self.lease.epoch, self.lease.epoch + 1} - epochs:
            assert all(self.lease.check(client, epoch) is not None for client in self.silent_ns)

    @invariant()
    def losses_and_returns_alternate(self) -> None:
        for before, after in zip(self.told, self.told[1:], strict=False):
            if before.stage is BACK:
                assert after.stage is LOST
            if after.stage is FREE:
                assert before.stage is LOST


TestAnyOrderOfEvents = LeaseMachine.TestCase
TestAnyOrderOfEvents.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
