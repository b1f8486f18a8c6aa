"""Rules of this repository that no linter knows, as functions that return what breaks them.

`python -m tests.tooling.house_rules` prints every breach and exits 1 if there is one; `test_house_rules.py` shows that
each rule bites. Reads source text only; imports nothing of the packages.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

__all__ = [
    "banned_names",
    "bare_threads",
    "breaches",
    "broken_links",
    "cloud_calls",
    "crowded_folders",
    "heavy_clients",
    "import_circles",
    "long_modules",
    "missing_exports",
    "snippets",
]

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("gateway", "cdr_types")
SOURCES = (*PACKAGES, "plugins")
MAX_LINES = 400
MOST_MODULES = 20
BANNED_NAMES = frozenset(
    {"base", "common", "helper", "helpers", "manager", "misc", "shared", "stuff", "tools", "util", "utils"}
)
CLIENT_NEEDS = frozenset({"zenoh", "msgspec", "numpy"})
THREADS = "gateway/process/threads.py"
CLOUD_FIELD = "intermediate" + "_positions"
"""The field of ruckig that sends a motion to somebody else's computer."""


def _modules(root: Path, *folders: str) -> Iterator[Path]:
    for folder in folders:
        yield from sorted((root / folder).rglob("*.py"))


def long_modules(root: Path) -> Iterator[str]:
    """Modules of more than 400 lines. Tests are exempt: one file must cover one module, however much that takes."""
    for path in _modules(root, *SOURCES):
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > MAX_LINES:
            yield f"{path.relative_to(root)}: {lines} lines, {MAX_LINES} are allowed: split it by concept"


def crowded_folders(root: Path) -> Iterator[str]:
    """Folders in which a stranger does not find his way."""
    folders = Counter(path.parent for path in _modules(root, *SOURCES))
    for folder, count in sorted(folders.items()):
        if count > MOST_MODULES:
            yield f"{folder.relative_to(root)}: {count} modules, {MOST_MODULES} are allowed: make rooms of it"


def banned_names(root: Path) -> Iterator[str]:
    """Modules and folders whose name says nothing."""
    for path in _modules(root, *SOURCES, "tests"):
        for part in path.relative_to(root).with_suffix("").parts:
            if part.removeprefix("test_").lower() in BANNED_NAMES:
                yield f"{path.relative_to(root)}: '{part}' says nothing: name it after the concept inside"


def missing_exports(root: Path) -> Iterator[str]:
    """Modules that define or import something and do not say in `__all__` what is public, or name what is not there."""
    for path in _modules(root, *SOURCES):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        body = [node for node in tree.body if not _is_docstring(node)]
        if not body or path.name == "__main__.py":
            continue
        exported = _exported(body)
        if exported is None:
            yield f"{path.relative_to(root)}: has no __all__"
            continue
        bound = set(_bound(body))
        if "__getattr__" in bound:  # a lazy module may offer any name
            continue
        for name in sorted(exported - bound):
            yield f"{path.relative_to(root)}: __all__ names '{name}', which the module does not define"


def _is_docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _exported(body: list[ast.stmt]) -> set[str] | None:
    for node in body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            return set(ast.literal_eval(node.value))
    return None


def _bound(body: list[ast.stmt]) -> Iterator[str]:
    """Names that a module binds at its top level, inside `if`, `try` and `with` too, but not in functions."""
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            yield from ((alias.asname or alias.name).split(".")[0] for alias in node.names)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            yield from (
                name.id for name in ast.walk(node) if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
            )
        else:
            for block in ("body", "orelse", "handlers", "finalbody"):
                for child in getattr(node, block, []):
                    yield from _bound(child.body if isinstance(child, ast.ExceptHandler) else [child])


def cloud_calls(root: Path) -> Iterator[str]:
    """Source that mentions ruckig's waypoint field: the community version sends such a motion to a cloud service."""
    for path in _modules(root, *SOURCES):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if CLOUD_FIELD in line:
                yield f"{path.relative_to(root)}:{number}: '{CLOUD_FIELD}' would call a cloud service"


