"""Tests of exit statuses, error lines and hints."""

from __future__ import annotations

import json
import re

import pytest

from gateway.cli.terminal.ending import (
    ExitStatus,
    for_stopping,
    in_shell_words,
    line_of,
    report,
    status_of,
    undelivered,
)
from gateway.errors import CODES, Code, Refusal, failure, to_exception


def error(code, **fields):
    """Return the exception of a code."""
    return to_exception(Refusal(code=code, message="m", **fields))


@pytest.mark.parametrize(
    ("code", "status"),
    [
        (Code.OUT_OF_RANGE, 1),
        (Code.LEASE_HELD, 1),
        (Code.STATE_STALE, 1),
        (Code.LATCHED, 1),
        (Code.TRACKING_ERROR, 1),
        (Code.CANCELLED, 1),
        (Code.SUPERSEDED, 1),
        (Code.STOP_UNDELIVERED, 1),
        (Code.BAD_CONFIG, 2),
        (Code.DISCONNECTED, 3),
        (Code.TIMEOUT, 4),
        (Code.OUTCOME_UNKNOWN, 4),
        (Code.UNSUPPORTED_VERSION, 5),
        (Code.INTERNAL, 5),
    ],
)
def test_each_kind_of_error_has_its_status(code, status):
    """Scripts tell refusals, mistakes, absence, doubt and breakage apart."""
    assert status_of(error(code)) == status


def test_a_target_that_is_no_address_is_a_mistake_of_the_command_line():
    """BAD_REQUEST about the target is usage; about anything else it is a refusal."""
    assert status_of(error(Code.BAD_REQUEST, field="target")) == ExitStatus.USAGE
    assert status_of(error(Code.BAD_REQUEST, field="reason")) == ExitStatus.REFUSED


def test_every_code_has_a_status_and_a_line():
    """Whatever reaches a caller can be reported."""
    for code in CODES:
        assert status_of(error(code)) in set(ExitStatus) - {ExitStatus.OK, ExitStatus.BROKEN_PIPE}
        line = line_of(error(code))
        assert line.startswith(f"{code}: m") and "\n" not in line


def test_hints_are_in_the_words_of_a_shell():
    """No call of a program is left in any hint: a person in a shell cannot follow it."""
    assert in_shell_words("stop() or estop()") == "`ta2 stop` or `ta2 estop`"
    assert in_shell_words("restop(), robot.stop()") == "restop(), robot.stop()"
    assert in_shell_words("make sure it is safe, then recover()") == "make sure it is safe, then `ta2 recover`"
    for code, info in CODES.items():
        assert not re.search(r"\w`ta2", in_shell_words(info.hint)), code
        assert "()" not in in_shell_words(info.hint).replace("stop() was called", ""), code


def test_a_command_without_take_is_not_told_to_take(capsys):
    """Its hint is what is left of it."""
    error = failure(Code.LEASE_HELD, "'ann' owns the robot")
    report(error)
    report(error, takes=False)
    with_take, without = capsys.readouterr().err.splitlines()
    assert with_take.endswith("-> wait until it is free, or --take REASON")
    assert without.endswith("-> wait until it is free")


def test_a_report_is_one_line_and_json_for_scripts(capsys):
    """Standard error gets the line, standard output the refusal with all its fields."""
    refusal = error(Code.OUT_OF_RANGE, field="left_arm[3]", value="9", bound="[0, 1]", unit="rad")
    assert report(refusal) == 1
    assert capsys.readouterr() == ("", "OUT_OF_RANGE: m -> stay inside the bound, or ask for --clip\n")
    assert report(refusal, as_json=True) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["ok"] is False and document["exit_status"] == 1
    assert document["error"]["code"] == "OUT_OF_RANGE" and document["error"]["bound"] == "[0, 1]"
    assert document["error"]["retryable"] is False


def test_a_stop_that_failed_has_one_hint_only():
    """Whatever keeps a stop from being known to work: the physical emergency stop. Refusals stay as they are."""
    for code in (Code.DISCONNECTED, Code.OUTCOME_UNKNOWN, Code.TIMEOUT):
        told = for_stopping(error(code))
        assert "physical emergency stop" in told.hint and told.code is code
    kept = error(Code.BAD_REQUEST)
    assert for_stopping(kept) is kept
    assert "physical emergency stop" in line_of(undelivered())
