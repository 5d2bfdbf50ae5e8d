"""Official sets made up once for all tests, and copies of them to be damaged."""

import os
import shutil

import pytest

from benchmark.datasets.catalogue import CATALOGUE
from benchmark.datasets.official import SETS
from tests.datasets.official.layouts import make, with_made_members


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
    """Copies a set by links, so replace a file rather than write to it; returns its folder, below a
    root of its own.
    """
    names = {name: known.folder for name, known in SETS.items()}
    return lambda name: shutil.copytree(
        sets / names[name], tmp_path / names[name], copy_function=os.link
    )
