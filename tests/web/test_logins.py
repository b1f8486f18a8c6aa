"""Sessions, and how often somebody may guess."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any

import pytest

from gateway.web import logins as module
from gateway.web.logins import Logins, TooMany, network_of

HERE = "10.0.0.7"


class Clock:
    """[s]."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def made() -> tuple[Logins, Clock]:
    """Logins where everybody's password is `right`."""
    clock = Clock()
    return Logins(lambda _, password: password == "right", clock), clock


def run(story: Coroutine[Any, Any, None]) -> None:
    """Let a story happen."""
    asyncio.run(asyncio.wait_for(story, 30.0))


async def word_of(logins: Logins, name: str = "ann", host: str = HERE) -> str:
    """Log in rightly."""
    word = await logins.login(name, "right", host)
    assert word is not None
    return word


def test_a_session_ends_by_itself_and_by_logging_out() -> None:
    """Its word is nobody's before and afterwards."""

    async def story() -> None:
        logins, clock = made()
        first, second = await word_of(logins), await word_of(logins)
        assert first != second and logins.session("") is None and logins.session("\udc80") is None
        session = logins.session(first)
        assert session is not None and session.name == "ann"
        logins.logout(session)
        assert session.over.is_set() and logins.session(first) is None
        assert logins.session(second) is not None
        clock.now_s += module.SESSION_S
        assert logins.session(second) is None

    run(story())


def test_after_some_wrong_passwords_an_address_may_not_try() -> None:
    """Not even the right one, that would be a guess; others may, and after its time it may again."""

    async def story() -> None:
        logins, clock = made()
        for number in range(module.MOST_OF_ADDRESS):
            assert await logins.login(f"user{number}", "wrong", HERE) is None
        with pytest.raises(TooMany):
            await logins.login("ann", "right", HERE)
        await word_of(logins, host="10.0.0.8")
        clock.now_s += module.WINDOW_S
        await word_of(logins)

    run(story())


def test_a_user_is_guessed_from_many_addresses_no_more_often() -> None:
    """Whoever else logs in is not kept from it."""

    async def story() -> None:
        logins, _ = made()
        for number in range(module.MOST_OF_USER):
            assert await logins.login("ann", "wrong", f"10.0.1.{number}") is None
        with pytest.raises(TooMany):
            await logins.login("ann", "right", HERE)
        await word_of(logins, "bob")

    run(story())


def test_right_passwords_do_not_count() -> None:
    """A program may log in as often as it likes."""

    async def story() -> None:
        logins, _ = made()
        for _ in range(2 * module.MOST_OF_ADDRESS):
            await word_of(logins)

    run(story())


def test_one_password_is_tried_at_a_time_and_one_of_each_address_waits() -> None:
    """Who sends many at once gets no more guesses, and the processor is left to the robot."""

    async def story() -> None:
        go_on, tried = threading.Event(), []

        def is_right(name: str, _: str) -> bool:
            tried.append(name)
            return go_on.wait(20.0)

        logins = Logins(is_right)
        hosts = [f"10.0.0.{number}" for number in range(module.MOST_WAITING)]
        waiting = [asyncio.create_task(logins.login(host, "right", host)) for host in hosts]
        while not tried:
            await asyncio.sleep(0)
        for host in (hosts[0], hosts[-1], "10.0.9.9"):
            with pytest.raises(TooMany):
                await logins.login("ann", "right", host)
        assert len(tried) == 1
        go_on.set()
        assert all(await asyncio.gather(*waiting))
        await word_of(logins, host=hosts[0])

    run(story())


def test_a_try_that_is_broken_off_counts() -> None:
    """Who hangs up before the answer has guessed all the same."""

    async def story() -> None:
        def is_right(_: str, __: str) -> bool:
            raise OSError

        logins = Logins(is_right)
        for _ in range(module.MOST_OF_ADDRESS):
            with pytest.raises(OSError):
                await logins.login("ann", "right", HERE)
        with pytest.raises(TooMany):
            await logins.login("ann", "right", HERE)

    run(story())


def test_there_are_no_more_sessions_than_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that are over make room."""
    monkeypatch.setattr(module, "MOST_SESSIONS", 2)

    async def story() -> None:
        logins, _ = made()
        word, _other = await word_of(logins), await word_of(logins)
        with pytest.raises(TooMany):
            await logins.login("ann", "right", HERE)
        session = logins.session(word)
        assert session is not None
        logins.logout(session)
        await word_of(logins)

    run(story())


@pytest.mark.parametrize(
    ("host", "network"),
    [
        ("10.0.0.7", "10.0.0.7"),
        ("::ffff:10.0.0.7", "10.0.0.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::"),
        ("fe80::1%eth0", "fe80::"),
        ("testclient", "testclient"),
    ],
)
def test_what_a_peer_can_choose_its_addresses_from_counts_as_one(host: str, network: str) -> None:
    """An IPv6 host has 2^64 of them."""
    assert network_of(host) == network
