"""The two clients are the same: whatever waits in one has a twin in the other, with the same names, arguments and types."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import subprocess
import sys

import pytest

import gateway.client
from gateway.client import aio, blocking

AWAITED_PROPERTIES = {("Robot", "info"), ("Robot", "state")}
"""What may wait cannot be a property under asyncio: there it is a method without arguments."""

WAITING_WORDS = (
    (r"\bAsyncIterator\b", "Iterator"),
    (r"\bAsyncGenerator\b", "Generator"),
    (r"\b(?:aio|aio_control)\.", ""),
)
"""What only says how somebody waits -> what it is in the blocking client."""


def waiting_classes():
    """Return the public classes of the modules that wait in the calling thread: those that need a twin."""
    found = {}
    for module_info in pkgutil.iter_modules(gateway.client.__path__, "gateway.client."):
        module = importlib.import_module(module_info.name)
        if module is not blocking and getattr(module, "run", None) is blocking.run:
            for name in module.__all__:
                thing = getattr(module, name)
                if inspect.isclass(thing) and thing.__module__ == module.__name__:
                    found[name] = thing
    return found


TWINS = [(theirs, getattr(aio, name, None)) for name, theirs in sorted(waiting_classes().items())]
IDS = [theirs.__name__ for theirs, _ in TWINS]


def public(thing):
    """Return the public names of a class."""
    return {name for name in dir(thing) if not name.startswith("_")}


def instance_attributes(thing):
    """Return the public attributes that the constructors of a class set."""
    return {
        name
        for base in thing.__mro__[:-1]
        if "__init__" in vars(base)
        for name in re.findall(r"\bself\.([a-z]\w*)(?::[^=\n]+)? = ", inspect.getsource(base.__init__))
    }


def plain(annotation):
    """Return an annotation as text, without what only says how somebody waits."""
    text = str(annotation)
    for pattern, word in WAITING_WORDS:
        text = re.sub(pattern, word, text)
    return text


def signature(function):
    """Return the arguments of a function, with kinds, defaults and types, and what it gives."""
    given = inspect.signature(function)
    arguments = [(p.name, p.kind, p.default, plain(p.annotation)) for p in given.parameters.values()]
    return arguments, plain(given.return_annotation)


def test_the_classes_that_wait_are_found():
    """The rules below apply to all of them, also to those that come later."""
    assert {"ArmControl", "Control", "EventStream", "JointStream", "MotionHandle", "Robot"} <= set(IDS)


@pytest.mark.parametrize(("theirs", "mine"), TWINS, ids=IDS)
def test_every_class_that_waits_has_a_twin_with_the_same_names(theirs, mine):
    """What one client can, the other can: methods, properties and attributes."""
    assert mine is not None, f"gateway.client.aio has no {theirs.__name__}"
    assert mine.__name__ in aio.__all__
    assert public(mine) == public(theirs)
    assert instance_attributes(mine) == instance_attributes(theirs)


@pytest.mark.parametrize(("theirs", "mine"), TWINS, ids=IDS)
def test_twins_have_the_same_signatures(theirs, mine):
    """Arguments, their order, kinds, defaults and types, and what is given back; only who waits how differs."""
    for name in public(theirs):
        other, own = inspect.getattr_static(theirs, name), inspect.getattr_static(mine, name)
        if isinstance(other, property) and (theirs.__name__, name) in AWAITED_PROPERTIES:
            assert inspect.iscoroutinefunction(own), name
            assert signature(own) == signature(other.fget), name
        elif isinstance(other, property):
            assert isinstance(own, property), name
            assert signature(own.fget) == signature(other.fget), name
        elif inspect.isfunction(other):
            assert signature(own) == signature(other), name
    assert signature(mine.__init__) == signature(theirs.__init__)


@pytest.mark.parametrize(("theirs", "mine"), TWINS, ids=IDS)
def test_twins_are_entered_iterated_and_shown_alike(theirs, mine):
    """`with` has its `async with`, `for` its `async for`; both show themselves the same way."""
    pairs = {"__enter__": "__aenter__", "__exit__": "__aexit__", "__iter__": "__aiter__", "__next__": "__anext__"}
    for blocking_name, async_name in pairs.items():
        assert hasattr(mine, async_name) is hasattr(theirs, blocking_name), blocking_name
    assert ("_repr_html_" in dir(mine)) is ("_repr_html_" in dir(theirs))
    assert ("__repr__" in vars(mine)) is ("__repr__" in vars(theirs))


def test_both_connect_alike():
    """The same arguments, defaults and types lead to either."""
    arguments, gives = signature(aio.connect)
    assert arguments == signature(gateway.client.connect)[0]
    assert gives == "Connecting" and hasattr(aio.Connecting, "__await__") and hasattr(aio.Connecting, "__aenter__")


def test_neither_blocks_where_the_other_waits():
    """Nothing of the asyncio client calls the blocking shell: a wait would stop the event loop."""
    for name in ("aio", "aio_control", "awaiting"):
        module = importlib.import_module(f"gateway.client.{name}")
        assert getattr(module, "run", None) is not blocking.run
        assert "blocking.run" not in inspect.getsource(module)


def test_whoever_does_not_use_asyncio_does_not_load_it():
    """The twin costs a blocking program nothing."""
    script = "import sys, gateway.client; sys.exit('gateway.client.aio' in sys.modules or 'asyncio' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", script], timeout=60, check=False).returncode == 0
