"""A results folder with a small run in it."""

from pathlib import Path

import pytest

from benchmark.protocols.galleries import galleries
from benchmark.registry import select
from benchmark.report.results import Results, open_results
from benchmark.runs.planning import plan
from benchmark.runs.runner import run
from tests.toy import write_rods


@pytest.fixture(scope="session")
def results(tmp_path_factory) -> Results:
    """Results of three methods on bent rods."""
    folder = tmp_path_factory.mktemp("results")
    write_rods(folder / "rods")
    names = ["gps", "identity", "surface-area"]
    planned = plan(galleries([], [str(folder / "rods")]), ["mesh"], select(names, ()), folder, named=True)
    for _ in run(planned, folder, size=0, timeout=600):
        pass
    return open_results(folder)


@pytest.fixture(scope="session")
def folder(results) -> Path:
    """Its folder."""
    return results.folder
