"""An engine's state as bytes, and an engine of its own from them that goes on bit for bit: ruckig's plans are worked out anew.

Rules
    * Freezing is done in the control loop, after its frames have left, and takes it about a millisecond: what is large and
      never changes (the body's model, the motion through a chunk's points, replies that were given) is only named there.
      Whoever writes packs it.
    * Work that is cut into ticks (`yield`) cannot be frozen; the next moment can be. `Unfrozen` says so.
    * Of the settings of the local plane only what the engine reads is packed: no file of users or keys is named.
    * Thawing builds nothing but the gateway's own values: no file makes it call anything else. Of functions and methods it has
      those of the core, which reach neither disk nor network nor anything that is not given to them.
"""

from __future__ import annotations

import copyreg
import io
import pickle
import re
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from types import FunctionType, MethodType
from typing import Any, Literal, NamedTuple, TypeGuard

from msgspec.structs import replace
from ruckig import InputParameter, Ruckig, Trajectory

from gateway.core.engine import Engine
from gateway.core.motion.chunk import Chunk
from gateway.core.motion.joints.trajectory import Trajectory as JointMotion
from gateway.core.motion.poses.pose_trajectory import PoseTrajectory
from gateway.core.motion.solver import NoPlan, Plan, solve
from gateway.core.requests.answers import Kept
from gateway.settings.settings import LocalSettings

__all__ = ["Frozen", "Unfrozen", "Unpickler", "freeze", "packed", "thaw"]

FIELDS = tuple(
    name
    for name in dir(InputParameter)
    if not (name.startswith("_") or callable(getattr(InputParameter, name)) or name == "degrees_of_freedom")
)

ROOMS = ("gateway.core.", "gateway.messages.", "gateway.kinematics.", "gateway.settings.", "gateway.robot.")
MODULES = (
    "gateway.errors",
    "gateway.codes",
    "gateway.values",
    "gateway.incident.records",
    "collections",
    "math",
)
"""Whose values may be thawed, with the rooms above."""
CORE = "gateway.core."
"""Whose functions and methods may be thawed."""
OTHERS = {
    "builtins": ("set", "frozenset", "bytearray", "range", "max", "min"),
    "copyreg": ("_reconstructor", "__newobj__"),
    "functools": ("partial",),
    "itertools": ("count",),
    "msgspec._utils": ("rebuild",),
    "_operator": ("le", "sub", "mul", "add"),
    "ruckig": ("Ruckig", "ControlInterface", "DurationDiscretization", "Synchronization"),
}


class Unfrozen(Exception):
    """The engine cannot be frozen at this moment. The message says what is in the way."""


class Frozen(NamedTuple):
    """An engine at one moment.

    Attributes:
        state: What changes.
        parts: What does not, by the numbers that `state` has for it.
    """

    state: bytes
    parts: Sequence[object]


def freeze(engine: Engine) -> Frozen:
    """Return an engine's state between two ticks.

    Raises:
        Unfrozen: It is in the middle of work that is cut into ticks.
    """
    parts: list[object] = []
    return Frozen(_dumped(engine, _table(parts.append, parts)), parts)


def packed(frozen: Frozen) -> tuple[bytes, bytes]:
    """Return a frozen engine as bytes, parts and state; of any thread.

    Raises:
        Unfrozen: A part cannot be packed.
    """
    return _dumped(list(frozen.parts), _table()), frozen.state


def thaw(parts: bytes, state: bytes) -> Engine:
    """Return an engine that goes on from there.

    Raises:
        ValueError: That is no engine of this release.
    """
    known = Unpickler(io.BytesIO(parts)).load()
    engine = Unpickler(io.BytesIO(state), known).load()
    if not isinstance(engine, Engine):
        raise ValueError("no engine is in it")
    return engine


# ------------------------------------------------------------------------------------------------------- to bytes


def _dumped(value: object, table: dict[type, Any]) -> bytes:
    file = io.BytesIO()
    pickler = pickle.Pickler(file, 5)
    pickler.dispatch_table = table
    try:
        pickler.dump(value)
    except (pickle.PicklingError, TypeError, AttributeError, RuntimeError) as error:
        raise Unfrozen(str(error)) from error
    return file.getvalue()


def _table(take: Callable[[object], None] | None = None, parts: Sequence[object] = ()) -> dict[type, Any]:
    """Return what becomes of values that say nothing themselves; with `take`, what does not change is given to it."""
    table = dict(copyreg.dispatch_table)
    table[Ruckig] = lambda solver: (Ruckig, (solver.degrees_of_freedom,))
    table[InputParameter] = lambda entry: (_entry, _fields(entry))
    table[Plan] = lambda plan: (_plan, (plan.degrees_of_freedom, plan.entry))
    table[Trajectory] = lambda plan: (Plan, (plan.degrees_of_freedom,))
    table[LocalSettings] = lambda local: (_local, (local.snapshot_hz, local.demand_stop_endpoint))
    if (np := sys.modules.get("numpy")) is not None:  # only where it is there anyway
        table[np.ndarray] = _told
        table.update(dict.fromkeys((np.bool_, np.float32, np.float64, np.int32, np.int64), _told_number))
    if take is not None:

        def named(part: object) -> tuple[Any, ...]:
            take(part)
            return _part, (len(parts) - 1,)

        table.update(dict.fromkeys(_unchanging(), named))
    return table


