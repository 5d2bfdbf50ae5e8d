"""The paper's schedule, its losses by hand, and what the command line may change."""

from __future__ import annotations

from typing import Literal

import pytest
import torch

from benchmark.errors import ConfigurationError
from learned.paired.configuration import CONFIGURATIONS, configuration, from_card
from learned.paired.schedule import Schedule, losses, schedule


def test_defaults_are_the_papers() -> None:
    plan = schedule({}, {})
    assert (plan.resolution, plan.epochs, plan.batch, plan.learning_rate) == (500, 500, 8, 1e-3)
    assert (plan.early_alpha, plan.alpha, plan.beta, plan.n_early) == (0.01, 1.0, 1.0, 100)
    assert (plan.depth_loss, plan.gradient_clip, plan.cosine, plan.jitter) == ("all", 0, False, 0)
    assert plan.non_default_settings() == []
    assert plan.in_words() == "500 x 500 pixels, 500 epochs, batch 8"


@pytest.mark.parametrize(("epochs", "early"), [(500, 100), (100, 20), (40, 8), (5, 1), (1, 0)])
def test_another_number_of_epochs_keeps_the_papers_share(epochs: int, early: int) -> None:
    plan = schedule({}, {"epochs": epochs})
    assert plan.n_early == early
    assert [plan.weight_of_depth(epoch) for epoch in (early - 1, early)][early == 0 :] == [0.01, 1.0][early == 0 :]


PREDICTED = torch.tensor([[[0.5, 0.25], [0.0, 1.0]], [[1.0, 0.5], [0.0, 0.5]]])
TARGET = torch.tensor([[[1.0, 0.25], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]]])


@pytest.mark.parametrize(
    ("target", "kind", "of_depth", "of_mask"),
    [
        (TARGET, "all", (0.25 + 0 + 0 + 1) / 4, (0 + 0.25 + 0 + 0.25) / 4),
        (TARGET, "masked", (0.25 + 0) / 2, (0 + 0.25 + 0 + 0.25) / 4),
        (torch.zeros(2, 2, 2), "masked", 0, (1 + 0.25 + 0.25) / 4),
    ],
    ids=["all pixels", "inside the mask", "an empty mask"],
)
def test_losses_by_hand(target: torch.Tensor, kind: Literal["all", "masked"], of_depth: float, of_mask: float) -> None:
    depth, mask = losses(PREDICTED[None], target[None], kind)
    assert (float(depth), float(mask)) == (of_depth, of_mask)


def test_the_step_size_is_the_papers_or_falls_along_a_cosine() -> None:
    assert {Schedule().step_size(epoch) for epoch in (0, 250, 499)} == {1e-3}
    falling = Schedule(cosine=True)
    assert [falling.step_size(epoch) for epoch in (0, 250)] == pytest.approx([1e-3, 5e-4])
    assert 0 < falling.step_size(499) < 1e-8


@pytest.mark.parametrize(
    "options",
    [
        *({field: "0"} for field in ("resolution", "epochs", "batch", "learning_rate")),
        *({field: "-1"} for field in ("epochs", "learning_rate", "alpha", "early_alpha", "beta", "jitter")),
        {"gradient_clip": "-1"},
        {"learning_rate": "nan"},
        {"early_epochs": "-1"},
    ],
)
def test_a_value_out_of_range_is_refused(options: dict[str, str]) -> None:
    with pytest.raises(ConfigurationError, match="does not fit .* of the schedule; write a (whole )?number "):
        schedule({}, options)


def test_non_default_settings_are_told_with_the_papers_value() -> None:
    plan = schedule({}, {"epochs": 50, "resolution": 128, "depth_loss": "masked", "precision": "float32"})
    assert plan.non_default_settings() == [
        "resolution 128 (paper: 500)",
        "epochs 50 (paper: 500)",
        "early_epochs 10 (paper: 100)",
        "depth_loss masked (paper: all)",
    ]
    assert plan.in_words() == "128 x 128 pixels, 50 epochs, batch 8, depth_loss masked (paper: all)"


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_the_own_schedule_of_a_configuration_is_one(name: str) -> None:
    plan = schedule(configuration(name).schedule, {})
    own = {"wide-extra": plan, "without_weighting": Schedule(early_epochs=0)}
    assert plan == own.get(name, Schedule())


def test_without_progressive_weighting_the_depth_counts_in_full_from_the_first_epoch() -> None:
    plan = schedule(configuration("without_weighting").schedule, {"epochs": 60})
    assert [plan.weight_of_depth(epoch) for epoch in (0, 11, 59)] == [1, 1, 1]
    assert [Schedule(epochs=60).weight_of_depth(epoch) for epoch in (0, 11, 12)] == [0.01, 0.01, 1]


def test_a_configuration_survives_its_card() -> None:
    for each in CONFIGURATIONS.values():
        assert from_card(each.described()).described() == each.described()
