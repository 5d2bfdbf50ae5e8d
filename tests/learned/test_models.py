"""Models on disk: a card that says what was trained, weights that are those of the card, anything
else refused.
"""

from __future__ import annotations

import csv
import json
import math
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load as tensors_in
from safetensors.torch import save

from benchmark.api.learning import CARD, WEIGHTS, Bodies, TrainingPair, digest_of
from benchmark.errors import ConfigurationError, TrainingError
from benchmark.machine import describe_machine
from learned.fitting import check_finished, train
from learned.images import resampled
from learned.models import HISTORY, Configuration, load_model, predict
from learned.pairs import gather
from learned.training import measures
from tests.learned.toy import (
    BENDS,
    BUILDS,
    OPTIONS,
    TINY,
    Image,
    edit_card,
    ellipsoid,
    files,
    quiet,
    replace_weights,
    toy_data,
    toy_pairs,
)

IMAGE = torch.linspace(0, 1, 32 * 32, dtype=torch.float64).reshape(1, 1, 32, 32)


@pytest.fixture
def copied(trained: Path, tmp_path: Path) -> Path:
    """A model that may be damaged."""
    return Path(shutil.copytree(trained, tmp_path / "model"))


def again(folder: Path, options: Mapping[str, Any] = OPTIONS, **changes: Any) -> list[str]:
    """Ask for the same training, or for another; returns what it says."""
    messages: list[str] = []
    train(TINY.name, 0, replace(toy_data(), **changes), folder, options, messages.append)
    return messages


def test_the_folder_of_a_model_tells_what_was_trained(trained: Path) -> None:
    assert files(trained) == {WEIGHTS, CARD, HISTORY}
    card = json.loads((trained / CARD).read_text())
    settings = {name: value for name, value in OPTIONS.items() if name != "device"}
    assert settings.items() <= card["schedule"].items()
    assert card["schedule_in_words"].startswith(
        "32 x 32 pixels, 30 epochs, early_epochs 5, batch 2"
    )
    assert (card["subjects"], card["tested"]) == (list(toy_data().subjects), digest_of(["plump"]))
    with (trained / HISTORY).open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["epoch"]) for row in rows] == list(range(1, 31))
    assert float(rows[-1]["mask loss"]) < 0.3 * float(rows[0]["mask loss"])
    assert (card["seed"], card["extra_data"]) == (0, False)
    assert card["depth_scale"] == {"mean": 0.5, "factor": 1.0}
    assert card["machine"] == describe_machine() and card["core_seconds"] >= 1
    assert "commit" in card and len(card["data_digest"]) == 64
    assert card["training_measures"]["mask overlap"] > 0.8
    assert 0 < card["validation_measures"]["mask overlap"] <= 1


def test_predictions_are_those_of_the_weights_on_disk(trained: Path) -> None:
    stored = tensors_in((trained / WEIGHTS).read_bytes())
    assert {tensor.dtype for tensor in stored.values()} == {torch.float16}
    network = TINY.build(seed=7)
    network.load_state_dict({name: tensor.float() for name, tensor in stored.items()})
    with torch.no_grad():
        torch.testing.assert_close(
            load_model(trained)[0](IMAGE), network.double()(IMAGE), rtol=0, atol=1e-12
        )


def test_the_measures_on_a_card_are_those_of_the_weights_on_disk(trained: Path) -> None:
    network = TINY.build().eval()
    stored = tensors_in((trained / WEIGHTS).read_bytes())
    network.load_state_dict({name: tensor.float() for name, tensor in stored.items()})
    pairs = gather(toy_data().pairs(), toy_data().n_pairs, 32, crop=False)
    images, targets = pairs[torch.arange(len(pairs))]
    with torch.no_grad():
        expected = measures(network(images), targets)
    card = json.loads((trained / CARD).read_text())
    assert card["training_measures"] == pytest.approx(expected, rel=1e-5)


def test_a_prediction_has_double_precision(trained: Path) -> None:
    depth = ellipsoid(0.5, 0.7)
    image = torch.from_numpy(resampled(depth, 32)[:1]).double()[None]
    with torch.no_grad():
        expected = load_model(trained)[0](image)[0]
    torch.testing.assert_close(predict(trained, depth), expected, rtol=0, atol=1e-12)


def test_a_training_on_pairs_on_disk_ends_with_the_scale_of_its_targets(tmp_path: Path) -> None:
    def images(number: int) -> list[Image]:
        width, height = list(BUILDS.values())[number]
        return [ellipsoid(width, height, x=x, y=-x) for x in BENDS]

    bodies = Bodies(names=tuple(BUILDS), n_images=len(BENDS), images=images, recipe="toy")
    options = {**OPTIONS, "epochs": 1, "early_epochs": 0, "stretch_depth": True}
    scales = []
    for folder, data in (("memory", toy_data()), ("disk", replace(toy_data(), bodies=bodies))):
        train(TINY.name, 0, data, tmp_path / folder / "model", options, quiet)
        scales.append(json.loads((tmp_path / folder / "model" / CARD).read_text())["depth_scale"])
    assert scales[1] == pytest.approx(scales[0], rel=1e-3)


