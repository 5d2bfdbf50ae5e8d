import time

import numpy as np
import pytest

from benchmark.pipeline.storage.store import Store


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path)


def test_a_recipe_is_computed_once_and_keeps_its_cost(store):
    calls = []

    def compute():
        calls.append(1)
        time.sleep(0.05)
        return {"x": np.arange(3)}

    first, second = (store.get_or_compute({"a": 1}, compute) for _ in range(2))
    assert len(calls) == 1
    assert not first.was_cached
    assert second.was_cached
    assert second.cost == first.cost
    assert second.cost.seconds >= 0.05
    np.testing.assert_array_equal(second.arrays["x"], [0, 1, 2])
