"""A dask cluster of real processes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def notes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which methods of the tests note their processes on the cluster."""
    return tmp_path_factory.mktemp("notes")


@pytest.fixture(scope="module")
def cluster(notes: Path) -> Iterator[str]:
    """The address of a scheduler with two workers under nannies, for all tests of a module: one
    that was killed starts again.
    """
    distributed = pytest.importorskip(
        "distributed", reason="needs dask: pip install 'dask[distributed]'"
    )
    options = {
        "n_workers": 2,
        "threads_per_worker": 1,
        "dashboard_address": None,
        "local_directory": notes,
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAULTS", str(notes))
        with distributed.LocalCluster(**options) as cluster:
            yield cluster.scheduler_address
