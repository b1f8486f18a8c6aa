"""What zenoh says of a failure, without the places in its sources that it was built from."""

from __future__ import annotations

__all__ = ["in_words"]


def in_words(error: Exception) -> str:
    """Return an error of zenoh up to where it goes on with ` at /...rs:388`."""
    return str(error).partition(" at /")[0]
