"""A training of the field is the same however it is stopped, and its model treats any shape or says why not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from benchmark.api.contracts import Mesh, Shape, UnsupportedShape
from benchmark.api.learning import CARD, WEIGHTS, Learner, read_card
from benchmark.errors import ConfigurationError, InvalidMesh, TrainingError
from benchmark.plugins import registry
from benchmark.plugins.conformance.cases import MethodCase
from benchmark.plugins.conformance.checks import OF_METHODS_AND_SCORERS
from learned.field import configuration, fitting, training
from learned.field.fitting import fit
from learned.field.methods import DeformationField
from learned.training.checkpoint import CHECKPOINT
from tests.geometry.surfaces import flat_grid, joined, limbed_body
from tests.learned.field.toy import OPTIONS, TOY, Paddles, bent_spheroid, paddles
from tests.learned.streamed.toy import REFUSED, Ellipsoids, settle, toy_stream, trained_toy
from tests.learned.toy import files, misfit, quiet


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    settle(monkeypatch, configuration.FIELDS, TOY, training)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished toy model."""
    folder = tmp_path_factory.mktemp("models") / "field-toy-seed0"
    return trained_toy(folder, configuration.FIELDS, TOY, training, fit, OPTIONS)


def method(folder: Path) -> DeformationField:
    return DeformationField(configuration="toy").load(folder)


def shape_of(mesh: Mesh) -> Shape:
    return Shape(identifier="x", mesh=mesh)


def test_a_finished_model_has_weights_a_card_and_a_history(finished: Path) -> None:
    assert files(finished) == {WEIGHTS, CARD, "history.csv"}
    card = read_card(finished)
    assert card["field"] == TOY.described()
    assert card["bodies"] == 32
    assert card["extra_data"] is True
    assert {"validation position error", "validation edge loss", "validation isometry loss"} <= set(card["final"])


class Broken(Ellipsoids):
    """Ellipsoids with NaN in the seventh batch."""

    def surfaces(self, number, bodies):
        made = super().surfaces(number, bodies)
        if number == 7:
            made.posed[:] = np.nan
        return made


def test_a_training_that_is_stopped_goes_on_and_ends_with_the_same_weights(tmp_path: Path, finished: Path) -> None:
    with pytest.raises(TrainingError, match="batch 7 cannot be made: .*NaN"):
        fit("toy", 0, toy_stream(Broken()), tmp_path, OPTIONS, quiet)
    assert files(tmp_path) == {CHECKPOINT}
    messages: list[str] = []
    fit("toy", 0, toy_stream(), tmp_path, OPTIONS, messages.append)
    assert "going on after step 7 of 16" in messages
    assert (tmp_path / WEIGHTS).read_bytes() == (finished / WEIGHTS).read_bytes()


def test_options_that_do_not_fit_are_refused_before_data_is_made() -> None:
    own: Any = [({"resolution": 64}, "leave --resolution out"), ({"learning_rate": 0}, "learning_rate")]
    for options, message in REFUSED + own:
        with pytest.raises(ConfigurationError, match=message):
            fitting.checked_plan("toy", options)
        with pytest.raises(ConfigurationError, match=message):
            DeformationField().check_options(options)


# The model ---------------------------------------------------------------------------------------------------------


def copied(finished: Path, to: Path) -> Path:
    to.mkdir()
    for name in (WEIGHTS, CARD):
        (to / name).write_bytes((finished / name).read_bytes())
    return to


