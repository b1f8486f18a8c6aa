"""Settings that are read anew: what is taken and what needs a restart, all or nothing, and files that are none."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.errors import Code, ConfigError
from gateway.settings.reloading import (
    AT_MOST,
    FILES,
    MOST_BYTES,
    MOST_LINE,
    TAKEN,
    changes,
    marks,
    read_regular,
)
from gateway.settings.settings import ArmSettings, ChassisSettings, LocalSettings, Settings
from gateway.settings.toml_file import KEYS, load, loads
from tests.changed import replace

EVERY = {f"{section}.{key.field}" for section, keys in KEYS.items() for key in keys.values()}
BEGAN = Settings()
FEELING = replace(BEGAN, model=replace(BEGAN.model, dynamics=True))
"""What a bound on touches needs."""
PAGE = Path(__file__).resolve().parents[2] / "docs/how-to/service.md"


def test_what_is_taken_is_there_and_no_file_is() -> None:
    """What nobody said of a setting is that it needs a restart: below, setting by setting."""
    assert AT_MOST < TAKEN < EVERY and FILES < EVERY - TAKEN


def test_the_page_names_what_is_taken_and_nothing_else() -> None:
    """As the file calls it."""
    table = PAGE.read_text(encoding="utf-8").split("<!-- taken -->")[1]
    names = {f"{section}.{key.name}" for section, keys in KEYS.items() for key in keys.values()
             if f"{section}.{key.field}" in TAKEN}  # fmt: skip
    assert {word for word in table.split("`") if "." in word and " " not in word} == names


ANOTHER = {
    **{f"arm.{name}": 0.04 for name in ("settle_rad", "start_margin_rad")},
    "robot.endpoint": "tcp/10.0.0.9:9000",
    "robot.namespace": "other",
    "robot.model": "lite",
    "foreign.policy": "warn",
    "local.socket_mode": 0o600,
    "realtime.fifo_priority": 50,
    "robot.lease_ms": 300,
    "local.audit_log_mb": 20,
    "arm.lower_rad": {side: tuple(q + 0.01 for q in values) for side, values in BEGAN.arm.lower_rad.items()},
    "arm.upper_rad": {side: tuple(q - 0.01 for q in values) for side, values in BEGAN.arm.upper_rad.items()},
    "enable.seed_ns": 400_000_000,
    "pose.rate_hz": 60.0,
    "pose.start_margin_m": 0.005,
    "pose.dw_radps2": 4.0,
    "guard.hold_ns": 5_000_000_000,
    "enable.zero_timeout_ns": 1_500_000_000,
    "enable.mode_valid_ns": 2_500_000_000,
    "model.window_ns": 2_000_000_000,
    "model.margin_m": 0.03,
    "model.left_touch_n": 30.0,
    "model.right_touch_n": 30.0,
    "model.left_gripper_closed_rad": 0.13,
    "model.right_gripper_closed_rad": 0.13,
}
"""Another value of a setting, where half of it, a text more or the other way round makes no sense."""


def with_another(name: str, began: Settings = BEGAN) -> Settings:
    """Return the defaults, or others, with another value of one setting."""
    section, _, field = name.partition(".")
    section = {"robot": "link"}.get(section, section)
    part = getattr(began, section)
    value = getattr(part, field)
    if name in ANOTHER:
        value = ANOTHER[name]
    elif isinstance(value, bool):
        value = not value
    elif isinstance(value, str):
        value += "x"
    else:
        value = type(value)(value * 0.9)
    return replace(began, **{section: replace(part, **{field: value})})


@pytest.mark.parametrize("name", sorted(EVERY))
def test_each_setting_alone_is_taken_or_named(name: str) -> None:
    """Its new value in the one case, its name as the file has it and what to do in the other."""
    began = FEELING if name.endswith("_touch_n") else BEGAN
    fresh = with_another(name, began)
    section, _, field = name.partition(".")
    written = next(f"{section}.{key.name}" for key in KEYS[section].values() if key.field == field)
    if name in TAKEN:
        values, words = changes(began, began, fresh)
        assert values == {name: getattr(getattr(fresh, section), field)} and words.startswith(f"{written} = ")
    else:
        with pytest.raises(ConfigError) as refused:
            changes(began, began, fresh)
        assert refused.value.code is Code.BAD_CONFIG and "start the gateway anew" in refused.value.hint
        assert refused.value.message == f"needs a restart: {written}"


def test_one_that_needs_a_restart_keeps_all_others_from_being_taken() -> None:
    """All of those that need one are named; no value of a file of keys or of an address is told."""
    fresh = loads('[arm]\nv_radps = 0.5\nrate_hz = 90\n[local]\nroles_file = "/secret"\n', "f")
    with pytest.raises(ConfigError) as refused:
        changes(BEGAN, BEGAN, fresh, ["local.users_file"])
    assert refused.value.message == "needs a restart: the file of local.users_file, arm.rate_hz, local.roles_file"


def test_nothing_changed_is_taken_as_nothing() -> None:
    """A reading of the same file is no error."""
    assert changes(BEGAN, BEGAN, BEGAN) == ({}, "")


@pytest.mark.parametrize("name", sorted(AT_MOST))
def test_a_speed_limit_is_lowered_and_raised_up_to_that_of_the_start(name: str) -> None:
    """Gate and guard judge by that of the start, for as long as both live."""
    section, _, field = name.partition(".")
    lower = with_another(name)
    assert changes(BEGAN, lower, BEGAN)[0] == {name: getattr(getattr(BEGAN, section), field)}
    with pytest.raises(ConfigError, match=rf"needs a restart: {name} above the [\d.]+ of the start"):
        changes(lower, lower, BEGAN)


def test_times_are_told_in_the_units_of_the_file() -> None:
    """Nanoseconds are for the engine."""
    fresh = replace(BEGAN, chassis=ChassisSettings(expiry_ns=200_000_000), arm=ArmSettings(v_radps=0.5))
    values, words = changes(BEGAN, BEGAN, fresh)
    assert values == {"arm.v_radps": 0.5, "chassis.expiry_ns": 200_000_000}
    assert words == "arm.v_radps = 0.5, chassis.expiry_ms = 200"


# ------------------------------------------------------------------------------------------------ files


def test_a_file_that_the_settings_name_has_another_mark_when_it_was_changed(tmp_path: Path) -> None:
    """Written in its place, replaced, or gone; one that is not named, or cannot be, has none."""
    roles = tmp_path / "roles"
    roles.write_text("ann:admin\n")
    settings = replace(BEGAN, local=LocalSettings(roles_file=str(roles), users_file="\0"))
    before = marks(settings)
    assert set(before) == set(FILES) and before["local.roles_file"] and before["local.users_file"] == ()
    assert before["model.urdf"] == () and marks(settings) == before
    roles.write_text("ann:viewer\n")
    written = marks(settings)
    assert written["local.roles_file"] != before["local.roles_file"]
    roles.unlink()
    assert marks(settings)["local.roles_file"] == ()


def test_a_regular_file_is_read_as_at_the_start(tmp_path: Path) -> None:
    """With or without a mark of its order."""
    file = tmp_path / "c.toml"
    file.write_text("[arm]\nv_radps = 0.5\n", encoding="utf-8-sig")
    assert load(file, read_regular) == load(file) and load(None, read_regular) == Settings()


def pipe(path: Path) -> None:
    """A pipe into which nobody writes: whoever waits for it waits for ever."""
    os.mkfifo(path)


def huge(path: Path) -> None:
    """A file without an end, for all that matters."""
    with path.open("wb") as file:
        file.truncate(1 << 40)


def endless(path: Path) -> None:
    """A device that never ends and has no size."""
    path.symlink_to("/dev/zero")


def circle(path: Path) -> None:
    """A link to itself."""
    path.symlink_to(path)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (pipe, "cannot be read: it is no regular file"),
        (huge, f"cannot be read: it is larger than {MOST_BYTES} bytes"),
        (
            lambda path: path.write_text("a." * 1000 + "a = 1"),
            f"cannot be read: it has a line of more than {MOST_LINE} bytes",
        ),
        (endless, "cannot be read: it is no regular file"),
        (circle, "cannot be read: Too many levels of symbolic links"),
        (Path.mkdir, "cannot be read: Is a directory"),
        (lambda path: None, "cannot be read: No such file or directory"),
        (lambda path: path.write_bytes(b"\xff\xfe"), "is no UTF-8 text"),
        (lambda path: path.write_text("[arm"), "is not TOML"),
    ],
)
def test_what_is_no_file_is_an_error_and_never_waited_for(
    make: Callable[[Path], object], told: str, tmp_path: Path
) -> None:
    """Whatever stands under the name meanwhile."""
    file = tmp_path / "c.toml"
    make(file)
    with pytest.raises(ConfigError) as refused:
        load(file, read_regular)
    assert refused.value.message.startswith(f"{file}: {told}")
