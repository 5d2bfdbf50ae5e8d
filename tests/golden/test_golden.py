"""Golden files are those that the lock names, and cover all components; ``make golden`` makes all of them again."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

from benchmark.datasets.catalogue import CATALOGUE
from benchmark.datasets.perturbations.dataset import PERTURBATIONS
from benchmark.pipeline.storage.lock import edited_folders, read_lock
from benchmark.plugins import registry, scorers
from benchmark.results import open_results
from benchmark.source_code import ROOT
from tools.golden import results
from tools.golden.components import VARIANTS, components, folders_of
from tools.golden.inputs import GOLDEN
from tools.golden.results import compare, read_golden, run_component, version_of


def test_there_is_a_component_for_each_method_scorer_generated_set_and_change():
    generated = [name for name, source in CATALOGUE.items() if not source.folder and "[" not in name]
    wanted = {
        *(f"method/{name}" for name in registry.BUILT_IN),
        *(f"scorer/{name}" for name in scorers.BUILT_IN),
        *(f"data/{name}" for name in [*generated, "files", "frames"]),
        *(f"change/{name}" for name in [*PERTURBATIONS, "jitter"]),
    }
    assert {name for name in components() if name.startswith(("method/", "scorer/", "data/", "change/"))} == wanted


def test_the_variants_of_published_rows_are_parts_of_their_methods():
    """All but those that only name another training of the same network."""
    published = set(open_results(published=True).records()["method"])
    chosen = [re.fullmatch(r"([a-z-]+)\[(.*)\]", name) for name in published]
    trainings = ("training", "configuration=as_printed")
    variants = {(match[1], match[2]) for match in chosen if match and not match[2].startswith(trainings)}
    assert not {(base, inside) for base, inside in variants if inside not in VARIANTS.get(base, ())}


def test_the_lock_names_the_digest_of_each_golden_file_and_the_folders_of_its_component():
    locked = read_lock().components
    files = {str(path.relative_to(GOLDEN).with_suffix("")) for path in GOLDEN.rglob("*.npz")}
    assert {name for name in files if not name.startswith("inputs/")} == set(components())
    assert {name: locked[name] for name in components()} == {
        name: (version_of(read_golden(name)), folders_of(name)) for name in components()
    }


def test_the_code_is_that_by_which_the_golden_results_were_compared():
    assert dict(edited_folders()) == {}, "run make golden"


@pytest.mark.parametrize("name", ["preparation/mesh", "method/fast-mds", "measures"])
def test_a_component_makes_its_golden_results_again(name):
    assert compare(name, run_component(name)) == []


def test_an_array_that_moves_beyond_the_tolerance_is_named_with_how_far_it_moved():
    golden = read_golden("method/fast-mds")
    key = "fast-mds/closed/vertices"
    size = np.abs(golden[key]).max()
    moved = golden | {key: golden[key] + 1e-7 * size}
    assert [(each.array, round(each.difference / 1e-7, 3)) for each in compare("method/fast-mds", moved)] == [
        (key, 1.0)
    ]
    assert compare("method/fast-mds", golden | {key: golden[key] + 1e-9 * size}) == []


@pytest.mark.parametrize(
    "change", [lambda key: {}, lambda key: {key: np.array("InvalidMesh")}, lambda key: {"new/vertices": np.zeros(3)}]
)
def test_an_array_that_is_missing_new_or_another_refusal_has_moved(change):
    key = "gps/tetrahedron/refused"
    golden = {name: array for name, array in read_golden("method/gps").items() if name != key}
    assert compare("method/gps", golden | change(key))[0].difference == np.inf


def test_the_version_is_that_of_the_arrays_and_not_of_the_file(tmp_path, monkeypatch):
    golden = read_golden("change/jitter")
    monkeypatch.setattr(results, "GOLDEN", tmp_path)
    results.write_golden("change/jitter", dict(reversed(golden.items())))
    assert version_of(read_golden("change/jitter")) == version_of(golden)
    assert version_of(golden | {"revision": np.array(1)}) != version_of(golden)


def test_an_unknown_component_is_refused_and_the_known_ones_are_named():
    command = [sys.executable, "-m", "tools.golden", "--accept", "method/classic"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "unknown component method/classic" in done.stderr
    assert "method/classic-mds" in done.stderr
