"""What every section of the settings needs: the refusal of a value, with its bound, unit and source."""

from __future__ import annotations

__all__ = ["HARD", "MS", "OURS", "S", "SettingsRefused", "within"]

MS = 1_000_000
"""Nanoseconds in a millisecond."""
S = 1_000_000_000
"""Nanoseconds in a second."""

OURS = "ours"
"""Source of a bound that the gateway has chosen."""
HARD = "hard bound of the gateway"
"""Source of a bound that no configuration may loosen."""


class SettingsRefused(ValueError):
    """A setting is looser than the robot's hard limit, or makes no sense. The text has value, bound and unit.

    Attributes:
        name: Section and field, e.g. `arm.v_radps`, with side and index where one number of a list is to blame.
        value: What was asked for.
        bound: Lowest and highest value allowed; None when the setting is no number.
        unit: Unit of value and bound; empty where there is none.
        rule: What is allowed instead, in words; empty when the bound says it all.
        source: Where the rule comes from; empty when the rule speaks for itself.
    """

    def __init__(
        self,
        name: str,
        value: float | str,
        *,
        bound: tuple[float, float] | None = None,
        unit: str = "",
        rule: str = "",
        source: str = "",
    ) -> None:
        super().__init__(name, value)
        self.name = name
        self.value = value
        self.bound = bound
        self.unit = unit
        self.rule = rule
        self.source = source

    def __str__(self) -> str:
        """Return `name = value unit is outside [low, high] unit (source)`, or the rule in place of the bound."""
        unit = f" {self.unit}" if self.unit else ""
        rule = self.rule if self.bound is None else f"is outside {self.bound_text}{unit}"
        source = f" ({self.source})" if self.source else ""
        return f"{self.name} = {self.value!r}{unit} {rule}{source}"

    @property
    def bound_text(self) -> str:
        """The bound as `[low, high]`; empty when the setting is no number."""
        return "" if self.bound is None else "[{:.12g}, {:.12g}]".format(*self.bound)

    def in_unit(self, name: str, unit: str, scale: int) -> SettingsRefused:
        """Return the same refusal as the file has it: under another name, value and bound divided by `scale`."""
        value = self.value
        if not isinstance(value, str):
            value = value / scale if value % scale else value // scale
        bound = None if self.bound is None else (self.bound[0] / scale, self.bound[1] / scale)
        return SettingsRefused(name, value, bound=bound, unit=unit, rule=self.rule, source=self.source)


def within(name: str, value: float, low: float, high: float, unit: str, source: str) -> None:
    """Refuse a value outside its bound.

    Args:
        name: Section and field.
        value: What was asked for.
        low: Lowest value allowed.
        high: Highest value allowed.
        unit: Unit of all three.
        source: Where the bound comes from.

    Raises:
        SettingsRefused: It is outside, or not a number.
    """
    if not low <= value <= high:  # NaN compares false
        raise SettingsRefused(name, value, bound=(low, high), unit=unit, source=source)
