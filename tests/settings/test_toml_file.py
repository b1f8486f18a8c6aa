"""The settings file: complete, strict, and the same after a round trip; its errors name file, key, value and remedy."""

from __future__ import annotations

import re
import string
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from gateway.errors import Code, ConfigError
from gateway.robot.limits import HARD_A_RADPS2, HARD_J_RADPS3, HARD_V_RADPS, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import VARIANTS
from gateway.settings import toml_file
from gateway.settings.settings import (
    ArmSettings,
    ChassisSettings,
    EnableSettings,
    ForeignSettings,
    GuardSettings,
    LiftSettings,
    LinkSettings,
    LocalSettings,
    LossSettings,
    ModelSettings,
    PoseSettings,
    RealtimeSettings,
    Settings,
)
from gateway.values import Side

ROOT = Path(__file__).resolve().parents[2]
DEFAULT_TOML = ROOT / "configs" / "default.toml"
SECTIONS = {
    "robot": LinkSettings,
    "arm": ArmSettings,
    "chassis": ChassisSettings,
    "lift": LiftSettings,
    "pose": PoseSettings,
    "loss": LossSettings,
    "enable": EnableSettings,
    "local": LocalSettings,
    "foreign": ForeignSettings,
    "model": ModelSettings,
    "realtime": RealtimeSettings,
    "guard": GuardSettings,
}
UNITS = {
    "_mps": "m/s",
    "_mps2": "m/s²",
    "_mps3": "m/s³",
    "_radps": "rad/s",
    "_radps2": "rad/s²",
    "_radps3": "rad/s³",
    "_rad": "rad",
    "_hz": "Hz",
    "_m": "m",
    "_ms": "ms",
    "_s": "s",
}


def _refused(text: str, origin: str = "my.toml") -> ConfigError:
    with pytest.raises(ConfigError) as refused:
        toml_file.loads(text, origin)
    error = refused.value
    assert error.code is Code.BAD_CONFIG
    assert error.message.startswith(f"{origin}: ")
    assert error.hint
    return error


# ------------------------------------------------------------------------------------------------------------ defaults


def test_the_default_file_gives_the_defaults_of_the_dataclasses() -> None:
    """Two places, one truth."""
    assert toml_file.load(DEFAULT_TOML) == Settings()


def test_without_a_file_the_defaults_of_the_package_are_read() -> None:
    """`ta2 run` without --config."""
    assert toml_file.load() == Settings()


def test_the_installed_default_file_wins_over_the_checkouts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel has it beside the module; a checkout has it in configs/."""
    beside, checkout = tmp_path / "default.toml", tmp_path / "configs.toml"
    checkout.write_text("[arm]\nv_radps = 0.5\n")
    monkeypatch.setattr(toml_file, "DEFAULT_FILES", (beside, checkout))
    assert toml_file.load().arm.v_radps == 0.5
    beside.write_text("[arm]\nv_radps = 0.25\n")
    assert toml_file.load().arm.v_radps == 0.25


def test_a_package_without_its_default_file_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A broken installation is no traceback."""
    monkeypatch.setattr(toml_file, "DEFAULT_FILES", (tmp_path / "a.toml", tmp_path / "b.toml"))
    with pytest.raises(ConfigError, match=r"a\.toml: cannot be read: No such file"):
        toml_file.load()


def test_every_field_of_every_section_is_a_key_of_the_default_file() -> None:
    """Nothing can be set that the file does not show; `show` has the same keys in the same order."""
    pattern = re.compile(r"^(?:\[(\w+)\]|(\w+)(?:\.\w+)? = .*)$")
    found: dict[str, list[str]] = {}
    section = ""
    for line in DEFAULT_TOML.read_text(encoding="utf-8").splitlines():
        if match := pattern.match(line):
            if match[1]:
                section = match[1]
                found[section] = []
            elif match[2] not in found[section]:
                found[section].append(match[2])
        else:
            assert not line or line.startswith("#"), line
    assert found == {name: list(keys) for name, keys in toml_file.KEYS.items()}
    for name, part in SECTIONS.items():
        fields = list(part.__struct_fields__)
        assert [key.field for key in toml_file.KEYS[name].values()] == fields
    assert {f.default_factory for f in structs.fields(Settings)} == set(SECTIONS.values())


