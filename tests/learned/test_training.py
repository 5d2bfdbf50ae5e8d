"""The loop: the paper's schedule, losses by hand, and the same weights however often a training is
killed.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest
import torch

from benchmark.api.learning import CARD
from benchmark.errors import ConfigurationError, TrainingError
from learned import fitting, training
from learned.pairs import PairsInMemory, gather
from learned.training import (
    CHECKPOINT,
    Fitted,
    History,
    Schedule,
    device_named,
    fit,
    losses,
    measures,
    resolved,
)
from tests.learned.toy import BUILDS, TINY, quiet, toy_data, toy_pairs

CPU = torch.device("cpu")
PLAN = Schedule(
    resolution=32, epochs=4, batch=2, early_epochs=1, learning_rate=3e-3, precision="float32"
)
PREDICTED = torch.tensor([[[0.5, 0.25], [0.0, 1.0]], [[1.0, 0.5], [0.0, 0.5]]])
TARGET = torch.tensor([[[1.0, 0.25], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]]])


@pytest.fixture(scope="module")
def pairs() -> PairsInMemory:
    return gather(toy_pairs(BUILDS), 6, 32)


def run(
    pairs: PairsInMemory, folder: Path, plan: Schedule = PLAN, seed: int = 0
) -> tuple[torch.nn.Module, History]:
    folder.mkdir(exist_ok=True)
    network = TINY.build(seed)
    return network, fit(
        network, pairs, None, plan, folder, seed=seed, device=CPU, log=quiet
    ).history


def equal(first: torch.nn.Module, second: torch.nn.Module) -> bool:
    ours, others = first.state_dict(), second.state_dict()
    return all(torch.equal(ours[name], others[name]) for name in ours)


@pytest.mark.parametrize(("epochs", "early"), [(500, 100), (60, 12), (5, 1), (1, 0)])
def test_the_defaults_are_the_papers_and_its_share_of_early_epochs_is_kept(
    epochs: int, early: int
) -> None:
    paper = Schedule()
    assert (paper.resolution, paper.epochs, paper.batch, paper.learning_rate) == (500, 500, 8, 1e-3)
    weights = [Schedule(epochs=epochs).depth_weight(epoch) for epoch in range(epochs)]
    assert weights == [0.01] * early + [1.0] * (epochs - early)
    assert Schedule(epochs=epochs, early_epochs=0).depth_weight(0) == 1
    assert paper.in_words() == "500 x 500 pixels, 500 epochs"
    assert (
        replace(paper, batch=4, early_epochs=0)
        .in_words()
        .endswith("epochs, early_epochs 0, batch 4")
    )


class OneWeight(torch.nn.Module):
    """Depth and mask are the image times one weight; ``seen`` has the first pixel of each image."""

    def __init__(self) -> None:
        super().__init__()
        self.weight, self.seen = torch.nn.Parameter(torch.ones(())), list[float]()

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        self.seen += image[:, 0, 0, 0].tolist()
        self.is_halved = torch.is_autocast_enabled("cpu")
        return (self.weight * image).expand(-1, 2, -1, -1)


def one_weight(
    folder: Path, plan: Schedule, images: torch.Tensor, seed: int = 0
) -> tuple[OneWeight, History]:
    """Train one weight on images whose true depth is -1 and true mask 2."""
    target = torch.tensor([-1.0, 2.0])[None, :, None, None].expand(1, 2, 2, 2).contiguous()
    pairs = PairsInMemory(
        tuple("abcdef"[: len(images)]), images, target, torch.zeros(len(images), dtype=torch.long)
    )
    network = OneWeight()
    folder.mkdir()
    return network, fit(
        network, pairs, None, plan, folder, seed=seed, device=CPU, log=quiet
    ).history


def test_the_weight_of_the_depth_grows_after_the_early_epochs(tmp_path: Path) -> None:
    """Two epochs of each kind, after Adam's rule: the losses are (w + 1)^2 of the depth and (w -
    2)^2 of the mask.
    """
    network, (row, *_) = one_weight(
        tmp_path / "model", replace(PLAN, early_epochs=2), torch.ones(1, 1, 2, 2)
    )
    assert (row["depth loss"], row["mask loss"]) == (4, 1)
    weight, first, second = 1.0, 0.0, 0.0
    for step, alpha in enumerate((0.01, 0.01, 1.0, 1.0), start=1):
        slope = alpha * 2 * (weight + 1) + 2 * (weight - 2)
        first, second = 0.9 * first + 0.1 * slope, 0.999 * second + 0.001 * slope**2
        weight -= 3e-3 * first / (1 - 0.9**step) / ((second / (1 - 0.999**step)) ** 0.5 + 1e-8)
    assert float(network.weight.detach()) == pytest.approx(weight, abs=1e-6)


def test_the_order_of_pairs_differs_between_epochs_and_repeats_with_the_seed(
    tmp_path: Path,
) -> None:
    images = torch.arange(6.0)[:, None, None, None].expand(6, 1, 2, 2).contiguous()
    seen = [
        one_weight(tmp_path / str(k), PLAN, images, seed)[0].seen
        for k, seed in enumerate((0, 0, 1))
    ]
    epochs = [seen[0][k : k + 6] for k in range(0, 24, 6)]
    assert all(sorted(epoch) == [*range(6)] for epoch in epochs)
    assert len({*map(tuple, epochs)}) == 4
    assert seen[0] == seen[1] != seen[2]


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_the_network_computes_in_the_precision_of_the_schedule(
    tmp_path: Path, precision: Literal["float32", "bfloat16"]
) -> None:
    plan = replace(PLAN, epochs=1, precision=precision)
    assert one_weight(tmp_path / "model", plan, torch.ones(1, 1, 2, 2))[0].is_halved == (
        precision == "bfloat16"
    )


@pytest.mark.parametrize(("name", "early"), [("literal", None), ("without_weighting", 0)])
def test_the_ablation_of_the_weighting_has_no_early_epochs(
    name: str, early: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans: list[Schedule] = []
    fitted = Fitted([{}], 1.0)
    monkeypatch.setattr(fitting, "fit", lambda *given, **_: plans.append(given[3]) or fitted)
    monkeypatch.setattr(fitting, "save_model", lambda *_: None)
    monkeypatch.setattr(fitting, "load_model", lambda _: None)
    monkeypatch.setattr(fitting, "_measured", lambda *_: {})
    options = {"resolution": 32, "device": "cpu", "threads": 1}
    fitting.train(name, 0, toy_data(), tmp_path, options, quiet)
    assert plans[0].early_epochs == early


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 70_000.0])
def test_a_training_that_diverges_in_its_last_step_leaves_no_model(
    value: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverging(network: torch.nn.Module, *_: object, **__: object) -> tuple[list[object], float]:
        with torch.no_grad():
            next(network.parameters()).view(-1)[0] = value  # half precision ends at 65504
        return [], 1.0

    monkeypatch.setattr(fitting, "fit", diverging)
    with pytest.raises(TrainingError, match="diverged: .* holds a weight that is not finite"):
        fitting.train("literal", 0, toy_data(), tmp_path, {"resolution": 32}, quiet)
    assert not (tmp_path / CARD).exists()


def test_the_time_left_is_that_of_the_epochs_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    now, lines = iter([0.0, 10.0, 25.0, 40.0]), list[str]()
    monkeypatch.setattr(training.time, "perf_counter", lambda: next(now))
    progress = training._Progress(10, 5, lines.append)
    for epoch in (6, 7, 8):  # the second comes too soon after the first
        progress.show(epoch, {"epoch": epoch, "loss": 0.5}, at_once=epoch == 6)
    bars = ["[############        ] epoch 6/10", "[################    ] epoch 8/10"]
    assert lines == [
        f"{bar}  loss 0.50000  {left} s left" for bar, left in zip(bars, (40, 27), strict=True)
    ]


def test_losses_by_hand() -> None:
    depth, mask = losses(PREDICTED[None], TARGET[None])
    assert (float(depth), float(mask)) == ((0.25 + 0 + 0 + 1) / 4, (0 + 0.25 + 0 + 0.25) / 4)
    depth, mask = losses(PREDICTED[None], TARGET[None], masked_depth=True)
    assert (float(depth), float(mask)) == ((0.25 + 0) / 2, (0 + 0.25 + 0 + 0.25) / 4)


def test_the_step_size_falls_along_half_a_cosine() -> None:
    falling = Schedule(cosine=True, learning_rate=2.0)
    assert [falling.step_size(step, 4) for step in (0, 2, 4)] == pytest.approx([2, 1, 0])
    assert Schedule(learning_rate=2.0).step_size(3, 4) == 2


def test_steps_have_the_step_size_of_their_place_in_the_whole_training(
    pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int]] = []

    def step_size(_: Schedule, step: int, steps: int) -> float:
        asked.append((step, steps))
        return 1e-3

    monkeypatch.setattr(Schedule, "step_size", step_size)
    run(pairs, tmp_path, replace(PLAN, epochs=2, batch=4, repeat=2))
    assert asked == [(step, 6) for step in range(6)]


def test_a_repeated_pair_occurs_as_often_as_others_in_an_epoch(
    pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []
    read = PairsInMemory.__getitem__
    monkeypatch.setattr(
        PairsInMemory,
        "__getitem__",
        lambda pairs, rows: seen.extend(rows.tolist()) or read(pairs, rows),
    )
    run(pairs, tmp_path, replace(PLAN, epochs=1, batch=5, repeat=3))
    assert sorted(seen) == sorted(3 * [*range(6)])
    assert seen[:6] != [*range(6)] and len(set(seen[:6])) < 6


def test_measures_by_hand() -> None:
    target = torch.tensor([[[0.5, 0.5], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]]])
    prediction = torch.tensor([[[0.25, 0.5], [0.0, 0.9]], [[0.9, 0.5], [0.2, 0.6]]])
    # Of the mask one pixel is hit, one is missed (a half is not above a half), and one is wrong.
    single = measures(prediction[None], target[None])
    assert single == {"mask overlap": pytest.approx(1 / 3), "depth error": pytest.approx(0.25)}
    assert measures(prediction[None], target[None], 5.0)["depth error"] == pytest.approx(0.05)
    assert measures(prediction[None] * 0, target[None]) == {"mask overlap": 0}


def test_every_pair_counts_the_same_in_the_losses_of_an_epoch(
    pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Six pairs in batches of four and two, whose losses are made to be 1 and 4.
    def made(
        prediction: torch.Tensor, *_: object, **__: object
    ) -> tuple[torch.Tensor, torch.Tensor]:
        loss = 0 * prediction.sum() + (1 if len(prediction) == 4 else 4)
        return loss, loss

    monkeypatch.setattr(training, "losses", made)
    (row,) = run(pairs, tmp_path, replace(PLAN, epochs=1, batch=4))[1]
    assert row["depth loss"] == row["mask loss"] == pytest.approx((4 * 1 + 2 * 4) / 6)


def test_rows_hold_the_measures_of_their_epochs(
    pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "VALIDATIONS", 2)
    history = fit(
        TINY.build(0),
        pairs,
        pairs,
        replace(PLAN, epochs=5),
        tmp_path,
        seed=0,
        device=CPU,
        log=quiet,
    ).history
    assert ["validation mask overlap" in row for row in history] == [False, True, False, True, True]


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_training_that_stops_anywhere_ends_with_the_same_weights(
    pairs: PairsInMemory,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    precision: Literal["float32", "bfloat16"],
) -> None:
    plan = replace(PLAN, precision=precision)
    expected, history = run(pairs, tmp_path / "undisturbed", plan)
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    inner, calls = training.losses, 0

    def interrupted(*arguments: object, masked_depth: bool) -> tuple[torch.Tensor, torch.Tensor]:
        nonlocal calls
        calls += 1
        if calls in (
            2,
            6,
            11,
        ):  # within the first epoch, at the start of the second and within the third
            raise KeyboardInterrupt
        return inner(*arguments, masked_depth=masked_depth)  # type: ignore[arg-type]

    monkeypatch.setattr(training, "losses", interrupted)
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            run(pairs, tmp_path / "stopped", plan)
    network, again = run(pairs, tmp_path / "stopped", plan)
    assert equal(network, expected)
    assert again == history


def test_a_training_goes_on_from_the_last_step_of_its_last_epoch(
    pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected, history = run(pairs, tmp_path / "undisturbed")
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)

    def stopping(state: training._State, n_pairs: int) -> dict[str, float]:
        if state.epoch == PLAN.epochs - 1:
            raise KeyboardInterrupt
        return finish(state, n_pairs)

    finish = training._State.finished_epoch
    with monkeypatch.context() as patch:
        patch.setattr(training._State, "finished_epoch", stopping)
        with pytest.raises(KeyboardInterrupt):
            run(pairs, tmp_path / "stopped")
    network, again = run(pairs, tmp_path / "stopped")
    assert equal(network, expected)
    assert again == history


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), MemoryError()])
def test_a_checkpoint_that_cannot_be_read_is_not_called_damaged(
    error: Exception, pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(pairs, tmp_path)

    def failing(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(torch, "load", failing)
    with pytest.raises(TrainingError, match="cannot read checkpoint .*; correct that, and train"):
        run(pairs, tmp_path)


@pytest.mark.parametrize(
    ("changes", "seed", "named"),
    [
        ({"learning_rate": 1e-3}, 0, r"learning_rate \(0.003, not 0.001\)"),
        ({"precision": "bfloat16"}, 0, r"precision \(float32, not bfloat16\)"),
        ({}, 1, r"seed \(0, not 1\)"),
    ],
)
def test_a_checkpoint_of_another_training_is_refused_by_name(
    pairs: PairsInMemory, tmp_path: Path, changes: dict[str, float], seed: int, named: str
) -> None:
    run(pairs, tmp_path, replace(PLAN, epochs=4))
    with pytest.raises(
        TrainingError, match=f"was made with another {named}; train with the same options"
    ):
        run(pairs, tmp_path, replace(PLAN, **changes), seed)
    other = PairsInMemory(pairs.names, pairs.images + 1e-6, pairs.targets, pairs.target_of)
    with pytest.raises(TrainingError, match="was made with another data"):
        run(other, tmp_path)


@pytest.mark.parametrize("content", [b"", b"noise", b"PK\x03\x04"])
def test_a_damaged_checkpoint_is_named(
    pairs: PairsInMemory, tmp_path: Path, content: bytes
) -> None:
    run(pairs, tmp_path)
    (tmp_path / CHECKPOINT).write_bytes(content)
    with pytest.raises(TrainingError, match="is damaged; delete it and train again"):
        run(pairs, tmp_path)


def test_a_checkpoint_with_a_flipped_bit_is_refused_or_the_same(
    pairs: PairsInMemory, tmp_path: Path
) -> None:
    expected, _ = run(pairs, tmp_path)
    content, refused = (tmp_path / CHECKPOINT).read_bytes(), 0
    for place in range(0, len(content), len(content) // 16):
        (tmp_path / CHECKPOINT).write_bytes(
            content[:place] + bytes([content[place] ^ 64]) + content[place + 1 :]
        )
        try:
            assert equal(run(pairs, tmp_path)[0], expected)
        except TrainingError:
            refused += 1
    assert refused > 8


def test_a_checkpoint_that_cannot_be_written_is_named(pairs: PairsInMemory, tmp_path: Path) -> None:
    (tmp_path / CHECKPOINT).with_suffix(".tmp").mkdir()
    with pytest.raises(TrainingError, match="cannot write .*; free some space and train again"):
        run(pairs, tmp_path)


def test_a_loss_that_is_no_number_leaves_the_last_checkpoint(
    pairs: PairsInMemory, tmp_path: Path
) -> None:
    with pytest.raises(TrainingError, match=r"loss of epoch 1 is not a number; .*learning_rate"):
        run(pairs, tmp_path, replace(PLAN, learning_rate=1e30))
    assert not list(tmp_path.iterdir())


def test_what_is_advised_for_a_loss_that_is_no_number_can_be_done(
    pairs: PairsInMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    plan = replace(PLAN, learning_rate=1e-3)
    inner = training.losses
    n_calls = 0

    def failing(*arguments: object, masked_depth: bool) -> tuple[torch.Tensor, torch.Tensor]:
        nonlocal n_calls
        n_calls += 1
        depth, mask = inner(*arguments, masked_depth=masked_depth)  # type: ignore[arg-type]
        return (depth * float("nan") if n_calls == 3 else depth), mask

    with monkeypatch.context() as patch:
        patch.setattr(training, "losses", failing)
        with pytest.raises(TrainingError, match="not a number") as raised:
            run(pairs, tmp_path, plan)
    checkpoint = tmp_path / CHECKPOINT
    smaller = re.search(r"learning_rate=(\S+)", str(raised.value))
    assert smaller is not None and 0 < float(smaller[1]) < plan.learning_rate
    assert f"delete {checkpoint}, and train" in str(raised.value)
    checkpoint.unlink()
    run(pairs, tmp_path, replace(plan, learning_rate=float(smaller[1])))


def test_a_device_that_is_not_here_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(
        ConfigurationError, match="has no device 'cuda' here; pass -o device=cpu or -o device=auto"
    ):
        device_named("cuda")
    assert device_named("cpu") == CPU
    assert resolved(Schedule(), CPU).precision in ("float32", "bfloat16")
