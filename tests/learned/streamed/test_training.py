"""A streamed training is the same however it is stopped and whoever makes the bodies, and loses nothing."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from benchmark.api.contracts import Shape, UnsupportedShape
from benchmark.api.learning import CARD, WEIGHTS, Learner, read_card
from benchmark.errors import ConfigurationError, TrainingError
from benchmark.geometry.depth import back_project
from learned.streamed import configuration, fitting, training
from learned.streamed.fitting import fit
from learned.streamed.methods import StreamedLearner
from learned.streamed.network import build_streamed
from learned.training import loop
from learned.training.checkpoint import CHECKPOINT, SNAPSHOTS
from learned.training.loop import TrainingLoop
from tests.learned.streamed.toy import REFUSED, TOY, Ellipsoids, both, settle, toy_stream, trained_toy
from tests.learned.toy import files, quiet

OPTIONS: dict[str, Any] = {
    "steps": 60,
    "bodies": 4,
    "warm_up": 2,
    "learning_rate": 1e-2,
    "precision": "float32",
    "threads": 1,
    "workers": 0,
}


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    settle(monkeypatch, configuration.STREAMED, TOY, training)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a finished toy model."""
    folder = tmp_path_factory.mktemp("models") / "streamed-toy-seed0"
    return trained_toy(folder, configuration.STREAMED, TOY, training, fit, OPTIONS)


def weights(folder: Path) -> bytes:
    return (folder / WEIGHTS).read_bytes()


def test_a_finished_model_has_weights_a_card_and_a_history(finished: Path) -> None:
    assert files(finished) == {WEIGHTS, CARD, "history.csv"}
    card = read_card(finished)
    assert card["bodies"] == 240
    assert card["drawn_again"] == 60
    assert card["extra_data"] is True
    assert "validation mask overlap" in card["final"]


def test_a_batch_that_cannot_be_made_names_itself_and_loses_nothing(tmp_path: Path, finished: Path) -> None:
    for broken in (6, 9):
        with pytest.raises(TrainingError, match=rf"batch {broken} cannot be made: .*toy-{broken}-0 has no pose"):
            fit("toy", 0, toy_stream(Ellipsoids(broken=broken)), tmp_path, OPTIONS, quiet)
        assert files(tmp_path) == {CHECKPOINT}
    messages: list[str] = []
    fit("toy", 0, toy_stream(), tmp_path, OPTIONS, messages.append)
    assert "going on after step 9 of 60" in messages
    assert weights(tmp_path) == weights(finished)


@pytest.mark.slow
def test_workers_change_nothing_and_one_that_dies_is_replaced(tmp_path: Path, finished: Path) -> None:
    messages: list[str] = []
    make = Ellipsoids(killed=tmp_path / "killed")
    fit("toy", 0, toy_stream(make), tmp_path / "model", {**OPTIONS, "workers": 2}, messages.append)
    assert any("it is made again" in line for line in messages)
    assert (tmp_path / "killed").exists()
    assert weights(tmp_path / "model") == weights(finished)


