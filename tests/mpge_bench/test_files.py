"""Tables that are read whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mpge_bench.files import LARGEST, parquet_table


def test_a_table_is_read_and_a_swollen_one_is_not(tmp_path: Path) -> None:
    table = pd.DataFrame({"time": [0.0, 0.1], "name": ["a", "b"]})
    table.to_parquet(tmp_path / "a.parquet")
    pd.testing.assert_frame_equal(parquet_table(tmp_path / "a.parquet"), table)
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(LARGEST // 8 + 1, np.int8)), pa.array([0.0]))
    pq.write_table(pa.table({f"c{index}": column for index in range(8)}), tmp_path / "b.parquet")
    assert (tmp_path / "b.parquet").stat().st_size < 2**20
    with pytest.raises(ValueError, match="50000008 values, more than 50000000"):
        parquet_table(tmp_path / "b.parquet")