def _told(array: Any) -> tuple[Any, ...]:  # noqa: ANN401  numpy may not be there
    order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    return _array, (array.dtype.str, array.shape, order, array.tobytes(order))


def _told_number(number: Any) -> tuple[Any, ...]:  # noqa: ANN401  as above
    return _number, (number.dtype.str, number.tobytes())


def _unchanging() -> tuple[type, ...]:
    model = sys.modules.get(
        "gateway.core.robot_state.body_model"
    )  # it takes numpy along: only where it is there anyway
    body = (model.ArmModel, model.CollisionModel, model.Approach) if model is not None else ()
    dynamics = sys.modules.get("gateway.kinematics.dynamics.arm_dynamics")  # as above
    feeling = (dynamics.ArmDynamics,) if dynamics is not None else ()
    return (Chunk, JointMotion, PoseTrajectory, Kept, *body, *feeling)


def _fields(entry: InputParameter) -> tuple[int, dict[str, object]]:
    fresh = InputParameter(entry.degrees_of_freedom)
    told = {name: getattr(entry, name) for name in FIELDS}
    return entry.degrees_of_freedom, {name: value for name, value in told.items() if value != getattr(fresh, name)}


# ------------------------------------------------------------------------------------------------------- from bytes


class Unpickler(pickle.Unpickler):
    """Reads values of the gateway, and nothing else, from a file.

    Args:
        file: To be read.
        parts: What it has numbers for.
    """

    def __init__(self, file: io.BytesIO, parts: Sequence[object] = ()) -> None:
        super().__init__(file)
        self._parts = parts

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401  as its base has it
        """Return what a name stands for; refuse what is no value of the gateway."""
        if (module, name) == (__name__, _part.__name__):
            return self._parts.__getitem__
        if (module, name) == ("builtins", "getattr"):
            return _method
        if module == __name__ and name in MADE:
            return MADE[name]
        is_own = module.startswith(ROOMS) or module in MODULES
        if not (is_own or name in OTHERS.get(module, ())):
            raise pickle.UnpicklingError(f"{module}.{name} is no value of the gateway")
        found = import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        if is_own and not ("__" not in name and (_is_class(found) or _is_of_the_core(found))):
            raise pickle.UnpicklingError(f"{module}.{name} is no value of the gateway")
        return found


def _is_class(found: object) -> bool:
    return isinstance(found, type) and (found.__module__.startswith(ROOMS) or found.__module__ in MODULES)


def _is_of_the_core(found: object) -> TypeGuard[FunctionType]:
    return isinstance(found, FunctionType) and found.__module__.startswith(CORE)


def _method(owner: object, name: str) -> object:
    found = getattr(type(owner), name, None)
    if name.startswith("__") or not (type(owner).__module__.startswith(CORE) and _is_of_the_core(found)):
        raise pickle.UnpicklingError(f"{name} is no method of the core")
    return MethodType(found, owner)


def _part(number: int) -> object:
    raise LookupError(f"part {number} stands elsewhere")


def _entry(joints: int, fields: dict[str, object]) -> InputParameter:
    entry = InputParameter(joints)
    for name, value in fields.items():
        if name not in FIELDS:
            raise pickle.UnpicklingError(f"{name} is no field of an input")
        setattr(entry, name, value)
    return entry


def _plan(joints: int, entry: InputParameter | None) -> Plan:
    plan = Plan(joints)
    if entry is not None:
        try:
            solve(Ruckig(joints), entry, plan)
        except NoPlan:  # nor was there one then
            pass
    return plan


def _array(kind: str, shape: tuple[int, ...], order: Literal["C", "F"], content: bytes) -> object:
    import numpy as np

    if not re.fullmatch(r"[<>|=][biuf][1248]", kind):
        raise pickle.UnpicklingError(f"{kind} is no kind of number")
    return np.frombuffer(bytearray(content), kind).reshape(shape, order=order)


def _number(kind: str, content: bytes) -> object:
    return _array(kind, (1,), "C", content)[0]  # type: ignore[index]  # it is an array


def _local(snapshot_hz: float, demand_stop_endpoint: bool) -> LocalSettings:
    return replace(LocalSettings(), snapshot_hz=snapshot_hz, demand_stop_endpoint=demand_stop_endpoint)


MADE = {made.__name__: made for made in (_entry, _plan, _local, _array, _number)}
