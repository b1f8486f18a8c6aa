"""What was latched under another address of a robot comes along, and goes when it is cleared."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.core.engine import Engine
from gateway.core.messages.events import CommandRequested, LinkUp
from gateway.core.messages.outputs import ROUTERS_KEPT, Remembered, found_at, router_name
from gateway.errors import Code
from gateway.messages.requests import Enable
from gateway.process.recall import Recall
from gateway.process.state_file import EPOCH_BLOCK, StateFile, StateWriter, path_of, read_state
from gateway.settings.settings import LinkSettings, Settings
from tests.pair import S

HERE, THERE = "tcp/192.168.1.20:9000", "tcp/robot.lab:9000"
ROUTER = router_name("abc1", "")
ESTOP = {Code.ESTOP: "by Ann"}


def keep(path: Path, remembered: Remembered) -> None:
    """Write a state file as a daemon does."""
    with StateFile(path) as file:
        file.save(remembered)


def heard() -> tuple[dict[Code, str], Callable[[Code, str], None]]:
    """Return what is latched, and what latches."""
    latches: dict[Code, str] = {}
    return latches, latches.__setitem__


def test_every_spelling_of_an_address_has_one_file(tmp_path: Path) -> None:
    """So a latch is found again, whoever types it."""
    spellings = ("tcp/127.0.0.1:9000", "TCP/localhost:9000", "tcp/[::1]:9000", "tcp/127.0.0.1:9000#iface=lo")
    assert len({path_of(tmp_path, endpoint, "/lab/") for endpoint in spellings}) == 1


def test_latches_of_another_address_come_with_the_router(tmp_path: Path) -> None:
    """Those of other robots do not: neither of other routers, nor of other namespaces behind this one. Once."""
    keep(path_of(tmp_path, THERE), Remembered(latches=ESTOP, routers=("old1/", ROUTER)))
    keep(path_of(tmp_path, "tcp/a:1"), Remembered(latches={Code.FSM_ERROR: "x"}, routers=("abc2/",)))
    keep(path_of(tmp_path, HERE, "lab"), Remembered(latches={Code.GATE_VIOLATION: "x"}, routers=("abc1/lab",)))
    own = path_of(tmp_path, HERE)
    recall = Recall(own)
    latches, latch = heard()
    recall.known_here(Remembered())
    assert latches == {}
    recall.meet(router_name("abc1", "/"), latch)
    assert list(latches) == [Code.ESTOP] and "robot.lab" in latches[Code.ESTOP]
    latches.clear()
    recall.meet(ROUTER, latch)
    assert latches == {}


def test_epochs_go_on_above_those_of_every_file(tmp_path: Path) -> None:
    """None is given twice, whatever the address; it is on disk before the first is given."""
    keep(path_of(tmp_path, THERE), Remembered(epoch=7000))
    own = path_of(tmp_path, HERE)
    with StateFile(own) as file:
        assert file.start(least_epoch=Recall(own).epoch).remembered.epoch == 7000
        assert read_state(own).epoch == 7000 + EPOCH_BLOCK
    with StateFile(own) as file:  # nor ever lower
        assert file.start(least_epoch=7000).remembered.epoch == 7000 + EPOCH_BLOCK


def test_what_is_cleared_here_is_cleared_there_and_not_before(tmp_path: Path) -> None:
    """A latch is in one file at least until somebody recovers; others of that file stay."""
    own, other = path_of(tmp_path, HERE), path_of(tmp_path, THERE)
    keep(other, Remembered(epoch=9, latches=ESTOP, routers=(ROUTER,), zids=("z",)))
    recall = Recall(own)
    with StateFile(own) as file:
        writer = StateWriter(file, file.start(), on_saved=recall.saved)
        latches, latch = heard()
        recall.meet(ROUTER, latch)
        recall.saved(Remembered(epoch=1))  # a state of before, that waited for the disk
        assert read_state(other).latches == ESTOP
        recall.saved(Remembered(epoch=1, latches=latches))
        assert read_state(other).latches == ESTOP
        keep(other, Remembered(epoch=9, latches=ESTOP | {Code.FSM_ERROR: "later"}, routers=(ROUTER,), zids=("z",)))
        writer.write(Remembered(epoch=1, routers=(ROUTER,)))
        assert writer.close(5.0)
    assert read_state(other) == Remembered(epoch=9, latches={Code.FSM_ERROR: "later"}, routers=(ROUTER,), zids=("z",))


def test_what_is_cleared_before_our_disk_ever_had_it_is_cleared_there(tmp_path: Path) -> None:
    """A slow disk: the state with the latch is forgotten in line, and the next one is what the file says already."""
    own, other = path_of(tmp_path, HERE), path_of(tmp_path, THERE)
    keep(other, Remembered(latches=ESTOP, routers=(ROUTER,)))
    recall = Recall(own)
    with StateFile(own) as file:
        started = file.start()
        writer = StateWriter(file, started, on_saved=recall.saved)
        latches, latch = heard()
        recall.meet(ROUTER, latch)
        with writer._change:  # the disk is busy with an earlier state
            writer.write(Remembered(latches=latches))
            writer.write(started.remembered)
        assert writer.close(5.0)
    assert read_state(other).latches == {}


def test_what_both_files_have_is_cleared_in_both(tmp_path: Path) -> None:
    """As after a restart between the latch and the person who clears it."""
    own, other = path_of(tmp_path, HERE), path_of(tmp_path, THERE)
    for path in (own, other):
        keep(path, Remembered(latches=ESTOP, routers=(ROUTER,)))
    recall = Recall(own)
    recall.known_here(Remembered(latches=ESTOP))
    recall.meet(ROUTER, lambda *_: None)
    recall.saved(Remembered())
    assert read_state(other).latches == {}


def test_a_file_that_a_daemon_has_keeps_its_latches_until_it_is_free(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """It is theirs; asked again with the next state."""
    own, other = path_of(tmp_path, HERE), path_of(tmp_path, THERE)
    keep(other, Remembered(latches=ESTOP, routers=(ROUTER,)))
    recall = Recall(own)
    recall.meet(ROUTER, lambda *_: None)
    recall.saved(Remembered(latches=ESTOP))
    with StateFile(other):
        recall.saved(Remembered())
    assert read_state(other).latches == ESTOP and "still has what was cleared" in caplog.text
    recall.saved(Remembered())
    assert read_state(other).latches == {}


def test_an_unreadable_file_of_another_robot_is_told_and_refuses_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its own daemon latches it."""
    (tmp_path / "x.json").write_text("{")
    own = path_of(tmp_path, HERE)
    assert Recall(own).epoch == 0 and "x.json" in caplog.text


