"""`ta2 config`: the settings in effect, and what a file changes; with the files that it names."""

from __future__ import annotations

from argparse import Namespace

from gateway.cli.terminal.ending import ExitStatus
from gateway.kinematics.configured import configured
from gateway.settings import toml_file
from gateway.settings.settings import Settings

__all__ = ["carry_out"]


def carry_out(options: Namespace) -> ExitStatus:
    """Print the settings, or what a file changes.

    Args:
        options: With `check` and `show`, each a path or None.

    Raises:
        ConfigError: Something in the file, or in one that section [model] names, is not as it must be.
    """
    if options.check is None:
        print(toml_file.show(toml_file.load(options.show or None)), end="")
        return ExitStatus.OK
    settings = toml_file.load(options.check)
    values, defaults = (_by_name(toml_file.show(each)) for each in (settings, toml_file.load()))
    changed = [
        f"  {name} = {value} (default {defaults[name]})" for name, value in values.items() if value != defaults[name]
    ]
    body = _body(settings)
    print(
        "\n".join([f"{options.check}: good, {len(changed) or 'no'} settings differ from the defaults", *changed, *body])
    )
    return ExitStatus.OK


def _body(settings: Settings) -> list[str]:
    """Read the files of the body model, as the daemon would; return a line about them where there are any."""
    model = settings.model
    if not model.check or not (model.urdf or model.calibration):
        return []
    source = configured(settings).source
    return [f"  body model: {source}" + (f", corrected by {model.calibration}" if model.calibration else "")]


def _by_name(shown: str) -> dict[str, str]:
    """Return the settings of `config.show` by section and key."""
    section, values = "", {}
    for line in shown.splitlines():
        name, equals, value = line.partition(" = ")
        if equals:
            values[f"{section}.{name}"] = value
        elif line:
            section = line.strip("[]")
    return values
