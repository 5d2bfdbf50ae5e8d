"""The loop: it fits what it is shown, gives the same weights however often it was stopped, and says why it stops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmark.errors import ConfigurationError, TrainingError
from learned.paired import training
from learned.paired.configuration import Configuration
from learned.paired.network import ProgressiveNetwork
from learned.paired.pairs import Pairs, gather
from learned.paired.schedule import Schedule
from learned.paired.training import train
from learned.training import loop
from learned.training.loop import Trained, measures
from learned.training.machine import device_named
from tests.learned.toy import BUILDS, TINY, quiet, run_in, toy_pairs

CPU = torch.device("cpu")
PLAN = Schedule(resolution=32, epochs=4, batch=2, early_epochs=1, learning_rate=3e-3, jitter=20, precision="float32")


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    """Six pairs of three ellipsoids, at 32 x 32."""
    return gather(toy_pairs(BUILDS), 32)


def run(
    pairs: Pairs,
    folder: Path,
    plan: Schedule = PLAN,
    *,
    seed: int = 0,
    network: Configuration = TINY,
    say: Callable[[str], None] = quiet,
) -> Trained[Any]:
    return train(network, plan, pairs, None, run_in(folder, seed, say))


def equal(first: Trained[Any], second: Trained[Any]) -> bool:
    ours, others = first.network.state_dict(), second.network.state_dict()
    return all(torch.equal(ours[name], others[name]) for name in ours)


def names_of_batch(pairs: Pairs, epoch: int, batch: int, size: int = PLAN.batch) -> str:
    """Names of the pairs in a batch, both counted from 1, as the order of the pairs is promised."""
    order = np.random.default_rng([0, epoch - 1]).permutation(len(pairs))
    return ", ".join(pairs.identifiers[row] for row in order[(batch - 1) * size : batch * size])


def test_a_loss_that_is_not_a_number_names_its_images_and_leaves_the_checkpoint(
    pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "undisturbed").mkdir()
    expected = run(pairs, tmp_path / "undisturbed")
    monkeypatch.setattr(loop, "CHECKPOINT_SECONDS", 0.0)
    calls = 0

    def broken(*arguments: Any) -> tuple[Tensor, Tensor]:
        nonlocal calls
        calls += 1
        depth, mask = losses(*arguments)
        return (depth * float("nan"), mask) if calls == 3 * 2 + 2 else (depth, mask)

    losses = training.losses
    with monkeypatch.context() as patch:
        patch.setattr(training, "losses", broken)
        with pytest.raises(TrainingError) as caught:
            run(pairs, tmp_path)
    names = names_of_batch(pairs, epoch=3, batch=2)
    assert caught.value.problem == f"the loss is not a number in epoch 3, batch 2 ({names})"
    assert "learning_rate" in caught.value.hint
    messages: list[str] = []
    assert equal(run(pairs, tmp_path, say=messages.append), expected)
    assert "going on after epoch 2 of 4" in messages


def test_a_huge_step_size_ends_in_a_named_error(pairs: Pairs, tmp_path: Path) -> None:
    plan = Schedule(resolution=32, epochs=4, batch=2, learning_rate=1e30, precision="float32")
    with pytest.raises(TrainingError, match=r"not a number in epoch 1, batch [23] .*learning_rate"):
        run(pairs, tmp_path, plan)


OUT_OF_MEMORY = (
    torch.OutOfMemoryError("CUDA out of memory"),
    MemoryError(),
    RuntimeError("[enforce fail at alloc_cpu.cpp:117] DefaultCPUAllocator: can't allocate memory"),
)


def out_of_memory_above(monkeypatch: pytest.MonkeyPatch, largest: int, error: BaseException) -> None:
    """Let the network run out of memory for batches of more than this many images."""
    forward = ProgressiveNetwork.forward

    def limited(self: ProgressiveNetwork, image: Tensor) -> Tensor:
        if len(image) > largest:
            raise error
        return forward(self, image)

    monkeypatch.setattr(ProgressiveNetwork, "forward", limited)


@pytest.mark.parametrize("error", OUT_OF_MEMORY[::2], ids=lambda error: type(error).__name__)
def test_out_of_memory_halves_the_batch(
    pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    (tmp_path / "half").mkdir()
    half = run(pairs, tmp_path / "half", Schedule(**(vars(PLAN) | {"batch": 2})))
    out_of_memory_above(monkeypatch, 2, error)
    messages: list[str] = []
    result = run(pairs, tmp_path, Schedule(**(vars(PLAN) | {"batch": 4})), say=messages.append)
    assert "out of memory; going on with batches of 2" in messages
    assert result.progress.batch == 2
    assert equal(result, half)


def test_no_memory_for_half_the_batch_either(pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out_of_memory_above(monkeypatch, 0, OUT_OF_MEMORY[0])
    with pytest.raises(TrainingError, match="memory does not suffice for batches of 1; lower --resolution or --batch"):
        run(pairs, tmp_path)


def test_no_gpu_is_a_named_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ConfigurationError, match="no GPU is here.*; pass --device cpu or auto"):
        device_named("cuda")
    assert device_named("auto") == device_named("cpu") == CPU


def test_every_pair_counts_the_same_in_the_losses_of_an_epoch(
    pairs: Pairs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Six pairs in batches of four and two, whose losses are made to be 1 and 4.
    monkeypatch.setattr(
        training,
        "losses",
        lambda prediction, _target, _kind: (0 * prediction.sum() + (1 if len(prediction) == 4 else 4),) * 2,
    )
    plan = Schedule(resolution=32, epochs=1, batch=4, early_epochs=1, beta=3.0, precision="float32")
    (row,) = run(pairs, tmp_path, plan).progress.history
    assert row["depth loss"] == row["mask loss"] == (4 * 1 + 2 * 4) / 6
    assert row["loss"] == pytest.approx(2 * 0.01 + 2 * 3)


def test_measures_by_hand() -> None:
    target = torch.tensor([[[0.5, 0.5], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]]])
    prediction = torch.tensor([[[0.25, 0.5], [0.0, 0.9]], [[0.9, 0.5], [0.2, 0.6]]])
    # Of the mask one pixel is hit, one is missed (a half is not above a half), and one is wrong.
    single = measures(prediction[None], target[None])
    assert single == {"mask overlap": pytest.approx(1 / 3), "depth error": pytest.approx(0.25)}
    both = measures(torch.stack([prediction, target]), torch.stack([target, target]))
    assert both == {"mask overlap": pytest.approx(2 / 3), "depth error": pytest.approx(0.25 / 3)}
