"""What a stage costs is booked once, to the stage and to whoever used it."""

import mmap

import numpy as np
import pytest

from benchmark.pipeline.method_run import SharedStages
from benchmark.pipeline.storage.costs import _RESET, _STATUS, Meter

MIB = 2**20
measures_memory = pytest.mark.skipif(not (_STATUS.exists() and _RESET.exists()), reason="the system does not tell")


@pytest.fixture
def meter():
    return Meter()


def eat(mib):
    """Take memory of the system itself and give it back; where networks were trained, the C library would keep it."""
    with mmap.mmap(-1, mib * MIB, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as taken:
        for _ in range(mib):
            taken.write(b"\1" * MIB)


@measures_memory
def test_memory_is_what_a_stage_took_above_what_was_there(meter):
    held = np.ones(100 * MIB // 8)
    with meter.measured("large") as large:
        eat(200)
    with meter.measured("small") as small:
        eat(5)
    assert 195 <= large().peak_mib <= 215
    assert small().peak_mib <= 20
    assert large().seconds > small().seconds > 0
    assert held[0] == 1


@measures_memory
def test_memory_does_not_depend_on_which_method_came_first(meter):
    """What it takes to compute the shared matrix is charged to the second method as well, which finds it there."""

    def compute():
        eat(150)
        return {"distances": np.ones(20 * MIB // 8)}

    def peaks():
        shared, found = SharedStages(meter), []
        for method in ("first", "second"):
            with meter.measured(method) as cost:
                shared.get_or_compute("geodesics", {}, compute)
                eat(30)
            found.append(cost().peak_mib)
        return found

    # Pages of files that the system drops in between are taken for memory of the work: the least is the truth.
    first, second = np.min([peaks() for _ in range(3)], axis=0)
    assert 145 <= first <= 180
    assert second == pytest.approx(first, abs=15)
