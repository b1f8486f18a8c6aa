"""Views of what the body model does to motion: part of the snapshot, whose tests hold them to its rules."""

from __future__ import annotations

from msgspec.structs import replace

from gateway.messages import body_views, snapshot


def test_they_are_the_snapshots():
    """Given on from there, each as it is, frozen."""
    for name in body_views.__all__:
        view = getattr(body_views, name)
        assert getattr(snapshot, name) is view and name in snapshot.__all__
        value = view(**dict.fromkeys(view.__struct_fields__))
        assert value == replace(value) and not hasattr(value, "__dict__")
