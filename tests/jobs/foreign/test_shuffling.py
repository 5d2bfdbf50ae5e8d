"""Shuffled galleries: the matrix comes back in order, and the order depends on every name."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from benchmark.jobs.foreign.shuffling import in_shuffled_order, shuffled


@given(st.lists(st.text(max_size=3), min_size=1, max_size=12, unique=True))
def test_the_matrix_is_that_of_the_items(names):
    items = [len(name) + 10.0 * number for number, name in enumerate(names)]

    def differences(values):
        return np.subtract.outer(values, values)

    assert (in_shuffled_order(names, items, differences) == differences(items)).all()


def test_another_name_makes_another_order():
    names = [f"cat{number}" for number in range(40)]
    order = shuffled(names)
    assert sorted(order) == sorted(names) != order
    others = [*names[:-1], "dog"]
    assert [name for name in shuffled(others) if name != "dog"] != [name for name in order if name != names[-1]]
