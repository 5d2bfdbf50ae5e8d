"""One run, and its bundle, for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.bundles.made import SCORER, run, where
from tests.verbs import call


@pytest.fixture(scope="session")
def ran(tmp_path_factory, server_of_workers) -> Path:
    """A folder with a data set, a plug-in, results, and the bundle of its method."""
    folder = tmp_path_factory.mktemp("bundles")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("benchmark.execution.processes.process._start", server_of_workers)
        run(folder)
    words = ("submit", "flat", "--scorer", SCORER, "--forms", "--author", "Ada <b>", *where(folder))
    call(*words, "-o", folder / "flat.zip")
    return folder
