"""Fixtures of all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmark.threads import pin_threads

pin_threads()


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder that holds the official data sets; tests that need it are skipped where there is none."""
    named = os.environ.get("CANONICAL_FORMS_DATA", "")
    if not named or not (Path(named) / "tosca").is_dir():
        pytest.skip("needs TOSCA: set CANONICAL_FORMS_DATA to the folder that holds tosca/")
    return Path(named)