def heavy_clients(root: Path) -> Iterator[str]:
    """What the client needs beyond zenoh, msgspec and numpy, at whatever depth: it must install slim in a container."""
    reached = {path: path for path in _modules(root, "gateway/client")}
    todo = list(reached)
    while todo:
        path = todo.pop()
        for name in _imported(path):
            if name.split(".")[0] in PACKAGES:
                for found in _files(root, name):
                    if found not in reached:
                        reached[found] = path
                        todo.append(found)
            elif name.split(".")[0] not in sys.stdlib_module_names | CLIENT_NEEDS:
                chain = [path]
                while reached[chain[-1]] != chain[-1]:
                    chain.append(reached[chain[-1]])
                yield f"{' <- '.join(str(p.relative_to(root)) for p in chain)}: needs '{name}', the client must not"


def import_circles(root: Path) -> Iterator[str]:
    """Modules that need each other, in functions too: of such a pair none can be read, or changed, by itself."""
    paths = {path.relative_to(root).with_suffix("").parts: path for path in _modules(root, *SOURCES)}
    named = {".".join(parts).removesuffix(".__init__"): path for parts, path in paths.items()}
    needs = {path: {named[name] for name in _imported(path) if name in named} - {path} for path in named.values()}
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        yield f"{' <- '.join(str(path.relative_to(root)) for path in error.args[1])}: a circle of imports"


def _files(root: Path, name: str) -> Iterator[Path]:
    """Files that run when a module is imported: its own and the `__init__.py` of each package above it."""
    parts = name.split(".")
    for end in range(1, len(parts) + 1):
        place = root.joinpath(*parts[:end])
        yield from (path for path in (place / "__init__.py", place.with_suffix(".py")) if path.exists())


def _imported(path: Path) -> Iterator[str]:
    """Dotted names that a module imports, wherever in it; `from a import b` counts as `a` and `a.b`."""
    todo: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            todo.extend(node.orelse)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names if node.module.split(".")[0] in PACKAGES)
        else:
            todo.extend(ast.iter_child_nodes(node))


def snippets(root: Path) -> Iterator[str]:
    """Python snippets of README and docs that do not compile."""
    for page in _pages(root):
        text = page.read_text(encoding="utf-8")
        for match in re.finditer(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
            line = text.count("\n", 0, match.start(1))
            try:
                ast.parse("\n" * line + match.group(1))
            except SyntaxError as error:
                yield f"{page.relative_to(root)}:{error.lineno}: {error.msg}"


def broken_links(root: Path) -> Iterator[str]:
    """Links of README and docs to files, or to headings of pages, that are not there."""
    for page in _pages(root):
        for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            name, _, anchor = target.partition("#")
            there = (page.parent / name).resolve() if name else page
            if target.startswith(("http://", "https://")):
                continue
            if not there.exists():
                yield f"{page.relative_to(root)}: nothing is at {target}"
            elif anchor and anchor not in _anchors(there):
                yield f"{page.relative_to(root)}: no heading is at {target}"


def _pages(root: Path) -> list[Path]:
    return [
        page
        for page in (root / "README.md", root / "CONTRIBUTING.md", *sorted((root / "docs").rglob("*.md")))
        if page.exists()
    ]


def _anchors(page: Path) -> set[str]:
    """Return what headings of a page are linked by."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def bare_threads(root: Path) -> Iterator[str]:
    """Threads that nobody would miss: each is started by `threads.supervised`, which tells when one ends unasked."""
    for path in _modules(root, *SOURCES):
        if path == root / THREADS:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            called = node.func if isinstance(node, ast.Call) else None
            name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
            if name in {"Thread", "Timer", "start_new_thread"}:
                yield f"{path.relative_to(root)}:{node.lineno}: '{name}' starts a thread by itself: use threads.supervised"


RULES = (
    long_modules,
    crowded_folders,
    banned_names,
    missing_exports,
    cloud_calls,
    heavy_clients,
    import_circles,
    bare_threads,
    snippets,
    broken_links,
)


def breaches(root: Path = ROOT) -> list[str]:
    """Return every breach of every rule."""
    return [breach for rule in RULES for breach in rule(root)]


if __name__ == "__main__":
    found = breaches()
    print("\n".join(found) or "house rules: kept")
    sys.exit(bool(found))