def test_a_file_names_the_routers_at_which_its_robot_was_found(tmp_path: Path) -> None:
    """The latest ones, across restarts; of a file that names nonsense nothing is known."""
    engine = Engine(Settings(link=LinkSettings(namespace="/lab")), Remembered(routers=("old1/lab",)))
    assert engine.tick(1 * S).remembered is None
    engine.receive(LinkUp(router_zid="abc1", at_ns=1 * S), 1 * S)
    remembered = engine.tick(1 * S).remembered
    assert remembered is not None and remembered.routers == ("old1/lab", "abc1/lab")
    path = path_of(tmp_path, HERE)
    keep(path, remembered)
    assert read_state(path) == remembered
    document = json.loads(path.read_text()) | {"routers": [1]}
    path.write_text(json.dumps(document))
    with pytest.raises(ValueError, match="routers"):
        read_state(path)
    many = tuple(f"{n}/" for n in range(ROUTERS_KEPT))
    assert found_at(many, "0", "") == (*many[1:], "0/") and len(found_at(many, "new", "")) == ROUTERS_KEPT


def test_a_latch_that_comes_with_the_router_is_there_before_anything_can_be_enabled() -> None:
    """Latched before the engine hears of the link; an e-stop is sent again as after a restart."""
    engine = Engine(Settings())
    engine.takeover.latch(Code.ESTOP, "by Ann", 1 * S)
    engine.receive(LinkUp(router_zid="abc1", at_ns=1 * S), 1 * S)
    engine.receive(CommandRequested(client_id="ann", request_id=1, request=Enable(epoch=1), received_ns=1 * S), 1 * S)
    output = engine.tick(1 * S)
    assert Code.ESTOP in engine.latches and output.replies[0].refusal is not None
    assert engine._coordinator.is_estop_unheard
