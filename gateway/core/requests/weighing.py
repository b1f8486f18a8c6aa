"""Carries out the owner's requests about what a hand holds: work it out, and count on it. They move nothing."""

from __future__ import annotations

import math
from itertools import chain
from typing import TYPE_CHECKING

from gateway.core.messages.events import CommandRequested
from gateway.core.motion.bounds import within, wrong_count
from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.moves import Answer
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code, Refusal
from gateway.messages.requests import SetPayload, Weigh
from gateway.robot.limits import MAX_PAYLOAD_KG, MAX_PAYLOAD_M, MOST_NM
from gateway.values import ARM_DOF

if TYPE_CHECKING:  # loaded only where dynamics are asked for
    from gateway.core.robot_state.contact import Contacts

__all__ = ["Weighing"]

MOST_SWINGS = 8


class Weighing:
    """Requests about loads."""

    def __init__(self, coordinator: Coordinator, authorisation: Authorisation) -> None:
        self._coordinator = coordinator
        self._authorisation = authorisation

    def set_payload(self, command: CommandRequested, request: SetPayload, now_ns: int) -> Answer:
        """Count on a load from this tick on."""
        contacts = self._contacts(command, request.epoch)
        if isinstance(contacts, Refusal):
            return contacts
        mass_kg, com_m = request.mass_kg, request.com_m
        if len(com_m) != 3:
            return wrong_count("the payload's centre", len(com_m), 3, "com_m", "x, y, z [m]")
        for field, value, least, most, unit in (
            ("mass_kg", mass_kg, 0.0, MAX_PAYLOAD_KG, "kg"),
            *(("com_m", value, -MAX_PAYLOAD_M, MAX_PAYLOAD_M, "m") for value in com_m),
        ):
            hint = "weigh it anew, or say what the hand really holds"
            refusal = within(f"the payload's {field}", value, least, most, unit, field=field, hint=hint)
            if refusal is not None:
                return refusal
        contacts.carry(request.side, mass_kg, com_m)
        return {}

    def weigh(self, command: CommandRequested, request: Weigh, now_ns: int) -> Answer:
        """Work out what a hand holds."""
        contacts = self._contacts(command, request.epoch)
        if isinstance(contacts, Refusal):
            return contacts
        rows = {name: getattr(request, name) for name in ("q_rad", "up_nm", "down_nm", "noise_nm")}
        for name, swings in rows.items():
            if not 1 <= len(swings) == len(request.q_rad) <= MOST_SWINGS or {ARM_DOF} != set(map(len, swings)):
                message = (
                    f"{name} of what was weighed has not 1 to {MOST_SWINGS} times {ARM_DOF} numbers, for all the same"
                )
                return Refusal(
                    code=Code.WRONG_SHAPE, message=message, field=name, bound=f"(1..{MOST_SWINGS}, {ARM_DOF})"
                )
            worst = max(chain.from_iterable(swings), key=lambda value: abs(value) if math.isfinite(value) else math.inf)
            refusal = within(f"a number in {name} of what was weighed", worst, -MOST_NM, MOST_NM, field=name)
            if refusal is not None:
                return refusal
        found = contacts.weigh(request.side, now_ns, beside_empty=request.beside_empty, **rows)
        if isinstance(found, Refusal):
            return found
        return {
            "mass_kg": found.mass_kg,
            "mass_sd_kg": found.mass_sd_kg,
            "com_m": None if found.com_m is None else found.com_m.tolist(),
            "com_sd_m": None if found.com_sd_m is None else found.com_sd_m.tolist(),
            "condition": found.condition,
        }

    def _contacts(self, command: CommandRequested, epoch: int) -> Contacts | Refusal:
        """Return what feels, for the owner alone."""
        return self._authorisation.owner(command, epoch) or self._coordinator.contacts
