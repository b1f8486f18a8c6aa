"""The table of codes: each turns back into its class and tells what to do; none that reaches a caller is missing."""

from __future__ import annotations

import inspect
import pickle

import pytest

from gateway import errors
from gateway.errors import CODES, Code, CodeInfo, GatewayError, Refusal, to_exception

NOTICES_ONLY = {
    Code.START_AT_LIMIT,
    Code.SUSPENDED,
    Code.STATE_DUPLICATED,
    Code.STATE_JUMPED,
    Code.GUARD_LOST,
    Code.GUARDED,
    Code.TAKEN_OVER,
    Code.ROUTE_DEAD,
    Code.ROUTE_LOST,
    Code.STATE_CHANGED,
    Code.LEASE_CHANGED,
    Code.LATCH_CHANGED,
    Code.LINK_UP,
    Code.LINK_DOWN,
    Code.ROBOT_RESTARTED,
    Code.LOSS_STAGE,
    Code.ENDPOINT_CHANGED,
    Code.MOTION_ENDED,
    Code.WALK,
    Code.SETTINGS_READ,
    Code.SETTINGS_REFUSED,
    Code.CONNECTED,
    Code.NOTICES_LOST,
}
"""Codes of events that no request can fail with."""

FACTS = {"message": "m", "field": "f", "value": "1", "bound": "[2, 3]", "unit": "rad"}


@pytest.mark.parametrize("code", CODES)
def test_every_code_round_trips_to_its_class(code: Code) -> None:
    """A refusal of the core becomes exactly the class of the table, with all its facts readable."""
    error = to_exception(Refusal(code=code, **FACTS))
    assert type(error) is CODES[code].error
    assert error.code is code
    assert {name: getattr(error, name) for name in FACTS} == FACTS
    assert error.hint == CODES[code].hint
    assert error.retryable is CODES[code].retryable


@pytest.mark.parametrize("code", CODES)
def test_every_code_that_reaches_a_caller_has_a_remedy(code: Code) -> None:
    """A refusal without a next step leaves the user alone."""
    assert len(CODES[code].hint) >= 10


IMPERATIVES = frozenset(
    "acquire ask be call check clear command correct enable ensure give install look make mend move open release remove"
    " report restart see send set start stay stop take use wait".split()
)


@pytest.mark.parametrize("code", CODES)
def test_every_remedy_begins_with_what_to_do(code: Code) -> None:
    """A hint is an instruction, not a second description of the trouble."""
    assert CODES[code].hint.split()[0] in IMPERATIVES


def test_a_code_is_in_the_table_or_is_a_notice_only() -> None:
    """A new code must say which class it is, or that no request can fail with it."""
    assert set(CODES) | NOTICES_ONLY == set(Code)
    assert not set(CODES) & NOTICES_ONLY


def test_every_class_of_the_tree_has_a_code_of_its_own() -> None:
    """No class is dead; the classes without a code are the inner nodes of the tree."""
    inner = {errors.GatewayError, errors.Refused, errors.MotionEnded}
    classes = {c for c in vars(errors).values() if inspect.isclass(c) and issubclass(c, GatewayError)}
    assert {info.error for info in CODES.values()} == classes - inner


def test_the_drawn_tree_names_every_class() -> None:
    """The tree at the top of the module is the truth."""
    classes = {n for n, c in vars(errors).items() if inspect.isclass(c) and issubclass(c, GatewayError)}
    assert errors.__doc__ is not None
    assert all(name in errors.__doc__ for name in classes)


def test_a_hint_of_its_own_is_kept() -> None:
    """The table's hint only fills a gap."""
    assert to_exception(Refusal(code=Code.NOT_OWNER, message="m", hint="ask Bob")).hint == "ask Bob"


def test_a_notice_code_as_a_refusal_is_a_bug_of_the_gateway() -> None:
    """A code that no request can fail with still becomes an error, and not a crash of the client."""
    error = to_exception(Refusal(code=Code.LINK_UP, message="m"))
    assert type(error) is errors.InternalError and not error.retryable


def test_the_text_of_an_error_has_code_message_and_hint() -> None:
    """What a user sees first is complete; without a hint there is no arrow to nowhere."""
    refusal = Refusal(code=Code.OUT_OF_RANGE, message="joint 4: 0.1 rad", hint="stay inside")
    assert str(errors.Rejected(refusal)) == "OUT_OF_RANGE: joint 4: 0.1 rad -> stay inside"
    assert str(errors.Rejected(Refusal(code=Code.OUT_OF_RANGE, message="m"))) == "OUT_OF_RANGE: m"


def test_a_timeout_is_a_timeout_for_the_standard_library_too() -> None:
    """Code that knows only `TimeoutError` catches it, and its text is still ours."""
    error = to_exception(Refusal(code=Code.TIMEOUT, message="10 s"))
    assert isinstance(error, TimeoutError)
    assert str(error).startswith("TIMEOUT: 10 s")


def test_staleness_is_not_readiness_and_both_are_refusals() -> None:
    """The tree that callers catch by: what is stale may be tried again, what is refused has moved nothing."""
    assert issubclass(errors.Stale, errors.NotReady)
    for leaf in (errors.Rejected, errors.NotReady, errors.LeaseError):
        assert issubclass(leaf, errors.Refused)
    for end in (errors.Aborted, errors.Cancelled, errors.Superseded):
        assert issubclass(end, errors.MotionEnded)
        assert not issubclass(end, errors.Refused)
    assert all(info.retryable for info in CODES.values() if info.error is errors.Stale)


def test_codes_read_as_their_own_text() -> None:
    """The wire, logs and messages carry the bare code, and the value is the name."""
    assert all(str(code) == code.value == code.name for code in Code)


def test_an_error_survives_pickling() -> None:
    """Errors cross process borders with all their facts."""
    error = to_exception(Refusal(code=Code.LEASE_HELD, **FACTS))
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), again.refusal) == (type(error), error.refusal)


def test_a_code_is_retryable_only_by_decision() -> None:
    """The default is that a person must look."""
    assert not CodeInfo(error=errors.Refused).retryable
