from __future__ import annotations

import pickle
import reprlib

import pytest

from cdr_types import errors
from cdr_types.errors import CdrError, CountOutOfBounds, DecodeError, UnencodableValue

LEAVES = [getattr(errors, name) for name in errors.__all__ if name not in ("CdrError", "DecodeError")]
OF_BYTES = {"BadString", "CountOutOfBounds", "NotBytes", "StringOutOfBounds", "TrailingBytes", "Truncated",
            "WrongEncapsulation"}  # fmt: skip


def test_every_error_is_a_cdr_error_and_a_value_error():
    """Whoever catches CdrError, or ValueError, catches all of them."""
    assert all(issubclass(leaf, CdrError) and issubclass(leaf, ValueError) for leaf in LEAVES)


def test_decode_error_gathers_what_bytes_can_do_wrong():
    """A receiver tells bad bytes from its own mistakes by one class."""
    assert {leaf.__name__ for leaf in LEAVES if issubclass(leaf, DecodeError)} == OF_BYTES


def test_the_message_tells_field_value_bound_and_place():
    """The text is built from the fields, and the fields stay readable."""
    error = CountOutOfBounds(4_294_967_295, 2, 16, "name")
    assert str(error) == ("name: 4294967295 elements announced, the payload has room for at most 2 (at byte 16)")
    assert (error.value, error.bound, error.offset, error.field) == (4_294_967_295, 2, 16, "name")


def test_the_message_leaves_out_what_is_not_known():
    """Without a field or an offset the sentence stands alone; a bound that is no phrase is shown as a value."""
    assert str(CdrError(1, 2)) == "found 1, allowed is 2"
    assert str(CdrError(1, ["a" * 100] * 9)) == "found 1, allowed is " + reprlib.repr(["a" * 100] * 9)
    assert str(UnencodableValue(None, "a str", field="data")) == "data: None cannot be written; it must be a str"


def test_long_values_are_shortened_in_the_message_only():
    """A megabyte of garbage gives one readable line; the field keeps it whole."""
    error = UnencodableValue("x" * 1_000_000, "short")
    assert len(str(error)) < 200
    assert len(error.value) == 1_000_000


@pytest.mark.parametrize("leaf", LEAVES)
def test_every_error_has_a_sentence_and_survives_pickling(leaf):
    """Errors cross process boundaries with all their fields."""
    error = pickle.loads(pickle.dumps(leaf("value", "bound", 4, "header.frame_id")))
    assert type(error) is leaf
    assert (error.value, error.bound, error.offset, error.field) == ("value", "bound", 4, "header.frame_id")
    assert str(error).startswith("header.frame_id: ")
    assert "value" in str(error) and "bound" in str(error) and str(error).endswith("(at byte 4)")