def test_depths_of_stretched_targets_are_predicted_in_the_range_of_the_frame(
    trained: Path, tmp_path: Path
) -> None:
    train(TINY.name, 0, toy_data(), tmp_path, {**OPTIONS, "stretch_depth": True}, quiet)
    card = json.loads((tmp_path / CARD).read_text())
    targets = np.stack(
        [resampled(pair.target, 32) for pair in list(toy_pairs(BUILDS))[::2]]
    ).astype(float)
    depths = targets[:, 0][targets[:, 1] == 1]
    factor = 0.4 / np.abs(depths - depths.mean()).max()
    assert factor > 2
    assert card["depth_scale"] == pytest.approx({"mean": depths.mean(), "factor": factor})
    assert card["data_digest"] != json.loads((trained / CARD).read_text())["data_digest"]
    depth, mask = predict(tmp_path, ellipsoid(*BUILDS["slim"])).numpy()
    assert np.abs(depth - targets[0, 0])[mask > 0.9].mean() < 0.03
    errors = [card[name]["depth error"] for name in ("training_measures", "validation_measures")]
    assert max(errors) < 0.05  # shares of the frame's depth, too


def test_a_card_without_a_scale_changes_no_bit(copied: Path) -> None:
    expected = predict(copied, ellipsoid(0.5, 0.7))
    edit_card(copied, lambda card: card.pop("depth_scale"))
    assert torch.equal(predict(copied, ellipsoid(0.5, 0.7)), expected)
    edit_card(copied, lambda card: card.update(depth_scale={"mean": 0.6, "factor": 4.0}))
    depth, mask = predict(copied, ellipsoid(0.5, 0.7))
    assert torch.equal(mask, expected[1])
    torch.testing.assert_close(0.5 + 4 * (depth - 0.6), expected[0])


def test_a_folder_whose_model_was_replaced_is_read_again(copied: Path) -> None:
    before = load_model(copied)[0]
    replace_weights(
        copied,
        save({name: tensor.half() for name, tensor in TINY.build(seed=5).state_dict().items()}),
    )
    with torch.no_grad():
        assert not torch.equal(load_model(copied)[0](IMAGE), before(IMAGE))


def flip_last_bit(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda folder: flip_last_bit(folder / WEIGHTS),
            "its card says .*; fetch the file again or train",
        ),
        (
            lambda folder: replace_weights(folder, b"PK\x03\x04 a pickle in a zip"),
            "is damaged: .*; train it",
        ),
        *(
            (
                lambda folder, name=name: (folder / name).unlink(),
                f"{name}: No such file.*; check the path",
            )
            for name in (WEIGHTS, CARD)
        ),
        *(
            (
                lambda folder, text=text: (folder / CARD).write_bytes(text),
                f"{CARD}: .*; train the model again",
            )
            for text in (b"{", b"", b"[]", b"{}", b'{"digest": 3}', b"\xe9")
        ),
    ],
)
def test_a_damaged_model_is_refused(
    copied: Path, damage: Callable[[Path], object], message: str
) -> None:
    damage(copied)
    with pytest.raises(ConfigurationError, match=message):
        load_model(copied)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_weights_that_are_not_finite_are_refused(copied: Path, value: float) -> None:
    tensors = tensors_in((copied / WEIGHTS).read_bytes())
    name = sorted(tensors)[-1]
    tensors[name].view(-1)[-1] = value
    replace_weights(copied, save(tensors))
    with pytest.raises(ConfigurationError, match="some of its weights are not finite; train it"):
        load_model(copied)
    card = json.loads((copied / CARD).read_bytes())
    with pytest.raises(ConfigurationError, match="are not finite; delete the folder to train"):
        check_finished(copied, card["schedule"])


