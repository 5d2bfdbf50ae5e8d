"""A form for any closed surface in any place, and a named refusal for everything else."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from safetensors.torch import save
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import Shape, UnsupportedShape
from benchmark.api.learning import CARD, WEIGHTS, ChecksOptions, Learner
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh
from benchmark.methods.conformance.shapes import awkward
from learned.template import configuration, model, search
from learned.template.methods import ImplicitTemplate
from learned.template.network import build_auto_decoder
from learned.template.search import Round
from learned.template.training import TemplatePlan
from learned.training.checkpoint import Progress
from learned.training.fitting import Fitting
from learned.training.loop import Trained
from learned.training.machine import Machine
from tests.geometry.surfaces import limbed_body, relabelled
from tests.learned.template.toy import TOY, rod, rods
from tests.learned.toy import quiet


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the toy template a name, and search shortly."""
    monkeypatch.setitem(configuration.TEMPLATES, TOY.name, TOY)
    monkeypatch.setattr(model, "ROUNDS", (Round(24, 32, 4), Round(2, 64, 6)))
    monkeypatch.setattr(model, "RAYS", 64)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A model whose weights nobody trained, but whose deformation is not zero."""
    network = build_auto_decoder(TOY, 1, 0).fields
    with torch.no_grad():
        network.deformation.last.weight.normal_(generator=torch.Generator().manual_seed(0), std=0.05)
    trained = Trained(network, Progress(1, 2, 0.0, ({"step": 1.0},)), "float32", {})
    fitting = Fitting(
        kind="template",
        name="toy",
        described=TOY.described(),
        plan=TemplatePlan(),
        words="",
        training_data=rods(),
        seed=0,
        train=lambda *_: trained,
        load=lambda _: None,  # so that each test is the first to read the files
    )
    place = tmp_path / "template-toy-seed0"
    fitting.into(place, Machine(threads=1), quiet)
    return place


@pytest.fixture
def method(folder: Path) -> ImplicitTemplate:
    return ImplicitTemplate(configuration="toy").load(folder)


def form(method: ImplicitTemplate, mesh: Mesh) -> np.ndarray:
    return method.canonicalise(Shape(identifier="x", mesh=mesh)).vertices


def test_it_is_a_learner_that_checks_its_options() -> None:
    assert isinstance(ImplicitTemplate(), Learner)
    assert isinstance(ImplicitTemplate(), ChecksOptions)
    assert ImplicitTemplate().model_name == "template-plain-seed0"


def test_the_form_has_the_vertices_of_the_shape_unit_area_and_notes(method: ImplicitTemplate) -> None:
    found = method.canonicalise(Shape(identifier="x", mesh=rod(1.0)))
    assert found.vertices.shape == rod().vertices.shape
    assert found.mesh.area == pytest.approx(1)
    assert set(found.notes) == {"distance_error", "correction", "code_norm", "steps"}
    assert found.notes["distance_error"] > 0


def test_upside_down_or_elsewhere_or_larger_or_renumbered_the_form_is_the_same(method: ImplicitTemplate) -> None:
    mesh = limbed_body(3)
    expected = pdist(form(method, mesh))
    renumbered, new = relabelled(mesh)
    renumbered = Mesh(renumbered.vertices, renumbered.faces[::-1])
    np.testing.assert_allclose(pdist(form(method, renumbered)[new]), expected, atol=1e-5)
    for angles in ([np.pi, 0, 0], [0.4, -1.1, 2.3]):
        turn = Rotation.from_euler("xyz", angles).as_matrix()
        moved = mesh.with_vertices(3 * mesh.vertices @ turn.T + [1, 2, 3])
        np.testing.assert_allclose(pdist(form(method, moved)), expected, atol=1e-5)


def test_two_searches_find_the_same_bits(method: ImplicitTemplate) -> None:
    assert np.array_equal(form(method, rod(1.0)), form(method, rod(1.0)))


def test_a_candidate_does_not_depend_on_the_others(folder: Path) -> None:
    network, _ = model.load_template(folder)
    points, distances = torch.randn(2, 9, 3, dtype=torch.float64), torch.randn(2, 9, dtype=torch.float64)
    codes, turns = torch.zeros(2, TOY.code_size, dtype=torch.float64), torch.eye(3, dtype=torch.float64).expand(2, 3, 3)
    start = search.Found(codes, turns, codes.new_zeros(len(codes)))
    both = search.descended(network, (points, distances), start, 1e-3, 5)
    second = search.Found(codes[1:], turns[1:], start.errors[1:])
    alone = search.descended(network, (points[1:], distances[1:]), second, 1e-3, 5)
    torch.testing.assert_close(both.codes[1:], alone.codes)
    torch.testing.assert_close(both.turns[1:], alone.turns)
    torch.testing.assert_close(both.turns @ both.turns.transpose(1, 2), turns)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_points_without_a_surface_are_refused(method: ImplicitTemplate) -> None:
    cloud = np.random.default_rng(0).normal(size=(50, 3))
    with pytest.raises(UnsupportedShape, match="no area"):
        form(method, Mesh(cloud, np.empty((0, 3), dtype=np.int32)))
    with pytest.raises(UnsupportedShape, match="no area"):
        form(method, Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))
    with pytest.raises(UnsupportedShape, match="scale the mesh"):
        form(method, rod().with_vertices(rod().vertices * 1e200))


def test_what_is_no_rod_and_what_has_fifty_vertices_get_finite_forms(method: ImplicitTemplate) -> None:
    box, ball = trimesh.creation.box((1, 2, 3)), trimesh.creation.uv_sphere(1, [6, 10])
    for found in (box, ball):
        assert np.isfinite(form(method, Mesh(found.vertices, found.faces))).all()


def test_awkward_surfaces_are_treated_or_refused_by_name(method: ImplicitTemplate) -> None:
    for name, mesh in awkward().items():
        try:
            assert np.isfinite(form(method, mesh)).all(), name
        except UnsupportedShape as reason:
            assert reason.hint


@pytest.mark.slow
def test_half_a_million_vertices_are_deformed(method: ImplicitTemplate) -> None:
    ball = trimesh.creation.icosphere(subdivisions=8)
    assert len(ball.vertices) > 500_000
    assert np.isfinite(form(method, Mesh(ball.vertices * [1, 2, 3], ball.faces))).all()


def test_without_a_model_it_says_so() -> None:
    with pytest.raises(ConfigurationError, match=r"card\.json cannot be read"):
        form(ImplicitTemplate(training="nowhere"), rod())


def test_foreign_and_damaged_weights_are_refused(folder: Path) -> None:
    method = ImplicitTemplate(configuration="toy")
    content, card = (folder / WEIGHTS).read_bytes(), json.loads((folder / CARD).read_text())
    (folder / WEIGHTS).write_bytes(content[:-1])
    with pytest.raises(ConfigurationError, match="has digest"):
        method.load(folder)
    for foreign, told in ((b"nonsense", "is damaged"), (save({"a": torch.zeros(1)}), "another configuration")):
        (folder / WEIGHTS).write_bytes(foreign)
        (folder / CARD).write_text(json.dumps(card | {"digest": hashlib.sha256(foreign).hexdigest()}))
        with pytest.raises(ConfigurationError, match=told):
            method.load(folder)


def test_a_model_of_another_kind_is_not_loaded(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="not that of a template"):
        ImplicitTemplate().check_card({"streamed": {}}, tmp_path)
    with pytest.raises(ConfigurationError, match="another kind of network"):
        ImplicitTemplate().check_card({"template": {"name": "plain"}}, tmp_path)
    described = replace(TOY, name="authors").described()
    with pytest.raises(ConfigurationError, match="holds 'authors', not 'plain'"):
        ImplicitTemplate().check_card({"template": described}, tmp_path)
