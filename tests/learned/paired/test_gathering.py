"""Pairs that were gathered are found again, and what is found is what would be gathered."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from benchmark.api.learning import TrainingData, TrainingPair
from benchmark.geometry.depth import SIZE
from learned.paired import gathering
from learned.paired.fitting import fit
from learned.paired.gathering import gather_kept
from learned.paired.pairs import Pairs, gather, seen_by
from tests.learned.toy import BUILDS, OPTIONS, TINY, files, quiet, toy_data, toy_pairs

RESOLUTION = 32


@pytest.fixture(autouse=True)
def short_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of six pairs make a file, so that one target is in the first file and behind it."""
    monkeypatch.setattr(gathering, "RUN", 3)


def watched(made: list[int], stop: int = 99) -> TrainingData:
    """The toy data, which notes the pairs that it makes and is interrupted before one of them."""

    def pairs(start: int = 0) -> Iterator[TrainingPair]:
        for place, pair in enumerate(itertools.islice(toy_pairs(BUILDS), start, None), start):
            if place == stop:
                raise KeyboardInterrupt
            made.append(place)
            yield pair

    return replace(toy_data(), pairs=pairs)


def assert_same(pairs: Pairs, expected: Pairs) -> None:
    assert pairs.identifiers == expected.identifiers
    assert torch.equal(pairs.images, expected.images)
    assert torch.equal(pairs.targets[pairs.target_of], expected.targets[expected.target_of])


def test_an_interrupted_gathering_goes_on_behind_what_it_has(tmp_path: Path) -> None:
    first: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        gather_kept(watched(first, stop=5), RESOLUTION, False, tmp_path, quiet)
    assert first == [0, 1, 2, 3, 4]
    again: list[int] = []
    messages: list[str] = []
    pairs = gather_kept(watched(again), RESOLUTION, False, tmp_path, messages.append)
    assert again == [3, 4, 5]
    assert messages == ["found 3 pairs that were gathered before"]
    assert_same(pairs, gather(toy_pairs(BUILDS), RESOLUTION))
    once_more: list[int] = []
    assert_same(gather_kept(watched(once_more), RESOLUTION, False, tmp_path, quiet), pairs)
    assert once_more == []


@pytest.mark.parametrize("change", ["data", "resolution", "crop", "damage", "truncation"])
def test_pairs_of_another_recipe_or_a_damaged_file_are_made_again(tmp_path: Path, change: str) -> None:
    gather_kept(watched([]), RESOLUTION, False, tmp_path, quiet)
    path = tmp_path / "gathered" / "00000.npz"
    gathered: list[int] = []
    data, resolution, crop = watched(gathered), RESOLUTION, change == "crop"
    if change == "data":
        data = replace(data, digest="ellipsoids 2")
    elif change == "resolution":
        resolution = 64
    elif change != "crop":
        content = path.read_bytes()
        path.write_bytes(b"noise" if change == "damage" else content[: len(content) // 2])
    pairs = gather_kept(data, resolution, crop, tmp_path, quiet)
    assert gathered[:3] == [0, 1, 2]
    assert_same(pairs, gather(toy_pairs(BUILDS), resolution, crop))


def test_a_cropped_image_shows_neither_size_nor_place() -> None:
    v, u = np.mgrid[:SIZE, :SIZE].astype(float)

    def dome(radius: int, row: int, column: int) -> NDArray[np.float32]:
        relief = np.clip(1 - ((v - row) ** 2 + (u - column) ** 2) / radius**2, 0, None)
        depth = 0.5 - np.sqrt(relief) * radius / SIZE
        return np.where(relief > 0, depth, 0).astype(np.float32)

    small, large = (seen_by(dome(*place), RESOLUTION, True) for place in ((60, 100, 300), (180, 250, 250)))
    assert not np.array_equal(
        *(seen_by(dome(*place), RESOLUTION, False) for place in ((60, 100, 300), (180, 250, 250)))
    )
    assert (small[1] == large[1]).mean() > 0.97
    both = (small[1] > 0) & (large[1] > 0)
    assert np.abs(small[0] - large[0])[both].mean() < 0.02


@pytest.mark.usefixtures("tiny")
def test_a_finished_model_keeps_no_pairs_and_is_the_same(tmp_path: Path, trained: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        fit(TINY.name, 0, watched([], stop=4), tmp_path, OPTIONS, quiet)
    assert files(tmp_path) == {"gathered"}
    gathered: list[int] = []
    fit(TINY.name, 0, watched(gathered), tmp_path, OPTIONS, quiet)
    assert gathered == [3, 4, 5]
    assert files(tmp_path) == files(trained)
    assert (tmp_path / "weights.safetensors").read_bytes() == (trained / "weights.safetensors").read_bytes()