def test_every_key_of_the_default_file_has_a_comment_with_its_unit() -> None:
    """A comment stands above each key or group of keys, with the unit that the name promises."""
    comment: list[str] = []
    for line in DEFAULT_TOML.read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            comment = [*comment, line] if comment and comment[-1].startswith("#") else [line]
        elif " = " in line:
            assert comment, f"{line} has no comment"
            name = line.split(" = ")[0].split(".")[0]
            suffix = max((s for s in UNITS if name.endswith(s)), key=len, default=None)
            if suffix is not None:
                assert f"[{UNITS[suffix]}]" in " ".join(c for c in comment if c.startswith("#")), line
            comment.append("key")
        else:
            comment = []


def test_the_default_file_cites_only_sections_that_the_manual_has() -> None:
    """Typed from the manual's table of contents."""
    known = {
        "1.2",
        "2.4",
        "3.3.2",
        "4.0.3",
        "4.0.4",
        "4.1.1",
        "4.2",
        "4.3",
        "4.4",
        "4.4.2",
        "4.5",
        "4.6",
        "4.7",
        "4.8",
        "4.11.1",
        "4.11.2",
        "4.13",
        "6.6",
    }
    assert set(re.findall(r"§([\d.]*\d)", DEFAULT_TOML.read_text(encoding="utf-8"))) == known


def test_no_default_is_looser_than_the_robot() -> None:
    """The limits of the default file lie inside the hard ones (§4.13 and the behaviour table)."""
    arm = toml_file.load(DEFAULT_TOML).arm
    for side in Side:
        assert all(a >= b for a, b in zip(arm.lower_rad[side], JOINT_LOWER_RAD[side], strict=True))
        assert all(a <= b for a, b in zip(arm.upper_rad[side], JOINT_UPPER_RAD[side], strict=True))
    assert arm.v_radps <= HARD_V_RADPS
    assert arm.a_radps2 <= HARD_A_RADPS2
    assert arm.j_radps3 <= HARD_J_RADPS3


# ---------------------------------------------------------------------------------------------------------- round trip


def _limits(by_rad: float) -> dict[str, dict[Side, tuple[float, ...]]]:
    return {
        "lower_rad": {s: tuple(v + by_rad for v in JOINT_LOWER_RAD[s]) for s in Side},
        "upper_rad": {s: tuple(v - by_rad for v in JOINT_UPPER_RAD[s]) for s in Side},
    }


MS, S = 1_000_000, 1_000_000_000
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
SETTINGS = st.builds(
    Settings,
    arm=st.builds(
        lambda limits, **kw: ArmSettings(**limits, **kw),
        st.floats(0, 0.5).map(_limits),
        v_radps=st.floats(0.001, 3),
        a_radps2=st.floats(0.001, 15),
        settle_ns=st.integers(0, 5 * S),
        settle_timeout_ns=st.integers(100 * MS, 60 * S),
        target_expiry_ns=st.integers(50 * MS, 3 * S),
        start_margin_rad=st.floats(0, 0.05),
    ),
    loss=st.builds(
        LossSettings,
        keepalive_ns=st.integers(100 * MS, 250 * MS),
        free_after_ns=st.integers(S, 600 * S),
        down_after_ns=st.integers(600 * S, 3600 * S),
    ),
    enable=st.builds(EnableSettings, timeout_ns=st.integers(S, 60 * S), stale_ns=st.integers(20 * MS, 100 * MS)),
    link=st.builds(LinkSettings, model=st.sampled_from(sorted(VARIANTS)), lease_ms=st.integers(200, 1000)),
    local=st.builds(
        LocalSettings,
        socket=TEXT,
        socket_mode=st.sampled_from([0o600, 0o660, 0o640]),
        users_file=TEXT,
        tls_root_ca=TEXT,
    ),
    foreign=st.builds(ForeignSettings, policy=st.sampled_from(["hold", "warn"])),
    model=st.builds(
        ModelSettings,
        check=st.just(True),
        self_collision=st.booleans(),
        dynamics=st.booleans(),
        singularity_slowdown=st.booleans(),
        window_ns=st.integers(S, 30 * S),
        urdf=TEXT,
        calibration=TEXT,
    ),
    realtime=st.builds(RealtimeSettings, fifo=st.booleans(), fifo_priority=st.integers(21, 90)),
    guard=st.builds(GuardSettings, enabled=st.booleans(), freeze_ns=st.integers(40_000_000, 120_000_000)),
)


