"""Fixtures that tests of recordings share with those of datasets and commands."""

from tests.cli.conftest import shell
from tests.dataset.conftest import layout

__all__ = ["layout", "shell"]
