"""A tiny trained model, and the settings of torch as they were before."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from learned import models
from learned.fitting import train
from learned.methods import Learned
from tests.learned.toy import OPTIONS, TINY, quiet, toy_data


@contextmanager
def tiny_on_one_thread() -> Iterator[None]:
    """Name the tiny network; leave neither threads nor the treatment of denormal numbers to other
    tests.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(models.CONFIGURATIONS, TINY.name, TINY)  # type: ignore[arg-type]
        yield
    torch.set_num_threads(threads)
    torch.set_flush_denormal(False)


@pytest.fixture(autouse=True)
def settings_of_torch() -> Iterator[None]:
    with tiny_on_one_thread():
        yield


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished model, trained in one go; to be read only."""
    folder = tmp_path_factory.mktemp("models") / "tiny-seed0"
    with tiny_on_one_thread():
        train(TINY.name, 0, toy_data(), folder, OPTIONS, quiet)
    return folder


@pytest.fixture
def method(trained: Path) -> Learned:
    """The method with the tiny model."""
    tiny = Learned()
    object.__setattr__(tiny, "configuration", TINY.name)
    return tiny.load(trained)
