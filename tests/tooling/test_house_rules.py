"""The rules of `house_rules.py`: this checkout keeps them, and each of them bites."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.tooling import house_rules

Rule = Callable[[Path], Iterator[str]]


BREACHES: list[tuple[Rule, str, str, str]] = [
    (house_rules.long_modules, "gateway/long.py", "x = 1\n" * 401, "401 lines"),
    (house_rules.banned_names, "gateway/utils.py", "", "'utils' says nothing"),
    (house_rules.banned_names, "cdr_types/helpers/arm.py", "", "'helpers' says nothing"),
    (house_rules.banned_names, "tests/core/test_common.py", "", "'test_common' says nothing"),
    (house_rules.missing_exports, "gateway/arm.py", '"""Arm."""\n\nDOF = 7\n', "has no __all__"),
    (house_rules.missing_exports, "gateway/arm.py", '__all__ = ["Arm"]\n', "names 'Arm'"),
    (house_rules.missing_exports, "gateway/arm.py", '__all__ = ["q"]\n\ndef f():\n    q = 1\n', "names 'q'"),
    (house_rules.cloud_calls, "gateway/core/motion/motion.py", f"x.{house_rules.CLOUD_FIELD} = []\n", "motion.py:1:"),
    (
        house_rules.bare_threads,
        "gateway/process/loop.py",
        "import threading\nthreading.Thread(target=f).start()\n",
        "loop.py:2:",
    ),
    (house_rules.bare_threads, "gateway/sim/node.py", "from threading import Timer\nTimer(1, f)\n", "'Timer'"),
    (house_rules.broken_links, "README.md", "[here](docs/nowhere.md)\n", "nothing is at docs/nowhere.md"),
    (house_rules.broken_links, "docs/a.md", "# A\n[b](#b)\n", "no heading is at #b"),
    (house_rules.snippets, "README.md", "# Title\n\n```python\nx = 1\nwith :\n```\n", "README.md:5:"),
]


@pytest.mark.parametrize(
    ("rule", "path", "text", "message"), BREACHES, ids=lambda value: getattr(value, "__name__", None)
)
def test_a_breach_is_found_and_named(rule: Rule, path: str, text: str, message: str, tmp_path: Path) -> None:
    """Each rule finds a breach in a checkout that has nothing else, and says where it is."""
    (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / path).write_text(text, encoding="utf-8")
    (breach,) = rule(tmp_path)
    assert message in breach


@pytest.mark.parametrize(
    "text",
    [
        '"""Only a docstring."""\n',
        '__all__ = ["a", "b", "c", "D"]\nimport a\nfrom x import y as b\nif a:\n    c = 1\n\nclass D:\n    pass\n',
        '__all__ = ["Lazy"]\n\ndef __getattr__(name):\n    return name\n',
    ],
    ids=["docstring only", "every kind of binding", "lazy module"],
)
def test_exports_that_exist_are_accepted(text: str, tmp_path: Path) -> None:
    """The rule about `__all__` accepts docstring-only modules, every kind of binding, and lazy modules."""
    (tmp_path / "gateway").mkdir()
    (tmp_path / "gateway" / "arm.py").write_text(text, encoding="utf-8")
    assert list(house_rules.missing_exports(tmp_path)) == []


def test_what_the_client_needs_is_followed_through_other_modules(tmp_path: Path) -> None:
    """A package that the client reaches through others is found, with the way there; type checking does not count."""
    sources = {
        "gateway/__init__.py": "",
        "gateway/client/__init__.py": "import json\nimport zenoh\nfrom gateway.api import protocol\n",
        "gateway/client/view.py": "if TYPE_CHECKING:\n    import rich\n",
        "gateway/api/__init__.py": "",
        "gateway/api/protocol.py": "def f():\n    from ruckig import Ruckig\n",
    }
    for path, text in sources.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    (breach,) = house_rules.heavy_clients(tmp_path)
    assert breach.startswith("gateway/api/protocol.py <- gateway/client/__init__.py: needs 'ruckig'")


def test_a_crowded_folder_is_found_and_named(tmp_path: Path) -> None:
    """One module more than a stranger can look through."""
    folder = tmp_path / "gateway" / "link"
    folder.mkdir(parents=True)
    for number in range(house_rules.MOST_MODULES + 1):
        (folder / f"part_{number}.py").write_text("")
        told = list(house_rules.crowded_folders(tmp_path))
        assert bool(told) is (number == house_rules.MOST_MODULES)
    assert told[0].startswith("gateway/link: 21 modules")


def test_the_readme_shows_python() -> None:
    """There are Python snippets; else the rule that they compile would pass on nothing."""
    assert (house_rules.ROOT / "README.md").read_text(encoding="utf-8").count("```python\n") >= 1


def test_modules_that_need_each_other_are_found(tmp_path: Path) -> None:
    """Inside functions as well; what only a type checker reads is no need."""
    (tmp_path / "gateway").mkdir()
    for name, text in {
        "a": "def f():\n    from gateway.b import g\n",
        "b": "from gateway import c\n",
        "c": "from gateway.a import f\n",
        "d": "if TYPE_CHECKING:\n    from gateway.e import E\n",
        "e": "import gateway.d\n",
    }.items():
        (tmp_path / "gateway" / f"{name}.py").write_text(text, encoding="utf-8")
    (breach,) = house_rules.import_circles(tmp_path)
    assert all(f"gateway/{name}.py" in breach for name in "abc") and "circle" in breach
    (tmp_path / "gateway" / "c.py").write_text("", encoding="utf-8")
    assert not list(house_rules.import_circles(tmp_path))
