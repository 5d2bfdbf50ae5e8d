"""Official sets made up once for all tests, and copies of them to be damaged."""

import pytest

from benchmark.datasets.catalogue import CATALOGUE
from benchmark.datasets.official import SETS
from tests.datasets.official.layouts import copy, make, with_made_members


@pytest.fixture(scope="session")
def sets(tmp_path_factory):
    """All official sets in their layouts, made once; no test may write to them."""
    root = tmp_path_factory.mktemp("official")
    for name in SETS.keys() - {"tosca"}:
        make(name, root)
    return root


@pytest.fixture(autouse=True)
def _made_lists(monkeypatch):
    for name in ("shrec10", "shrec11"):
        made = with_made_members(SETS[name])
        monkeypatch.setitem(SETS, name, made)
        monkeypatch.setitem(CATALOGUE, name, made)


@pytest.fixture
def damaged(sets, tmp_path):
    """Copies a set so that it can be damaged; returns its folder, below a data root of its own."""
    return lambda name: copy(sets / SETS[name].folder, tmp_path / SETS[name].folder)
