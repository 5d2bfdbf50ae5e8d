"""Fixtures of all tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

from benchmark.threads import pin_threads

pin_threads()

# How long an example takes says nothing of the code on a machine that has other work, too.
settings.register_profile("suite", deadline=None)
settings.load_profile("suite")

# Runs that the tests interrupt inherit what is ignored here, as under nohup and in the background of a script.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder that holds the official data sets; tests that need it are skipped where there is none."""
    named = os.environ.get("CANONICAL_FORMS_DATA", "")
    if not named or not (Path(named) / "tosca").is_dir():
        pytest.skip("needs TOSCA: set CANONICAL_FORMS_DATA to the folder that holds tosca/")
    return Path(named)
