"""A tiny trained model, and the settings of torch as they were before."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from learned.paired import configuration
from learned.paired.fitting import fit
from tests.learned.toy import OPTIONS, TINY, quiet, toy_data


@contextmanager
def on_one_thread() -> Iterator[None]:
    """Leave neither threads nor the treatment of denormal numbers to other tests."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
    torch.set_flush_denormal(False)


@pytest.fixture(scope="package", autouse=True)
def settings_of_torch() -> Iterator[None]:
    """Compute on one thread."""
    with on_one_thread():
        yield


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the tiny configuration a name on the command line."""
    monkeypatch.setitem(configuration.CONFIGURATIONS, TINY.name, TINY)


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished model, trained in one go; to be read only."""
    folder = tmp_path_factory.mktemp("models") / "tiny-seed0"
    with on_one_thread(), pytest.MonkeyPatch.context() as patch:
        patch.setitem(configuration.CONFIGURATIONS, TINY.name, TINY)
        fit(TINY.name, 0, toy_data(), folder, OPTIONS, quiet)
    return folder