@given(SETTINGS)
def test_what_is_shown_loads_back_to_the_same_settings(settings: Settings) -> None:
    """To the nanosecond, the last bit of a float, and any letter of a path."""
    assert toml_file.loads(toml_file.show(settings), "shown") == settings


@pytest.mark.parametrize("letter", [*map(chr, range(0x101)), "\u2028", "\ufeff", "😀"], ids=ascii)
def test_a_path_with_any_letter_is_shown_so_that_it_loads_back(letter: str) -> None:
    """Quotes, backslashes and control characters are escaped as TOML demands, DEL included."""
    settings = Settings(local=LocalSettings(users_file=f"/a{letter}b"))
    assert toml_file.loads(toml_file.show(settings), "shown") == settings


def test_what_is_shown_is_what_the_default_file_says() -> None:
    """Showing the defaults gives the default file without its comments: one spelling of every value."""
    lines = DEFAULT_TOML.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line and not line.startswith("#")] == [
        line for line in toml_file.show(Settings()).splitlines() if line
    ]


def test_times_have_readable_units() -> None:
    """Each time in the unit in which people say it; a fraction stays exact."""
    settings = toml_file.loads("[loss]\nkeepalive_ms = 150.5\nfree_after_s = 2\n[arm]\ntarget_expiry_s = 0.3", "t")
    assert settings.loss.keepalive_ns == 150_500_000
    assert settings.loss.free_after_ns == 2_000_000_000
    assert settings.arm.target_expiry_ns == 300_000_000
    shown = toml_file.show(settings)
    assert "keepalive_ms = 150.5\n" in shown
    assert "free_after_s = 2\n" in shown
    assert "target_expiry_s = 0.3\n" in shown


def test_keys_that_are_left_out_keep_their_defaults() -> None:
    """A file says only what differs, down to one side of one limit."""
    assert toml_file.loads("", "empty") == Settings()
    arm = toml_file.loads("[arm]\nlower_rad.left = [-1, 0, -1, 0.25, -1, -1, -0.5]", "t").arm
    assert arm.lower_rad == {
        Side.LEFT: (-1.0, 0.0, -1.0, 0.25, -1.0, -1.0, -0.5),
        Side.RIGHT: JOINT_LOWER_RAD[Side.RIGHT],
    }
    assert all(isinstance(v, float) for v in arm.lower_rad[Side.LEFT])
    assert structs.replace(arm, lower_rad=ArmSettings().lower_rad) == ArmSettings()


# ------------------------------------------------------------------------------------------------------ unknown things


def test_an_unknown_key_lists_the_known_ones_and_names_the_closest() -> None:
    """A slip of typing is answered with the right word."""
    error = _refused("[loss]\nkeep_alive_ms = 200")
    assert error.field == "loss.keep_alive_ms"
    assert "known: keepalive_ms, free_after_s, down_after_s" in error.message
    assert error.hint == "did you mean 'keepalive_ms'?"


def test_a_time_in_the_wrong_unit_is_an_unknown_key_with_the_right_one() -> None:
    """250 s would not be 250 ms: the unit is part of the name."""
    assert _refused("[loss]\nkeepalive_s = 0.2").hint == "did you mean 'keepalive_ms'?"
    assert _refused("[loss]\nkeepalive_ns = 200000000").hint == "did you mean 'keepalive_ms'?"


def test_a_key_in_the_wrong_section_is_sent_home() -> None:
    """The key is right, its place is not."""
    error = _refused("[robot]\nv_radps = 1.0")
    assert error.message == "my.toml: robot.v_radps is unknown; it is a key of [arm]"
    assert error.hint == "move it to section [arm]"


def test_an_unknown_section_lists_the_known_ones_and_names_the_closest() -> None:
    """Sections of the future are errors too: nobody believes in a setting that does nothing."""
    error = _refused("[amr]\nv_radps = 1.0")
    assert (
        "known: [robot], [arm], [chassis], [lift], [pose], [loss], [enable], [foreign], [model], [local], "
        "[realtime], [guard]" in error.message
    )
    assert error.hint == "did you mean 'arm'?"


