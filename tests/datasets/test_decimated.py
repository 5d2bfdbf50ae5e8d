"""Sets that another program decimates: near the surface, closed as it was, whatever the unit, and rows of their own."""

import igl
import numpy as np
import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.datasets.catalogue import is_present, open_dataset
from benchmark.datasets.decimated import DECIMATIONS, Decimated, decimated, decimated_name, parsed_decimation
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.geometry.cleaning import clean
from benchmark.geometry.preparation import prepare
from benchmark.pipeline import recipes
from benchmark.protocols.galleries import galleries
from tests.geometry.surfaces import limbed_body


def test_names_are_read_as_they_are_written():
    assert parsed_decimation(decimated_name("animals[noise=3]", "libigl")) == ("animals[noise=3]", "libigl")
    assert parsed_decimation("tosca") is parsed_decimation("tosca[noise=1]") is None
    assert is_present("humans[decimation=libigl]", None)
    assert not is_present("tosca[decimation=libigl]", None)
    with pytest.raises(ConfigurationError, match="unknown decimation 'libgl'.*libigl"):
        open_dataset("humans[decimation=libgl]", None)


@pytest.mark.parametrize("program", DECIMATIONS)
def test_a_decimated_body_stays_near_and_closed_in_every_unit(program):
    if program == "fast-simplification":
        pytest.importorskip("fast_simplification")
    body = limbed_body(4)  # 2562 vertices
    coarse = decimated(body, program, 1000)
    prepared, root = prepare(coarse), np.sqrt(body.area)
    assert prepared.report["boundary_edges"] == 0
    assert (prepared.mesh.n_vertices, prepared.report["euler_characteristic"]) == (1000, 2)
    distances = np.sqrt(
        igl.point_mesh_squared_distance(body.vertices, coarse.vertices, coarse.faces.astype(np.int64))[0]
    )
    assert distances.max() < 0.01 * root
    in_microns = decimated(body.with_vertices(2.0**20 * body.vertices), program, 1000)
    np.testing.assert_allclose(in_microns.vertices, 2.0**20 * coarse.vertices, rtol=1e-6, atol=1e-6)
    assert decimated(coarse, program, 1000) is coarse
    report = clean(coarse)[1]
    assert (report.non_manifold_edges, report.duplicate_faces) == (0, 0)


def test_a_program_that_is_not_installed_is_named_before_any_work(monkeypatch, rods):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DatasetError, match="pip install fast-simplification"):
        open_dataset(decimated_name(str(rods), "fast-simplification"), None)


def test_programs_have_keys_of_their_own_and_all_else_is_that_of_the_clean_set(rods):
    clean_set = open_dataset(str(rods), None)
    sets = [clean_set, *(Decimated(clean_set, program) for program in DECIMATIONS)]
    keys = {str(recipes.source_recipe(dataset, entry)) for dataset in sets for entry in dataset.entries}
    assert len(keys) == 3 * len(clean_set.entries)
    entry = sets[1].entries[0]
    assert sets[1].camera(entry) == clean_set.camera(entry)
    assert [dataset.identifier for dataset in sets[1].entries] == [dataset.identifier for dataset in clean_set.entries]


def test_a_decimated_set_has_complete_surfaces_and_a_table_of_its_own(rods, tmp_path):
    name = decimated_name(str(rods), "libigl")
    (gallery,) = galleries([], [name])
    assert (gallery.name, gallery.table.identifier, gallery.inputs) == (*2 * ["rods[decimation=libigl]"], ("mesh",))
    words = ["plan", "-d", name, "-m", "pca", "--results", str(tmp_path)]
    assert "rods[decimation=libigl] mesh pca" in CliRunner().invoke(cli, words).output
    with pytest.raises(ConfigurationError, match="has no views"):
        gallery.check_input("view")
