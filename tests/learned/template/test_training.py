"""A template fits what it is shown, however its training is stopped, and unbends what it has not seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open

from benchmark.api.learning import CARD, WEIGHTS, read_card
from benchmark.errors import ConfigurationError, TrainingError
from learned.template import configuration, fitting, samples, training
from learned.template.fitting import fit
from learned.template.model import deformed
from learned.template.network import TemplateNetwork, build_auto_decoder
from learned.template.samples import DrawsPoints, Shapes, collected
from learned.template.training import TemplatePlan, train_template
from learned.training import loop
from learned.training.checkpoint import CHECKPOINT
from tests.learned.template.toy import OPTIONS, TOY, Rods, rod, rods
from tests.learned.toy import files, misfit, quiet, run_in, toy_data

UNBENDING = replace(TOY, bodies=8, width=32, template_layers=3, rays=64, deformation_frequency=3.0)


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the toy template a name, make few rays, and write a checkpoint every fourth step."""
    tiny(monkeypatch)


def tiny(patch: pytest.MonkeyPatch) -> None:
    patch.setitem(configuration.TEMPLATES, TOY.name, TOY)
    patch.setattr(samples, "KEPT", 128)
    patch.setattr(samples, "TOGETHER", 2)
    patch.setattr(fitting, "TOGETHER", 1)
    patch.setattr(loop, "ROW", 4)
    patch.setattr(loop, "CHECKPOINT_SECONDS", -1.0)
    patch.setattr(training, "LOOK_STEPS", 2)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of a finished toy model."""
    folder = tmp_path_factory.mktemp("models") / "template-toy-seed0"
    with pytest.MonkeyPatch.context() as patch:
        tiny(patch)
        fit("toy", 0, rods(), folder, OPTIONS, quiet)
    yield folder


def weights(folder: Path) -> bytes:
    return (folder / WEIGHTS).read_bytes()


def test_a_finished_model_has_weights_without_codes_a_card_and_a_history(finished: Path) -> None:
    assert files(finished) == {WEIGHTS, CARD, "history.csv"}
    card = read_card(finished)
    assert (card["bodies"], card["shapes"], card["extra_data"]) == (3, 9, True)
    assert card["precision"] == "float32"
    assert card["final"]["validation distance error"] > 0
    assert b"codes" not in weights(finished)


def test_a_training_that_is_interrupted_goes_on_to_the_same_weights(tmp_path: Path, finished: Path) -> None:
    def stop(line: str) -> None:
        if line.startswith("step 8/"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit("toy", 0, rods(), tmp_path, OPTIONS, stop)
    assert files(tmp_path) == {CHECKPOINT, samples.SAMPLES}
    said: list[str] = []
    make = Rods()
    fit("toy", 0, rods(make), tmp_path, OPTIONS, said.append)
    assert "going on after step 8 of 12" in said
    assert make.asked == []  # the bodies had been kept
    assert weights(tmp_path) == weights(finished)


def test_a_body_that_cannot_be_made_is_named_and_the_others_are_kept(tmp_path: Path, finished: Path) -> None:
    with pytest.raises(TrainingError, match=r"batch 1 cannot be made: .*rod-1-0 has no pose"):
        fit("toy", 0, rods(Rods(broken=1)), tmp_path, OPTIONS, quiet)
    make = Rods()
    fit("toy", 0, rods(make), tmp_path, OPTIONS, quiet)
    assert make.asked == [1]
    assert weights(tmp_path) == weights(finished)


def test_distances_that_are_damaged_or_of_other_data_are_made_again(tmp_path: Path) -> None:
    expected = collected(Rods().surfaces, 3, tmp_path, "one", quiet)
    path = tmp_path / samples.SAMPLES / "0.safetensors"
    path.write_bytes(path.read_bytes()[:100])
    make = Rods()
    found = collected(make.surfaces, 3, tmp_path, "one", quiet)
    assert make.asked == [0]
    assert all(torch.equal(value, vars(found)[name]) for name, value in vars(expected).items())
    collected(make.surfaces, 3, tmp_path, "other", quiet)
    assert make.asked == [0, 0, 1]


def test_a_batch_is_a_matter_of_its_number_and_shows_all_shapes_equally_often() -> None:
    draws = DrawsPoints(Shapes.around([rod(), rod(1.0), rod(2.0)], 64), n_shapes=2, rays=16, seed=0)
    made = [draws(number) for number in range(6)]
    assert np.bincount(np.concatenate([batch.shapes.numpy() for batch in made])).tolist() == [4, 4, 4]
    assert torch.equal(draws(3).points, made[3].points)
    assert not torch.equal(made[0].points, made[1].points)
    batch = made[0]
    assert not batch.distances[:, :16].any()
    assert batch.distances[:, 16:].abs().min() > 0
    assert batch.points.shape == batch.directions.shape == (2, 32, 3)


def test_options_that_do_not_fit_are_refused_before_anything_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    for options, told in (
        ({"epochs": 3}, "steps=N"),
        ({"resolution": 64}, "unknown"),
        ({"step": 3}, "did you mean steps"),
        ({"bodies": 1}, "at least 2"),
        ({"precision": "bfloat16"}, "more digits"),
    ):
        with pytest.raises(ConfigurationError, match=told):
            fitting.checked_plan("toy", options)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ConfigurationError, match="no GPU is here"):
        fitting.checked_plan("toy", {"device": "cuda"})
    with pytest.raises(ConfigurationError, match="did you mean plain"):
        fitting.checked_plan("plane", {})


def test_data_that_is_no_stream_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no stream of fresh bodies"):
        fit("toy", 0, toy_data(), tmp_path, OPTIONS, quiet)


def test_a_finished_model_of_another_plan_is_left_alone(finished: Path) -> None:
    said: list[str] = []
    fit("toy", 0, rods(), finished, OPTIONS, said.append)
    assert said == [f"{finished} holds this model already"]
    with pytest.raises(ConfigurationError, match="another training"):
        fit("toy", 0, rods(), finished, {**OPTIONS, "steps": 13}, quiet)


def test_distances_that_outlived_their_training_go(finished: Path) -> None:
    (finished / samples.SAMPLES).mkdir()
    fit("toy", 0, rods(), finished, OPTIONS, quiet)
    assert files(finished) == {WEIGHTS, CARD, "history.csv"}


def test_one_shape_alone_is_its_own_template(tmp_path: Path) -> None:
    shapes = Shapes.around([rod(1.0)], 1024)
    chosen = replace(TOY, bodies=1, width=32, rays=32)
    plan = TemplatePlan(steps=250, bodies=2, learning_rate=5e-3, warm_up=10, code_rate=1.0)
    network = train_template(chosen, plan, shapes, None, run_in(tmp_path)).network
    share = torch.linspace(0, 1, 1024) ** 2
    points = shapes.feet + (share * shapes.lengths)[..., None] * shapes.directions
    with torch.no_grad():
        code = torch.zeros(1, TOY.code_size)
        error = (network.distances(points, code) - share * shapes.lengths).abs().mean()
        of_template = network.template_distances(shapes.feet)[..., 0, 0].abs().mean()
    # The rod is .26 thick and 1.3 long where its area is 1.
    assert error < 0.01
    assert of_template < 0.02


def test_codes_learn_at_a_rate_of_their_own(tmp_path: Path) -> None:
    shapes = Shapes.around([rod(0.0), rod(1.0)], 256)
    found = {}
    for rate in (1.0, 100.0):
        plan = TemplatePlan(steps=1, bodies=2, learning_rate=1e-4, warm_up=0, code_rate=rate)
        folder = tmp_path / f"{rate:g}"
        folder.mkdir()
        train_template(replace(TOY, bodies=1), plan, shapes, None, run_in(folder))
        with safe_open(str(folder / CHECKPOINT), "pt") as file:
            found[rate] = {name: file.get_tensor(name) for name in file.keys() if name.startswith("weights.")}  # noqa: SIM118
    first = build_auto_decoder(replace(TOY, bodies=1), 2, 0).state_dict()
    for rate, weights in found.items():
        # The first step of Adam is the step size, whatever the gradient.
        moved = (weights["weights.codes.weight"] - first["codes.weight"]).abs().max()
        assert float(moved) == pytest.approx(rate * 1e-4, rel=1e-2)
        of_template = (
            (weights["weights.fields.template.last.weight"] - first["fields.template.last.weight"]).abs().max()
        )
        assert float(of_template) == pytest.approx(1e-4, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.7, -1.8])
def test_a_bend_that_was_never_seen_is_undone(unbent: TemplateNetwork, angle: float) -> None:
    vertices, notes = deformed(unbent, UNBENDING, rod(angle))
    straight = rod()
    assert notes["distance_error"] < 0.01
    before, after = (misfit(each, straight.vertices) for each in (rod(angle).vertices, vertices * straight.area**0.5))
    assert after < 0.5 * before


@pytest.fixture(scope="module")
def unbent(tmp_path_factory: pytest.TempPathFactory) -> TemplateNetwork:
    """Fields that were trained on 24 rods, a third of them straight."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "KEPT", 1024)
        shapes = collected(Rods().surfaces, 8, None, "", quiet)
    plan = TemplatePlan(steps=800, bodies=8, learning_rate=5e-3, warm_up=20, code_rate=1.0)
    network = train_template(UNBENDING, plan, shapes, None, run_in(tmp_path_factory.mktemp("rods"))).network
    return network.double().requires_grad_(False)
