"""Statistics of before count for the same numbers alone, and are never needed."""

import numpy as np
import pytest

from benchmark.report.statistics import remembered as module
from benchmark.report.statistics.remembered import remembered

ARRAY = np.arange(6.0).reshape(2, 3)


@pytest.fixture
def ask(tmp_path, monkeypatch):
    """Ask as a new process would; tells whether the answer was found anew."""
    monkeypatch.setattr(module, "_file", lambda: tmp_path / "statistics.json")

    def asked(array=ARRAY, others=("a",), *, new_process=True):
        calls = []
        if new_process:
            module._known.cache_clear()
        found = remembered([array], list(others), lambda: calls.append(1) or [0.1 + 0.2, float("nan"), array.sum()])
        np.testing.assert_array_equal(found, [0.1 + 0.2, np.nan, array.sum()])
        return bool(calls)

    return asked


def test_what_was_found_is_not_looked_for_again(ask):
    assert ask()
    assert not ask()


@pytest.mark.parametrize("change", [{"array": ARRAY + 1e-12}, {"array": ARRAY.reshape(3, 2)}, {"others": ("b",)}])
def test_other_numbers_are_looked_at_anew(ask, change):
    ask()
    assert ask(**change)
    assert not ask(), "what was known before stays known"


def test_a_damaged_file_costs_time_alone(ask, tmp_path):
    ask()
    path = tmp_path / "statistics.json"
    path.write_text(path.read_text().replace("0.3", "0.4"))
    assert ask()
    assert not ask()
    path.unlink()
    path.mkdir()  # it can be neither read nor written
    assert ask()


def test_the_oldest_go_when_there_are_many(ask, monkeypatch):
    monkeypatch.setattr(module, "_MOST", 2)
    for others in ("a", "b", "a", "c"):
        ask(others=(others,), new_process=False)
    assert not ask(others=("a",))
    assert ask(others=("b",))
