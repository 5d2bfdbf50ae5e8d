"""Perturbations do what they say, the same each time; a stronger one is more of the same."""

import subprocess
import sys

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.creation import icosphere

from benchmark.datasets.catalogue import canonical_entry, open_dataset
from benchmark.datasets.perturbations import surface
from benchmark.datasets.perturbations.dataset import PERTURBATIONS
from benchmark.datasets.perturbations.overview import overview
from benchmark.datasets.perturbations.shortcuts import shortcuts
from benchmark.errors import ConfigurationError, DatasetError, UnsupportedShape
from benchmark.geometry.cleaning import extent_of
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline import recipes
from benchmark.protocols.galleries import galleries
from tests.toy import rod, write_rods

BALL = Mesh(np.asarray(icosphere(subdivisions=3).vertices), np.asarray(icosphere(subdivisions=3).faces))
HORSESHOE = rod(0.05, 4.5, rings=60)


def random():
    return np.random.default_rng(0)


def as_trimesh(mesh):
    return Trimesh(mesh.vertices, mesh.faces, process=False)


def test_noise_has_its_deviation_and_keeps_its_direction():
    moved = [surface.noise(BALL, amount, random()).vertices - BALL.vertices for amount in (0.01, 0.02)]
    np.testing.assert_allclose(moved[1], 2 * moved[0], atol=1e-12)
    assert moved[0].std() == pytest.approx(0.01 * extent_of(BALL), rel=0.05)


def test_each_hole_is_a_boundary_and_fewer_holes_are_among_more(monkeypatch):
    monkeypatch.setattr(surface, "HOLE_RADIUS", 0.1)
    few, more = (surface.holes(BALL, amount, random()) for amount in (2, 6))
    assert as_trimesh(few).euler_number == 2 - 2
    assert {*map(tuple, more.vertices)} < {*map(tuple, few.vertices)} < {*map(tuple, BALL.vertices)}


def test_a_shortcut_joins_the_ends_of_a_horseshoe_and_adds_a_handle_each():
    assert as_trimesh(HORSESHOE).euler_number == 2
    glued = shortcuts(HORSESHOE, 1, random())
    tube = as_trimesh(glued)
    assert tube.is_watertight and tube.is_winding_consistent
    assert tube.euler_number == 0
    added = glued.faces[HORSESHOE.n_faces - 2 :].ravel()
    along = np.unique(added) // 12  # ring of each corner
    assert along.min() < 15 and along.max() > 45  # from one arm to the other
    with pytest.raises(UnsupportedShape, match="comes near itself at 0 places"):
        shortcuts(rod(0.05, 0.0), 1, random())  # a straight rod has no two parts


def test_a_perturbed_set_is_the_same_each_time_and_its_recipe_tells_it_from_others(rods):
    clean = open_dataset(str(rods), None)
    one, same, other = (open_dataset(f"{rods}[noise={strength}]", None) for strength in (3, 3, 4))
    entry = one.entries[0]
    assert [e.identifier for e in one.entries] == [e.identifier for e in clean.entries]
    np.testing.assert_array_equal(one.load(entry).vertices, same.load(entry).vertices)
    assert one.recipe(entry) == same.recipe(entry)
    named = {dataset.recipe(entry) for dataset in (one, other)} | {clean.recipe(clean.entries[0])}
    assert len(named) == 3


def test_an_overview_shows_one_shape_as_the_perturbed_sets_have_it(rods):
    clean = open_dataset(str(rods), None)
    shape = clean.entries[2]
    shown = overview(clean, shape.identifier)
    assert {entry.subject for entry in shown.entries} == PERTURBATIONS.keys()
    (entry,) = (entry for entry in shown.entries if entry.identifier == "noise=4")
    expected = open_dataset(f"{rods}[noise=4]", None).load(shape)
    np.testing.assert_array_equal(shown.load(entry).vertices, expected.vertices)
    assert shown.sensor(shown.entries[-1]) is not None and shown.sensor(entry) is None
    assert overview(clean).shape == clean.entries[0]
    with pytest.raises(DatasetError, match="has no shape 'nobody'"):
        overview(clean, "nobody")


