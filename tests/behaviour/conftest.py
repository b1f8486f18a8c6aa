"""What the core says in these tests stands in `tests/sentences.txt`."""

from tests.sentences import only_known_sentences, pytest_sessionfinish

__all__ = ["only_known_sentences", "pytest_sessionfinish"]
