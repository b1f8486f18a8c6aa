"""Parquet as LeRobot reads it. Libraries: pyarrow. The same tables give the same bytes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gateway.recording.bag_writer import needed

__all__ = ["columns", "pyarrow", "read", "write"]

pyarrow = partial(needed, extra="dataset")
"""Return pyarrow, or a module of it; as `needed`."""


def columns(tables: Mapping[str, npt.NDArray[np.generic]]) -> Any:  # noqa: ANN401
    """Return an Arrow table: vectors, shape (n, dimensions), become lists of fixed size, shape (n,) becomes numbers."""
    pa = pyarrow("pyarrow")
    arrays = []
    for table in tables.values():
        flat = pa.array(np.ascontiguousarray(table).reshape(-1))
        arrays.append(flat if table.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, table.shape[1]))
    return pa.Table.from_arrays(arrays, names=list(tables))


def write(table: Any, path: Path, index: str = "") -> None:  # noqa: ANN401
    """Write an Arrow table.

    Args:
        table: It.
        path: Where; its folder is made.
        index: Column that pandas shall take for the labels of the rows; empty for none.
    """
    if index:
        facts = {"index_columns": [index], "column_indexes": [], "columns": _pandas_columns(table), "creator": {}}
        table = table.replace_schema_metadata({"pandas": json.dumps(facts)})
    path.parent.mkdir(parents=True, exist_ok=True)
    pyarrow("pyarrow.parquet").write_table(table, path, compression="zstd", store_schema=True)


def read(path: Path) -> Any:  # noqa: ANN401
    """Return an Arrow table.

    Raises:
        OSError: It cannot be read.
        pyarrow.ArrowException: It is not Parquet.
    """
    return pyarrow("pyarrow.parquet").read_table(path)


def _pandas_columns(table: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    kinds = {"int64": "int64", "string": "unicode"}
    return [
        {
            "name": field.name,
            "field_name": field.name,
            "pandas_type": kinds.get(str(field.type), "object"),
            "numpy_type": "int64" if str(field.type) == "int64" else "object",
            "metadata": None,
        }
        for field in table.schema
    ]
