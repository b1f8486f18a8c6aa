"""The snapshot: plain frozen values that any encoder can write and any viewer can read."""

from __future__ import annotations

import ast
import inspect
import types
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import pytest
from msgspec.structs import replace

from gateway.messages import body_views, ground_views, snapshot

ROOT = Path(__file__).resolve().parents[2]
PARTS = {module.__name__ for module in (snapshot, ground_views, body_views)}
VIEWS = [getattr(snapshot, name) for name in snapshot.__all__]
PLAIN = (bool, int, float, str, type(None))


def is_plain(hint: Any) -> bool:
    """Whether a type is one that msgpack and JSON have: scalars, tuples of one type, objects keyed by text, views."""
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in PLAIN or hint in VIEWS:
        return True
    if origin in (Union, types.UnionType):
        return all(is_plain(argument) for argument in arguments)
    if origin is tuple:
        return len(arguments) == 2 and arguments[1] is Ellipsis and is_plain(arguments[0])
    return origin is dict and arguments[0] is str and is_plain(arguments[1])


def reachable(view: type) -> set[type]:
    """All views inside a view."""
    found, waiting = set(), [view]
    while waiting:
        hint = waiting.pop()
        waiting.extend(get_args(hint))
        if hint in VIEWS and hint not in found:
            found.add(hint)
            waiting.extend(get_type_hints(hint).values())
    return found


def test_every_view_is_exported():
    """A class of this module that is not in `__all__` would be missed by every rule here."""
    assert sorted(snapshot.__all__) == snapshot.__all__
    own = {name for name, thing in vars(snapshot).items() if inspect.isclass(thing) and thing.__module__ in PARTS}
    assert own == set(snapshot.__all__)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.__name__)
def test_a_view_has_plain_fields_only(view):
    """No enum, no engine object, no numpy: what is shown is text, numbers, and those in tuples and objects."""
    hints = get_type_hints(view)
    assert hints and {name for name, hint in hints.items() if not is_plain(hint)} == set()


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.__name__)
def test_a_view_is_frozen_slotted_and_built_by_keyword(view):
    """A viewer cannot change what another one sees, and no field is mistaken for its neighbour."""
    names = view.__struct_fields__
    value = view(**dict.fromkeys(names))
    assert not hasattr(value, "__dict__")
    with pytest.raises(AttributeError):
        setattr(value, names[0], 1)
    with pytest.raises(TypeError):
        view(*names)
    assert value == replace(value) and value != replace(value, **{names[-1]: "other"})


def test_whoever_makes_a_view_says_every_field():
    """Defaults are for snapshots of an earlier daemon: a forgotten field is an error, not an innocent zero."""
    texts = [path.read_text() for path in ROOT.glob("gateway/core/**/*.py")]
    calls = [
        node
        for text in texts
        if "gateway.messages." in text
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
    ]
    made = [
        (call.func.id, call) for call in calls if isinstance(call.func, ast.Name) and call.func.id in snapshot.__all__
    ]
    assert {name for name, _ in made} == set(snapshot.__all__)
    for name, call in made:
        assert {keyword.arg for keyword in call.keywords} == set(getattr(snapshot, name).__struct_fields__), name


def test_the_snapshot_holds_every_view():
    """A view that cannot be reached from the snapshot is shown to nobody."""
    assert reachable(snapshot.Snapshot) == set(VIEWS)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.__name__)
def test_times_are_integer_nanoseconds_and_physical_numbers_name_their_unit(view):
    """Units stand in the names (rad, m, Hz, ns), so that no viewer has to guess."""
    for name, hint in get_type_hints(view).items():
        if name.endswith("_ns"):
            assert int in (hint, *get_args(hint)) and float not in (hint, *get_args(hint)), name
        elif name != "facts" and float in (hint, *get_args(hint)):  # a finding's keys have the units
            assert name in ("progress", "sigmas", "direction") or name.endswith(
                ("_rad", "_radps", "_nm", "_n", "_m", "_kg", "_mps", "_xyzw", "_hz", "_ratio")
            ), name
