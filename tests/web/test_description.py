"""The API does what its own description says: asked by Schemathesis with whatever that allows, and what it does not."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from gateway.web.access import Keys
from gateway.web.server import application

schemathesis = pytest.importorskip("schemathesis", reason="no Schemathesis: pip install schemathesis")

TOKEN = "the-secret"
KNOWN = {"Authorization": f"Bearer {TOKEN}", "Host": "127.0.0.1:8700"}
NOWHERE = Path(tempfile.gettempdir()) / "no-gateway-is-here" / "gw.sock"
"""Without a gateway the answers are failures, which are described, too; what one answers, `tests/e2e/test_web.py` asks."""

schema = schemathesis.openapi.from_asgi(
    "/openapi.json", application(str(NOWHERE), Keys(token=TOKEN), 8700), headers=KNOWN
)


@schema.parametrize()
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_every_answer_is_one_that_the_description_has(case) -> None:
    """Status, media type and schema of each; no request, however odd, brings the server down."""
    away = schemathesis.checks.not_a_server_error  # 503 is what is right here
    case.call_and_validate(headers=KNOWN, excluded_checks=[away])