def test_nothing_is_suggested_when_nothing_is_close() -> None:
    """A wrong guess would be worse than none."""
    assert "did you mean" not in _refused("[arm]\nxyzzy = 1").hint


def test_an_unknown_side_names_both() -> None:
    """Left and right, as everywhere."""
    error = _refused("[arm]\nlower_rad.lfet = [0, 0, 0, 0, 0, 0, 0]")
    assert error.message == "my.toml: arm.lower_rad.lfet is unknown; known: left, right"
    assert error.hint == "did you mean 'left'?"


# --------------------------------------------------------------------------------------------------------- wrong types


def _samples() -> dict[str, str]:
    """One TOML value of every type."""
    return {
        "boolean": "true",
        "integer": "500",
        "float": "0.5",
        "text": '"a"',
        "list": "[1, 2]",
        "table": "{ a = 1 }",
        "date": "1979-05-27",
        "time": "07:32:00",
        "nan": "nan",
        "inf": "-inf",
        "endless": "0x" + "f" * 9000,
        "list of endless": "[0x" + "f" * 9000 + "]",
    }


ACCEPTED = {
    toml_file.Kind.NUMBER: {"integer", "float", "nan", "inf"},
    toml_file.Kind.WHOLE: {"integer"},
    toml_file.Kind.OCTAL: {"integer"},
    toml_file.Kind.SWITCH: {"boolean"},
    toml_file.Kind.TEXT: {"text"},
    toml_file.Kind.TIME: {"integer", "float"},
    toml_file.Kind.JOINTS: {"table"},
}
"""What gets past the type check; the bounds come after it."""


@pytest.mark.parametrize(
    "key", [key for keys in toml_file.KEYS.values() for key in keys.values()], ids=lambda k: k.name
)
def test_a_value_of_another_type_is_refused_with_what_is_needed(key: toml_file.Key) -> None:
    """Every key against every type of TOML: the right ones pass or break a bound, all others say what is needed."""
    for name, value in _samples().items():
        text = f"[{key.section}]\n{key.name} = {value}"
        try:
            toml_file.loads(text, "my.toml")
        except ConfigError as error:
            needed = "; needed: " in error.message
            assert needed == (name not in ACCEPTED[key.kind]), (name, error.message)
            # A bound may name a neighbour: the last stage of a loss is not before the first.
            assert error.field.startswith(f"{key.section}.{key.name}" if needed else key.section), error.field
            assert len(error.message) < 250
        else:
            assert name in ACCEPTED[key.kind], name


@pytest.mark.parametrize("value", ["1", '"a"', "[1, true]", '[1, "a"]', "[[1]]", "{}"])
def test_a_side_takes_a_list_of_numbers(value: str) -> None:
    """Neither a bare number nor a list with something else in it."""
    error = _refused(f"[arm]\nlower_rad.left = {value}")
    assert error.field == "arm.lower_rad.left"
    assert "needed: a list of numbers" in error.message


@pytest.mark.parametrize("text", ["arm = 3", "arm = [1]", "[[arm]]", 'arm = "x"'])
def test_a_section_is_a_table(text: str) -> None:
    """A section name used as a key, or as an array of tables."""
    error = _refused(text)
    assert error.field == "arm"
    assert "needed: a section" in error.message


def test_a_time_too_large_to_count_is_refused() -> None:
    """1e300 s is finite as a number and infinite in nanoseconds."""
    assert "needed: a finite number [s]" in _refused("[loss]\nfree_after_s = 1e300").message


@pytest.mark.parametrize(
    "text",
    [
        "arm",
        "[arm",
        "[arm]\nv_radps = ",
        "[arm]\nv_radps = 1\nv_radps = 2",
        "a = " + "[" * 20_000,
        "a = " + "9" * 5_000,
    ],
    ids=["word", "bracket", "no value", "twice", "nested", "digits"],
)
def test_what_is_no_toml_is_refused(text: str) -> None:
    """Syntax errors keep the parser's line and column; hostile nesting and digits are errors like any other."""
    assert "is not TOML: " in _refused(text).message