@pytest.mark.slow
def test_a_training_that_is_killed_goes_on_and_leaves_no_process(tmp_path: Path, finished: Path) -> None:
    program = (
        "import sys; from pathlib import Path\n"
        "from learned.training import loop\n"
        "from learned.streamed import configuration, training\n"
        "from learned.streamed.fitting import fit\n"
        "from tests.learned.streamed.toy import TOY, toy_stream\n"
        "from tests.learned.streamed.test_training import OPTIONS\n"
        "if __name__ == '__main__':\n"
        "    configuration.STREAMED[TOY.name], loop.ROW, loop.CHECKPOINT_SECONDS = TOY, 4, -1.0\n"
        "    training.LOOKED_AT = 2\n"
        "    def say(line):\n"
        "        print(line, flush=True)\n"
        "        if line.startswith('step 4/'):\n"
        "            import time; time.sleep(100)\n"
        "    fit('toy', 0, toy_stream(), Path(sys.argv[1]), {**OPTIONS, 'workers': 1}, say)\n"
    )
    script = tmp_path / "program.py"
    script.write_text(program)
    folder = tmp_path / "model"
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    run = subprocess.Popen(
        [sys.executable, str(script), str(folder)], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert run.stdout is not None
    assert any(line.startswith("step 4/") for line in run.stdout)
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    assert children
    run.send_signal(signal.SIGKILL)
    run.wait()
    for _ in range(100):
        if not any(Path(f"/proc/{child}").exists() for child in children):
            break
        time.sleep(0.1)
    assert not any(Path(f"/proc/{child}").exists() for child in children)
    fit("toy", 0, toy_stream(), folder, OPTIONS, quiet)
    assert weights(folder) == weights(finished)


def test_options_that_do_not_fit_are_refused() -> None:
    for options, message in [*REFUSED, ({"resolution": 64}, "has resolution 32")]:
        with pytest.raises(ConfigurationError, match=message):
            fitting.checked_plan("toy", options)


def test_the_method_makes_a_form_of_unit_area_in_any_frame(finished: Path) -> None:
    assert isinstance(StreamedLearner(), Learner)
    method = StreamedLearner(configuration="toy").load(finished)
    forms = []
    for scale in (0.9, 0.45):
        image = both(500, 0.4 * scale, 0.9 * scale)[0]
        surface, _ = back_project(image, 1.0)
        forms.append(method.canonicalise(Shape(identifier="x", mesh=surface, depth=image)))
        assert forms[-1].mesh.area == pytest.approx(1)
    assert abs(forms[0].mesh.n_vertices - forms[1].mesh.n_vertices) < 0.1 * forms[0].mesh.n_vertices
    with pytest.raises(UnsupportedShape, match="needs a depth image"):
        method.canonicalise(Shape(identifier="x", mesh=surface))
    with pytest.raises(UnsupportedShape, match="empty"):
        method.canonicalise(Shape(identifier="x", mesh=surface, depth=np.zeros((500, 500), dtype=np.float32)))


OPEN = {**OPTIONS, "schedule": "constant", "average": 0.9}


class Stopped(BaseException):
    """Stands for a process that is killed."""


def stopped_at(step: int, folder: Path, options: dict[str, Any]) -> None:
    """Train until so many steps are in the checkpoint, and die."""

    def say(line: str) -> None:
        if line.startswith(f"step {step}/"):
            raise Stopped

    with pytest.raises(Stopped):
        fit("toy", 0, toy_stream(), folder, options, say)


def test_a_training_of_unknown_length_goes_on_with_more_steps_and_a_falling_end(tmp_path: Path) -> None:
    ending = {**OPEN, "steps": 40, "falling": 20}
    fit("toy", 0, toy_stream(), tmp_path / "whole", ending, quiet)
    stopped_at(16, tmp_path / "open", {**OPEN, "steps": 1000})
    stopped_at(32, tmp_path / "open", ending)
    fit("toy", 0, toy_stream(), tmp_path / "open", ending, quiet)
    assert weights(tmp_path / "open") == weights(tmp_path / "whole")
    assert read_card(tmp_path / "open")["bodies"] == 160


def test_the_finished_model_has_the_averaged_weights(tmp_path: Path) -> None:
    newest: list[torch.Tensor] = []
    step = TrainingLoop._step

    def noted(self: TrainingLoop, *arguments: Any) -> torch.Tensor:
        loss = step(self, *arguments)
        newest.append(self.network.head.bias.detach().clone())  # type: ignore[union-attr, operator]
        return loss

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingLoop, "_step", noted)
        fit("toy", 0, toy_stream(), tmp_path, OPEN, quiet)
    mean = build_streamed(TOY, 0).head.bias.detach()  # type: ignore[union-attr, operator]
    for number, each in enumerate(newest):
        mean = mean + (1 - min(0.9, (1 + number) / (10 + number))) * (each - mean)
    stored = load_file(str(tmp_path / WEIGHTS))["head.bias"]
    assert torch.allclose(stored.float(), mean, atol=1e-3)
    assert not torch.allclose(stored.float(), newest[-1], atol=1e-3)


def test_the_weights_are_kept_at_every_doubling_of_the_bodies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "FIRST_SNAPSHOT", 20)
    fit("toy", 0, toy_stream(), tmp_path, OPEN, quiet)
    snapshots = sorted((tmp_path / SNAPSHOTS).iterdir())
    assert [path.stem for path in snapshots] == ["0000000020", "0000000040", "0000000080", "0000000160"]
    assert load_file(str(snapshots[0]))["head.bias"].dtype == torch.float16
    fit("toy", 0, toy_stream(), tmp_path / "cosine", OPTIONS, quiet)
    assert SNAPSHOTS not in files(tmp_path / "cosine")


def test_step_sizes_of_a_plan() -> None:
    plan = loop.Plan(steps=100, warm_up=3, learning_rate=1.0, schedule="constant", falling=9)
    sizes = [plan.step_size(step) for step in range(100)]
    assert sizes[:4] == [0.25, 0.5, 0.75, 1.0]
    assert set(sizes[3:91]) == {1.0}
    np.testing.assert_allclose(sizes[91:], np.arange(9, 0, -1) / 10)
    for wrong in ({"schedule": "cosine", "falling": 1}, {"schedule": "constant", "falling": 101}):
        with pytest.raises(ConfigurationError, match="cannot fall"):
            loop.Plan(steps=100, **wrong)


def test_a_stream_without_wide_bodies_cannot_train_a_network_that_wants_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(configuration.STREAMED, "toy", replace(TOY, stream="wide"))
    with pytest.raises(ConfigurationError, match="no wide stream"):
        fit("toy", 0, toy_stream(), tmp_path, OPTIONS, quiet)
    wide = replace(toy_stream(), wide=replace(toy_stream(Ellipsoids(seed=9)), digest="wide"))
    fit("toy", 0, wide, tmp_path, {**OPTIONS, "steps": 2}, quiet)
    assert read_card(tmp_path)["data_digest"] == "wide"


def test_a_model_whose_card_is_older_than_an_option_stays_what_it_is(tmp_path: Path, finished: Path) -> None:
    shutil.copytree(finished, tmp_path / "old")
    path = tmp_path / "old" / CARD
    card = json.loads(path.read_text())
    for part in (card["streamed"], card["recipe"]["configuration"]):
        for name in ("norm", "encoder", "attention", "one_form", "places", "points", "stream"):
            del part[name]
    for part in (card["plan"], card["recipe"]["plan"]):
        for name in ("schedule", "falling", "average"):
            del part[name]
    path.write_text(json.dumps(card))
    messages: list[str] = []
    fit("toy", 0, toy_stream(), tmp_path / "old", OPTIONS, messages.append)
    assert messages == [f"{tmp_path / 'old'} holds this model already"]
    image = both(500, 0.3, 0.7)[0]
    forms = [StreamedLearner(configuration="toy").load(folder).predict(image)[0] for folder in (finished, path.parent)]
    np.testing.assert_array_equal(forms[0].vertices, forms[1].vertices)
