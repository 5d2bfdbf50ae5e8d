"""A results folder with a small run in it."""

import pytest

from benchmark.report.results import Results, open_results
from tests.runs.toy import run_toy
from tests.toy import write_rods


@pytest.fixture(scope="session")
def results(tmp_path_factory) -> Results:
    """Results of three methods on bent rods."""
    folder = tmp_path_factory.mktemp("results")
    run_toy(
        write_rods(folder / "rods", bends=(0.0, 1.2)), folder, "gps", "identity", "surface-area"
    )
    return open_results(folder)