@given(st.text(alphabet=string.printable, max_size=80))
def test_any_text_gives_settings_or_a_config_error(text: str) -> None:
    """No other exception leaves the parser."""
    try:
        assert isinstance(toml_file.loads(text, "fuzz"), Settings)
    except ConfigError as error:
        assert error.message.startswith("fuzz: ")


SCRAPS = st.sampled_from(
    [f"[{name}]" for name in (*toml_file.KEYS, "x")]
    + [f"{key} = {value}" for keys in toml_file.KEYS.values() for key in keys for value in _samples().values()]
)


@given(st.lists(SCRAPS, max_size=6))
def test_any_mixture_of_keys_and_values_gives_settings_or_a_config_error(lines: list[str]) -> None:
    """The same for texts that are nearly right."""
    try:
        assert isinstance(toml_file.loads("\n".join(lines), "fuzz"), Settings)
    except ConfigError as error:
        assert error.message.startswith("fuzz: ")


# ------------------------------------------------------------------------------------------------------- only tightened


LOOSER: list[tuple[str, str, str, str, str]] = [
    # section, line, value, bound, unit
    ("arm", "v_radps = 3.5", "3.5", "[0.001, 3]", "rad/s"),
    ("arm", "a_radps2 = 16", "16.0", "[0.001, 15]", "rad/s²"),
    ("arm", "j_radps3 = 301", "301.0", "[0.01, 300]", "rad/s³"),
    ("arm", "target_expiry_s = 3.5", "3.5", "[0.05, 3]", "s"),
    ("arm", "tracking_rad = 0.6", "0.6", "[0.02, 0.5]", "rad"),
    ("arm", "rate_hz = nan", "nan", "[50, 200]", "Hz"),
    ("loss", "keepalive_ms = 300", "300", "[100, 250]", "ms"),
    ("enable", "stale_ms = 150", "150", "[20, 100]", "ms"),
    ("enable", "hold_stale_ms = 900", "900", "[100, 800]", "ms"),
    ("enable", "zero_timeout_s = 2.5", "2.5", "[1, 2]", "s"),
    ("robot", "lease_ms = 5000", "5000", "[200, 1000]", "ms"),
    ("chassis", "v_mps = 0.6", "0.6", "[0.01, 0.5]", "m/s"),
    ("chassis", "expiry_ms = 4000", "4000", "[50, 3000]", "ms"),
    ("lift", "v_max = 1.5", "1.5", "[0.01, 1]", ""),
    ("realtime", "fifo_priority = 99", "99", "[21, 90]", ""),
]


@pytest.mark.parametrize(("section", "line", "value", "bound", "unit"), LOOSER, ids=lambda x: x if "=" in x else "")
def test_a_looser_limit_is_refused_in_the_units_of_the_file(
    section: str, line: str, value: str, bound: str, unit: str
) -> None:
    """File, key, value, bound and unit; no nanoseconds that the file does not have."""
    error = _refused(f"[{section}]\n{line}")
    key = f"{section}.{line.split(' = ')[0]}"
    assert (error.field, error.value, error.bound, error.unit) == (key, value, bound, unit)
    with_unit = f" {unit}" if unit else ""
    assert f"{key} = {value}{with_unit} is outside {bound}{with_unit} (" in error.message
    assert "tighten" in error.hint


def test_a_looser_joint_limit_names_side_joint_and_section() -> None:
    """§4.13, with the joint counted as the manual counts it."""
    error = _refused("[arm]\nupper_rad.right = [1.8, 0.0, 2.6, -0.2, 1.8, 1.4, 0.7]")
    assert error.field == "arm.upper_rad.right[3]"
    assert (error.value, error.bound, error.unit) == ("-0.2", "[-2.2, -0.25]", "rad")
    assert "right arm joint 4, manual §4.13" in error.message


def test_a_word_that_is_not_allowed_is_refused_with_those_that_are() -> None:
    """A refusal without a number has a remedy of its own."""
    error = _refused('[robot]\nmodel = "plus"')
    assert (error.field, error.value, error.bound) == ("robot.model", "plus", "")
    assert "one of lite, standard, lift" in error.message
    assert "tighten" not in error.hint


# ----------------------------------------------------------------------------------------------- files and environment


