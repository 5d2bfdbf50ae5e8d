"""A dask cluster of real processes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Return the address of a scheduler with two workers under nannies."""
    distributed = pytest.importorskip(
        "distributed", reason="needs dask: pip install 'dask[distributed]'"
    )
    monkeypatch.setenv("FAULTS", str(tmp_path))
    options = {
        "n_workers": 2,
        "threads_per_worker": 1,
        "dashboard_address": None,
        "local_directory": tmp_path,
    }
    with distributed.LocalCluster(**options) as cluster:
        yield cluster.scheduler_address
