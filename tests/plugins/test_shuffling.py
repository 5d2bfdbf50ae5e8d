"""Galleries as foreign code sees them: the matrix comes back in order, and the order follows from the items alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmark.pipeline.artefact_ranking import in_shuffled_order


def differences(items):
    sums = [sum(array.sum() for array in item.values()) if isinstance(item, dict) else item.sum() for item in items]
    return np.subtract.outer(sums, sums)


@given(st.lists(st.lists(st.integers(0, 3), max_size=3), min_size=1, max_size=12), st.booleans())
def test_the_matrix_is_that_of_the_items(numbers, named):
    arrays = [np.array(each, dtype=float) for each in numbers]  # copies and empty arrays among them
    items = [{"numbers": each, "more": each[:1]} for each in arrays] if named else arrays
    assert (in_shuffled_order(items, differences) == differences(items)).all()


def order_of(items):
    """The first number of each item in the order in which it is compared."""
    seen = []

    def compare(given_items):
        seen.extend(float(item[0]) for item in given_items)
        return np.zeros((len(given_items),) * 2)

    in_shuffled_order(items, compare)
    return seen


def test_the_order_follows_from_the_items_up_to_rounding():
    random = np.random.default_rng(0)
    items = list(random.standard_normal((40, 5)))
    order = order_of(items)
    assert order != [item[0] for item in items]
    assert order_of([items[place] for place in random.permutation(40)]) == order
    moved = order_of([item * (1 + 1e-13) for item in items])
    assert moved == pytest.approx(order, rel=1e-12)


def test_chance_decides_between_copies():
    """By their places in the gallery, copies would be told apart, and with them their classes."""
    count = 30
    found = set()
    for _ in range(3):
        matrix = in_shuffled_order(
            [np.ones(2)] * count, lambda items: np.tile(np.arange(len(items), dtype=float), (len(items), 1))
        )
        assert sorted(matrix[0]) == list(range(count))
        found.add(tuple(matrix[0]))
    assert len(found) == 3