def test_a_file_is_read_by_path_or_by_name(tmp_path: Path) -> None:
    """Both are usual; a byte order mark, as some editors write it, does no harm."""
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbf[arm]\r\nv_radps = 0.5\r\n")
    assert toml_file.load(path) == toml_file.load(str(path)) == Settings(arm=ArmSettings(v_radps=0.5))


def test_an_error_in_a_file_names_the_file(tmp_path: Path) -> None:
    """There may be several."""
    path = tmp_path / "lab.toml"
    path.write_text("[arm]\nv_radps = 9")
    with pytest.raises(ConfigError, match=r"lab\.toml: arm\.v_radps = 9\.0 rad/s is outside"):
        toml_file.load(path)


@pytest.mark.parametrize("kind", ["missing", "folder", "latin-1"])
def test_a_file_that_cannot_be_read_is_a_config_error(tmp_path: Path, kind: str) -> None:
    """No traceback of the operating system."""
    path = tmp_path / "x.toml"
    if kind == "folder":
        path.mkdir()
    elif kind == "latin-1":
        path.write_bytes('[robot]\nnamespace = "é"'.encode("latin-1"))
    reason = {"missing": "cannot be read: No such file", "folder": "cannot be read: Is a dir", "latin-1": "is no UTF-8"}
    with pytest.raises(ConfigError) as refused:
        toml_file.load(path)
    assert f"{path}: {reason[kind]}" in refused.value.message


def test_the_command_line_overrides_robot_and_socket_and_nothing_else() -> None:
    """`ta2 run --robot tcp/HOST:9000 --socket PATH`."""
    base = toml_file.loads('[robot]\nnamespace = "bot1"\n[local]\nsnapshot_hz = 10.0', "t")
    assert toml_file.overridden(base) == base
    both = toml_file.overridden(base, robot="tcp/10.0.0.5:9000", socket="/run/ta2.sock")
    assert (both.link.endpoint, both.local.socket) == ("tcp/10.0.0.5:9000", "/run/ta2.sock")
    assert (both.link.namespace, both.local.snapshot_hz) == ("bot1", 10.0)
    assert both.arm == base.arm
    other = toml_file.overridden(base, namespace="bot2", model="lift")
    assert (other.link.namespace, other.link.model) == ("bot2", "lift")


@pytest.mark.parametrize("flags", [{"robot": "10.0.0.5"}, {"namespace": "a*"}, {"model": "x"}])
def test_a_bad_option_is_a_config_error_of_the_command_line(flags: dict[str, Any]) -> None:
    """The same rules hold wherever the value comes from."""
    with pytest.raises(ConfigError, match=f"command line, --{next(iter(flags))}: "):
        toml_file.overridden(Settings(), **flags)


@pytest.mark.parametrize(
    ("environ", "folder"),
    [
        ({"TA2_STATE_DIR": "/srv/ta2", "XDG_STATE_HOME": "/x", "HOME": "/home/a"}, "/srv/ta2"),
        ({"XDG_STATE_HOME": "/x", "HOME": "/home/a"}, "/x/ta2"),
        ({"XDG_STATE_HOME": "relative", "HOME": "/home/a"}, "/home/a/.local/state/ta2"),
        ({"TA2_STATE_DIR": "", "XDG_STATE_HOME": "", "HOME": "/home/a"}, "/home/a/.local/state/ta2"),
    ],
)
def test_the_state_folder_follows_the_environment(
    environ: dict[str, str], folder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Our own variable, then the base directory specification, which ignores relative paths, then the home."""
    monkeypatch.setattr("os.environ", environ)
    assert toml_file.state_dir() == Path(folder)


def test_a_relative_state_folder_is_made_absolute(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It must not move when the daemon changes its folder; the process's own environment is the default."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TA2_STATE_DIR", "state")
    assert toml_file.state_dir() == tmp_path / "state"


@pytest.mark.parametrize("environ", [{}, {"HOME": ""}, {"HOME": "here"}])
def test_without_a_home_the_remedy_is_named(environ: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A service without a home says which variable helps."""
    monkeypatch.setattr("os.environ", environ)
    with pytest.raises(ConfigError) as refused:
        toml_file.state_dir()
    assert "TA2_STATE_DIR" in refused.value.hint
