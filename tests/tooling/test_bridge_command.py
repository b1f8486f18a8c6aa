"""`bin/bridge`: plain about what is missing, quick when the bridge is built, nothing built twice. No bridge is built here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.tooling.test_commands import PROGRAMS, ROOT, put_script

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

VERSIONS = ["1.10.2", "1.5.1", "1.9.0"]
CRATES = ROOT / "tests/interop/bridge"
# Besides what every command calls.
MORE_PROGRAMS = ["chmod", "cksum", "flock", "mkdir", "mv", "nice"]

CARGO = """
for word in "$@"; do
    case $word in */build) target=$word ;; esac
done
case $1 in
    build) mkdir -p "$target/release" && echo "built $LIBCLANG_PATH" >>"@HOME@/built" &&
        echo bridge >"$target/release/bridge" && chmod +x "$target/release/bridge" ;;
esac
"""
"""A cargo that notes that it was called and leaves a program where the real one would."""


class Machine:
    """A home and a folder with everything that `bin/bridge` calls, or less.

    Args:
        folder: For both.
    """

    def __init__(self, folder: Path) -> None:
        self.home = folder / "home"
        self.programs = folder / "programs"
        self.home.mkdir()
        self.programs.mkdir()
        for name in (*PROGRAMS, *MORE_PROGRAMS):
            path = shutil.which(name)
            assert path is not None
            (self.programs / name).symlink_to(path)
        put_script(self.programs / "cargo", CARGO.replace("@HOME@", str(self.home)))
        put_script(self.programs / "cmake", "true")
        put_script(self.programs / "cc", "echo /headers")
        (self.home / "clang").mkdir()
        (self.home / "clang/libclang.so").touch()

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run `bin/bridge` with nothing on the PATH but the folder."""
        environment = {"PATH": str(self.programs), "HOME": str(self.home), "LIBCLANG_PATH": str(self.home / "clang")}
        return subprocess.run(
            [ROOT / "bin/bridge", *words], env=environment, capture_output=True, text=True, timeout=20, check=False
        )

    @property
    def builds(self) -> int:
        """How often cargo was asked to build."""
        notes = self.home / "built"
        return len(notes.read_text().splitlines()) if notes.exists() else 0


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """A machine with everything a bridge is built with."""
    return Machine(tmp_path)


@pytest.mark.parametrize(
    ("program", "said"),
    [("cargo", "cargo: curl"), ("cmake", "cmake: bin/bridge tools"), ("cc", "a C compiler: sudo apt install")],
)
def test_a_missing_program_is_named_with_the_command_that_installs_it(
    machine: Machine, program: str, said: str
) -> None:
    """Each by itself, and what is there is not named; nothing is begun."""
    (machine.programs / program).unlink()
    done = machine.run("build")
    assert done.returncode == 2 and said in done.stderr
    assert done.stderr.count("\n  ") == 1, done.stderr
    assert machine.builds == 0


def test_a_shim_that_exists_and_fails_counts_as_missing(machine: Machine) -> None:
    """The cargo of a version manager that has no toolchain."""
    put_script(machine.programs / "cargo", "echo 'no default toolchain' >&2; exit 1")
    done = machine.run("build")
    assert done.returncode == 2 and "cargo: curl" in done.stderr


def test_a_missing_libclang_is_named_unless_the_system_has_one(machine: Machine) -> None:
    """The C++ library of a similar name is not it; what this machine has in its own places cannot be taken away here."""
    (machine.home / "clang/libclang.so").rename(machine.home / "clang/libclang-cpp.so")
    done = machine.run("build")
    if done.returncode == 0:  # this machine has one of its own
        (folder,) = {line.removeprefix("built ") for line in (machine.home / "built").read_text().splitlines()}
        assert any("-cpp" not in file.name for file in Path(folder).glob("libclang*"))
    else:
        assert "libclang: bin/bridge tools" in done.stderr and machine.builds == 0


def test_a_bridge_is_built_once_and_found_quickly_from_then_on(machine: Machine) -> None:
    """The first call builds with libclang's place, the second one only looks; both print the same file, and so does `path`."""
    assert machine.run("path").returncode == 1
    first = machine.run("build")
    assert first.returncode == 0, first.stderr
    program = Path(first.stdout.strip())
    assert os.access(program, os.X_OK) and not (program.parent / "build").exists()
    assert (machine.home / "built").read_text() == f"built {machine.home / 'clang'}\n"
    for name in ("cargo", "cmake", "cc"):
        (machine.programs / name).unlink()
    began = time.monotonic()
    second = machine.run("build")
    assert time.monotonic() - began < 2.0
    assert (second.returncode, second.stdout, second.stderr) == (0, first.stdout, "")
    assert machine.run("path").stdout == first.stdout
    assert machine.builds == 1


def test_each_version_is_another_bridge_and_an_unknown_one_is_refused(machine: Machine) -> None:
    """The one asked for is built beside the default one; what there is, is listed and named in the refusal."""
    default, old = machine.run("build"), machine.run("build", "1.5.1")
    assert default.stdout != old.stdout and "1.5.1" in old.stdout
    listed = machine.run("versions").stdout.splitlines()
    assert listed == [f"1.10.2 {default.stdout.strip()}", f"1.5.1 {old.stdout.strip()}", "1.9.0 not built"]
    for command in ("build", "path"):
        refused = machine.run(command, "1.2.3")
        assert refused.returncode == 2
        assert "version '1.2.3' is not known; those there are: 1.10.2 1.5.1 1.9.0" in refused.stderr
    assert machine.builds == 2


def test_a_build_that_fails_leaves_no_bridge_and_says_so(machine: Machine) -> None:
    """Status 2, nothing in the cache that would be taken for a bridge, and the next attempt builds."""
    cargo = (machine.programs / "cargo").read_text()
    put_script(machine.programs / "cargo", '[ "$1" != build ]')
    assert machine.run("build").returncode == 2
    assert machine.run("path").returncode == 1
    (machine.programs / "cargo").write_text(cargo)
    assert machine.run("build").returncode == 0


@pytest.mark.parametrize("words", [(), ("nonsense",), ("build", "1.9.0", "1.5.1")])
def test_what_is_not_understood_shows_the_usage(machine: Machine, words: tuple[str, ...]) -> None:
    """Status 2 and the commands there are."""
    done = machine.run(*words)
    assert done.returncode == 2 and "usage: bin/bridge build [VERSION]" in done.stderr


@pytest.mark.parametrize("version", VERSIONS)
def test_each_version_is_pinned_with_everything_below_it(version: str) -> None:
    """Zenoh and the plugin are of one version, all of zenoh's own crates too, and the lock file says so."""
    crate = tomllib.loads((CRATES / version / "Cargo.toml").read_text())
    assert {crate["dependencies"][name]["version"] for name in ("zenoh", "zenoh-plugin-ros2dds")} == {f"={version}"}
    locked = tomllib.loads((CRATES / version / "Cargo.lock").read_text())["package"]
    assert {package["version"] for package in locked if package["name"].startswith("zenoh")} == {version}
    assert all("checksum" in package for package in locked if package["name"] != "bridge")


def test_there_are_the_versions_that_are_promised() -> None:
    """Each folder with a lock file is one."""
    assert sorted(path.parent.name for path in CRATES.glob("*/Cargo.lock")) == sorted(VERSIONS)
