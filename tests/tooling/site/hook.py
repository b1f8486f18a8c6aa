"""The hook of docs/site/mkdocs.yml: pages that are made while the site is built, and links that lead out of docs/.

* The reference is made from the code, the front page and those of the project from the files of the checkout.
* A link to a file that a page is made from leads to that page; in a checkout it leads to the file.
* A page that would load anything from elsewhere is a warning, which `bin/docs` makes an error.
"""

from __future__ import annotations

import logging
import posixpath
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from tests.tooling.site import client_page, commands_page, frames_page, protocol_page, settings_page

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

__all__ = ["GENERATED", "PAGES", "loads_elsewhere", "on_files", "on_page_markdown", "on_post_page", "with_links"]

ROOT = Path(__file__).resolve().parents[3]
LOG = logging.getLogger("mkdocs.plugins.gateway")

OUTPUT = "<!-- output -->\n```text"
"""How a block begins that shows what the one before it prints (`tests/e2e/pages.py`)."""

GENERATED: dict[str, Callable[[], str]] = {
    "reference/client.md": client_page.page,
    "reference/commands.md": commands_page.page,
    "reference/frames.md": frames_page.page,
    "reference/protocol.md": protocol_page.page,
    "reference/settings.md": settings_page.page,
}
"""Page -> what makes it."""

PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
    "configs/default.toml": "reference/settings.md",
    "gateway/api/protocol.py": "reference/protocol.md",
    "gateway/cli/command_line/arguments.py": "reference/commands.md",
    "gateway/client/__init__.py": "reference/client.md",
    "gateway/kinematics/frames.py": "reference/frames.md",
}
"""File of the checkout -> the page that is made from it."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are not in docs/."""
    from mkdocs.structure.files import File  # the tests of this module do without MkDocs

    made = {page: make() for page, make in GENERATED.items()}
    made |= {page: (ROOT / name).read_text(encoding="utf-8") for name, page in PAGES.items() if name.endswith(".md")}
    made["LICENSE"] = (ROOT / "LICENSE").read_text(encoding="utf-8")
    for uri, text in made.items():
        files.append(File.generated(config, uri, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to pages, what is folded be Markdown too, and what a block prints look like that."""
    uri = page.file.src_uri
    if uri == "index.md":
        page.meta["hide"] = ["navigation"]  # it would list this page alone
    markdown = markdown.replace("<details>", '<details markdown="1">')
    return with_links(markdown.replace(OUTPUT, "``` {.text .output}"), uri)


def with_links(markdown: str, uri: str) -> str:
    """Return a page with its links as they are on the site.

    Args:
        markdown: Of the page.
        uri: Of the page, relative to docs/.
    """
    home = next((name for name, page in PAGES.items() if page == uri and name.endswith(".md")), f"docs/{uri}")

    def there(match: re.Match[str]) -> str:
        path, anchor = match.groups(default="")
        target = posixpath.normpath(posixpath.join(posixpath.dirname(home), path))
        page = PAGES.get(target) or (target.removeprefix("docs/") if home != f"docs/{uri}" else None)
        return match.group() if page is None else f"]({posixpath.relpath(page, posixpath.dirname(uri) or '.')}{anchor})"

    return re.sub(r"\]\(((?!https?:)[^)#\s]+)(#[^)\s]*)?\)", there, markdown)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Warn of what would be loaded from elsewhere."""
    for found in loads_elsewhere(output):
        LOG.warning("%s would load %s", page.file.src_uri, found)
    return output


def loads_elsewhere(html: str) -> list[str]:
    """Return addresses of other hosts from which a page would load scripts, styles, fonts or pictures."""
    tags = re.findall(r"<(?:script|img|iframe|link)\b[^>]*>", html)
    loading = [tag for tag in tags if 'rel="canonical"' not in tag]
    return [address for tag in loading for address in re.findall(r"(?:src|href)=\"?((?:https?:)?//[^\"\s>]+)", tag)]
