"""Fixtures of all tests."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from benchmark.kernel_cache import drop_stale_kernels
from benchmark.machine import pin_threads

pin_threads()

# Processes that tests start find this checkout from anywhere, whatever is installed.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")))
)

# Processes of xdist know the width of the terminal, at which rows would be wrapped.
os.environ.pop("COLUMNS", None)


def pytest_configure(config: pytest.Config) -> None:
    """Let no test run a kernel that was compiled before an edit; with several processes, the first
    one sees to it.
    """
    if not hasattr(config, "workerinput"):
        drop_stale_kernels()


#: Files with the longest of the slow tests, the longest first.
LONGEST = (
    "test_installed.py",
    "test_examples.py",
    "test_faults.py",
    "test_processes.py",
    "test_statistics.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the longest files begin first, so that no process is left alone with one at the end."""
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


# Thousands of tests and their modules stay to the end: looking for garbage among them takes an
# eighth of the time.
gc.set_threshold(20_000, 20, 50)


def pytest_collection_finish() -> None:
    """Leave what was collected out of every later search for garbage."""
    gc.freeze()


# How long an example takes says nothing of the code on a machine that has other work, too.
settings.register_profile("suite", deadline=None)
settings.load_profile("suite")

# Runs that the tests interrupt inherit what is ignored here, as under nohup and in the background
# of a script.
for number, handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)


@pytest.fixture
def in_this_process() -> Iterator[None]:
    """Let runs that a test starts do everything in this process, which is seconds faster."""
    from tests.runs.toy import without_processes

    with without_processes():
        yield


@pytest.fixture(scope="module")
def rods(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rods of two builds, straight and bent, for all tests of a module; none may write to them."""
    from tests.toy import write_rods

    return write_rods(tmp_path_factory.mktemp("data") / "rods", bends=(0.0, 1.0))


@pytest.fixture(scope="session")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of depth images of two classes; none may write to it."""
    from tests.datasets.test_frames import write_frames

    return write_frames(tmp_path_factory.mktemp("data") / "frames")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder that holds the official data sets; tests that need it are skipped where there is
    none.
    """
    named = os.environ.get("CANONICAL_FORMS_DATA", "")
    if not named or not (Path(named) / "tosca").is_dir():
        pytest.skip("needs TOSCA: set CANONICAL_FORMS_DATA to the folder that holds tosca/")
    return Path(named)