def test_what_a_camera_adds_is_part_of_the_recipe_of_the_view_alone(rods):
    sets = {name: open_dataset(f"{rods}[{name}]", None) for name in ("depth-noise=1", "depth-noise=2", "view-angle=5")}
    entry = sets["view-angle=5"].entries[0]
    frame = {"stage": "frame"}
    made = {str(recipes.shape_recipe(dataset, entry, "view", frame)) for dataset in sets.values()}
    assert len(made) == 3
    noisy = sets["depth-noise=1"]
    assert "sensor" not in recipes.shape_recipe(noisy, entry, "mesh", frame)
    clean = open_dataset(str(rods), None)
    turn = np.dot(sets["view-angle=5"].camera(entry).direction, clean.camera(clean.entries[0]).direction)
    assert np.cos(np.radians(60)) <= turn < 1


def test_what_a_clean_set_says_of_itself_is_said_of_its_changed_sets(rods, tmp_path):
    noise = open_dataset(f"{rods}[depth-noise=5]", None)
    for name in (f"{rods}[depth-noise=5][view-angle=1]", f"{rods}[depth-noise=5][view-angle=1][jitter=1]"):
        dataset = open_dataset(name, None)
        assert dataset.sensor(dataset.entries[0]) == noise.sensor(noise.entries[0])
    with pytest.raises(ConfigurationError, match="has depth noise already"):
        open_dataset(f"{rods}[depth-noise=5][depth-noise=1]", None)

    folder = write_rods(tmp_path / "posed", bends=(0.0, 1.0))
    (folder / "dataset.toml").write_text('[canonical_pose]\nthick = "1"\n')
    for change in ("", "[noise=1]", "[jitter=1]", "[noise=1][jitter=1]"):
        assert canonical_entry(open_dataset(f"{folder}{change}", None), "thick").identifier == "thick1"


def test_one_sided_surfaces_are_no_complete_ones_when_they_are_changed():
    for name in ("examples/depth[noise=1]", "examples/depth[jitter=1]", "examples/depth[view-angle=1][jitter=1]"):
        assert open_dataset(name, None).inputs == ("view",)
    (gallery,) = galleries([], ["examples/depth[noise=1]"])
    assert gallery.inputs == ()  # noise is one of complete surfaces
    with pytest.raises(ConfigurationError, match="which show one side of each shape"):
        gallery.check_input("mesh")


def test_an_edit_of_a_plugin_data_set_makes_its_changed_sets_new(tmp_path):
    """Each version is read by a process of its own, as an author runs it."""
    plugin = tmp_path / "own.py"
    lines = """
from benchmark.api.datasets import DatasetInfo, Entry, Mesh
from tests.toy import rod

class Own:
    info = DatasetInfo(name="own", title="Own")

    def entries(self):
        return [Entry(f"{s}{n}", s, str(n)) for s in ("thin", "thick") for n in range(2)]

    def load(self, entry):
        return rod(0.1, 1.0, 12, RINGS)
"""
    read = (
        "import json\n"
        "from benchmark.datasets.catalogue import open_dataset\n"
        "from benchmark.pipeline.recipes import source_recipe\n"
        "for change in ('[noise=1]', '[jitter=1]', '[noise=1][jitter=1]'):\n"
        f"    dataset = open_dataset('{plugin}:Own' + change, None)\n"
        "    print(json.dumps(source_recipe(dataset, dataset.entries[0])))"
    )
    printed = []
    for rings in ("8", "9", "9"):
        plugin.write_text(lines.replace("RINGS", rings))
        done = subprocess.run([sys.executable, "-c", read], capture_output=True, text=True, check=True)
        printed.append(done.stdout.splitlines())
    assert printed[1] == printed[2]
    assert not set(printed[0]) & set(printed[1])