def test_damaged_and_foreign_weights_are_refused_by_name(finished: Path, tmp_path: Path) -> None:
    damaged = copied(finished, tmp_path / "damaged")
    (damaged / WEIGHTS).write_bytes((finished / WEIGHTS).read_bytes()[:-1])
    with pytest.raises(ConfigurationError, match="digest"):
        method(damaged)
    (damaged / WEIGHTS).unlink()
    with pytest.raises(ConfigurationError, match="cannot be read"):
        method(damaged)

    foreign = copied(finished, tmp_path / "foreign")
    card = read_card(foreign)
    (foreign / CARD).write_text(json.dumps({**card, "field": replace(TOY, width=48).described()}))
    with pytest.raises(ConfigurationError, match="belong to another configuration than 'toy'"):
        method(foreign)
    (foreign / CARD).write_text(json.dumps({**card, "field": {**TOY.described(), "heads": 3}}))
    with pytest.raises(ConfigurationError, match="width 32 for 3 heads"):
        method(foreign)
    with pytest.raises(ConfigurationError, match="holds 'toy', not 'plain'"):
        DeformationField().load(finished)
    with pytest.raises(ConfigurationError, match="not that of a deformation field"):
        DeformationField().check_card({"streamed": {}}, tmp_path)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        DeformationField(training="nowhere").canonicalise(shape_of(bent_spheroid()[1]))


def test_the_method_keeps_the_triangles_and_answers_alike_inside_out(finished: Path) -> None:
    assert isinstance(DeformationField(), Learner)
    loaded = method(finished)
    mesh = limbed_body(3)
    form = loaded.canonicalise(shape_of(mesh))
    assert form.mesh.area == pytest.approx(1)
    assert np.array_equal(form.faces, mesh.faces)
    inside_out = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    assert np.abs(loaded.canonicalise(shape_of(inside_out)).vertices - form.vertices).max() < 1e-4
    assert {"edge_strain", "mean_correction"} <= set(form.notes)


@pytest.mark.parametrize("check", ["repeatable", "seed", "relabelling", "rigid motion", "scale", "awkward shapes"])
def test_a_method_with_a_model_keeps_the_contract(check: str, finished: Path) -> None:
    spec = registry.variant("deformation-field[configuration=toy]", registry.methods())
    assert OF_METHODS_AND_SCORERS[check].run(MethodCase(spec, finished))


PAIR = joined(flat_grid(5), flat_grid(5).with_vertices(flat_grid(5).vertices + 9))
AWKWARD = {
    "8 points": trimesh.creation.box((1, 1, 1)),
    "no person": trimesh.creation.torus(1.0, 0.1),
    "needle": trimesh.creation.cylinder(radius=1e-4, height=1.0),
    "with a sliver": Mesh([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0.5, 0, 0]], [[0, 1, 2], [0, 3, 1]]),
    "two pieces": Mesh([*PAIR.vertices, [3, 3, 3]], PAIR.faces),
}


@pytest.mark.parametrize("name", AWKWARD)
def test_any_surface_has_a_finite_form_of_unit_area(name: str, finished: Path) -> None:
    form = method(finished).canonicalise(shape_of(Mesh(AWKWARD[name].vertices, AWKWARD[name].faces)))
    assert np.isfinite(form.vertices).all()
    assert form.mesh.area == pytest.approx(1)


def test_what_cannot_be_treated_is_refused_by_name(finished: Path) -> None:
    loaded = method(finished)
    with pytest.raises(UnsupportedShape, match="no area"):
        loaded.canonicalise(shape_of(Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])))
    large = Mesh(np.random.default_rng(0).normal(size=(500_000, 3)), [[0, 1, 2]])
    with pytest.raises(UnsupportedShape, match="500000 vertices takes too long; keep at most 50000"):
        loaded.canonicalise(shape_of(large))
    with pytest.raises(InvalidMesh, match="NaN"):
        shape_of(Mesh([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]]))


@pytest.mark.slow
def test_unseen_paddles_are_straightened(tmp_path: Path) -> None:
    fit("toy", 0, paddles(), tmp_path, {**OPTIONS, "steps": 300, "bodies": 8}, quiet)
    # What is trained for seconds is told less of: larger parts keep their shape.
    loaded, made = DeformationField(configuration="toy", reach=0.3).load(tmp_path), Paddles(5).surfaces(0, 4)
    before, after = [], []
    for canonical, poses in zip(made.canonical, made.posed, strict=True):
        unit = Mesh(canonical, made.faces).area ** 0.5
        for vertices in poses:
            form = loaded.canonicalise(shape_of(Mesh(vertices, made.faces)))
            before.append(misfit(vertices, canonical))
            after.append(misfit(form.vertices * unit, canonical))
    assert np.mean(after) < 0.8 * np.mean(before)