def test_a_network_takes_no_memory_before_its_weights_fit(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = set()

    def recorded(configuration: Configuration, seed: int = 0) -> torch.nn.Module:
        network = build(configuration, seed)
        devices.update(parameter.device.type for parameter in network.parameters())
        return network

    build = Configuration.build
    monkeypatch.setattr(Configuration, "build", recorded)
    edit_card(copied, lambda card: card["configuration"].update(width=4096))
    with pytest.raises(ConfigurationError, match="belong to another network than 'tiny'"):
        load_model(copied)
    assert devices == {"meta"}


UNBUILDABLE = [
    ("width", "16"),
    ("width", 0),
    ("width", 10**9),
    ("architecture", "attentive"),
    ("short_range", 1),
]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda card: card.pop("digest"), "missing required field `digest`; train the model again"),
        (
            lambda card: card.pop("subjects"),
            "missing required field `subjects`; train the model again",
        ),
        (lambda card: card.update(subjects=None), r"at `\$.subjects`.*; train the model again"),
        (lambda card: card.update(digest="abc"), r"at `\$.digest`.*; train the model again"),
        (lambda card: card.update(note=math.nan), "malformed.*; train the model again"),
        *(
            (
                lambda card, factor=factor: card.update(depth_scale={"factor": factor}),
                r"at `\$.depth_scale.factor`; train the model again",
            )
            for factor in (0, -1.5)
        ),
        (
            lambda card: card["configuration"].update(width=16),
            "belong to another network than 'tiny'",
        ),
        *(
            (
                lambda card, change={name: value}: card["configuration"].update(change),
                rf"`\$\.configuration\.{name}`",
            )
            for name, value in UNBUILDABLE
        ),
    ],
)
def test_a_card_that_lacks_a_field_or_names_another_network_is_refused(
    copied: Path, edit: Any, message: str
) -> None:
    edit_card(copied, edit)
    with pytest.raises(ConfigurationError, match=message):
        load_model(copied)


def darker() -> Iterator[TrainingPair]:
    """The pairs of the toy data, with other depths."""
    return (replace(pair, image=pair.image * np.float32(0.9)) for pair in toy_pairs(BUILDS))


def test_a_finished_model_is_left_alone(trained: Path, copied: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in trained.iterdir()}
    # Where it is computed is not part of what determines the model.
    found = again(trained, {**OPTIONS, "device": "auto"})
    assert found[-1] == f"{trained} holds this model already"
    assert {path: path.stat().st_mtime_ns for path in trained.iterdir()} == before
    edit_card(copied, lambda card: card["schedule"].pop("threads"))  # as it was until 0.3
    assert again(copied)[-1] == f"{copied} holds this model already"


@pytest.mark.parametrize(
    ("options", "changes", "named"),
    [
        ({"epochs": 31}, {}, r"epochs \(30, not 31\)"),
        ({"precision": "bfloat16"}, {}, r"precision \(float32, not bfloat16\)"),
        ({"threads": 2}, {}, r"threads \(1, not 2\)"),
        ({}, {"identifiers": ("slim-0.0",)}, "shapes"),
        ({}, {"pairs": darker}, "images"),
    ],
)
def test_a_finished_model_of_another_training_is_refused_with_what_differs(
    trained: Path, options: dict[str, Any], changes: dict[str, Any], named: str
) -> None:
    message = (
        f"holds a finished model of another training, with another {named}; "
        "delete the folder to train anew"
    )
    with pytest.raises(ConfigurationError, match=message):
        again(trained, {**OPTIONS, **options}, **changes)


def test_a_finished_model_of_another_seed_or_of_what_no_option_names_is_refused(
    copied: Path,
) -> None:
    with pytest.raises(ConfigurationError, match=r"another seed \(0, not 1\)"):
        train(TINY.name, 1, toy_data(), copied, OPTIONS, quiet)
    edit_card(copied, lambda card: card["schedule"].update(jitter=True))
    with pytest.raises(ConfigurationError, match=r"another jitter \(True, not None\)"):
        again(copied)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epoch": 3}, "unknown parameter of the schedule 'epoch'; did you mean epochs"),
        ({"device": "tpu"}, "unknown device of the training 'tpu'; did you mean"),
        ({"resolution": 16}, "the network has no resolution 16; pass -o resolution=N, 32 to 2048"),
    ],
)
def test_an_option_that_does_not_fit_leaves_no_folder(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        again(tmp_path / "model", {**OPTIONS, **options})
    assert files(tmp_path) == set()


def test_no_pair_is_no_training(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="no pair to train on"):
        again(tmp_path, pairs=lambda: iter(()))


def test_a_card_counts_the_pairs_that_were_rendered_and_needs_no_validation(tmp_path: Path) -> None:
    """A shape of the training cannot be rendered, nor can any other subject."""
    data = replace(toy_data(), n_pairs=7, validation=lambda: iter(()))
    said: list[str] = []
    train(TINY.name, 0, data, tmp_path / "model", {**OPTIONS, "epochs": 1}, said.append)
    card = json.loads((tmp_path / "model" / CARD).read_text())
    assert card["pairs"] == 6
    assert "validation_measures" not in card and "training_measures" in card
    assert any("there is no validation" in line for line in said)


def test_networks_of_generated_bodies_come_trained(tmp_path: Path) -> None:
    for name in ("streamed-people", "field-plain"):
        with pytest.raises(
            ConfigurationError, match=f"'{name}' comes trained; train it at commit 4868b8b9"
        ):
            train(name, 0, toy_data(), tmp_path, {}, quiet)
