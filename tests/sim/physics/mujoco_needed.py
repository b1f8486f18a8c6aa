"""Why tests with physics are skipped where they are: `mujoco = pytest.importorskip("mujoco", reason=REASON)`."""

from __future__ import annotations

__all__ = ["REASON"]

REASON = "MuJoCo is not installed: pip install -e '.[sim]'"
