"""Pairs that were gathered are found again, and what is found is what would be gathered."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from benchmark.api.learning import TrainingData, TrainingPair
from learned.paired import gathering
from learned.paired.fitting import fit
from learned.paired.gathering import gather_kept
from learned.paired.pairs import Pairs, gather
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


def assert_same(found: Pairs, expected: Pairs) -> None:
    assert found.identifiers == expected.identifiers
    assert torch.equal(found.images, expected.images)
    assert torch.equal(found.targets[found.target_of], expected.targets[expected.target_of])


def test_an_interrupted_gathering_goes_on_behind_what_it_has(tmp_path: Path) -> None:
    first: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        gather_kept(watched(first, stop=5), RESOLUTION, tmp_path, quiet)
    assert first == [0, 1, 2, 3, 4]
    again: list[int] = []
    said: list[str] = []
    found = gather_kept(watched(again), RESOLUTION, tmp_path, said.append)
    assert again == [3, 4, 5]
    assert said == ["found 3 pairs that were gathered before"]
    assert_same(found, gather(toy_pairs(BUILDS), RESOLUTION))
    once_more: list[int] = []
    assert_same(gather_kept(watched(once_more), RESOLUTION, tmp_path, quiet), found)
    assert once_more == []


@pytest.mark.parametrize("change", ["data", "resolution", "damage", "truncation"])
def test_pairs_of_another_recipe_or_a_damaged_file_are_made_again(tmp_path: Path, change: str) -> None:
    gather_kept(watched([]), RESOLUTION, tmp_path, quiet)
    path = tmp_path / "gathered" / "00000.npz"
    made: list[int] = []
    data, resolution = watched(made), RESOLUTION
    if change == "data":
        data = replace(data, digest="ellipsoids 2")
    elif change == "resolution":
        resolution = 64
    else:
        content = path.read_bytes()
        path.write_bytes(b"noise" if change == "damage" else content[: len(content) // 2])
    found = gather_kept(data, resolution, tmp_path, quiet)
    assert made[:3] == [0, 1, 2]
    assert_same(found, gather(toy_pairs(BUILDS), resolution))


@pytest.mark.usefixtures("tiny")
def test_a_finished_model_keeps_no_pairs_and_is_the_same(tmp_path: Path, trained: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        fit(TINY.name, 0, watched([], stop=4), tmp_path, OPTIONS, quiet)
    assert files(tmp_path) == {"gathered"}
    made: list[int] = []
    fit(TINY.name, 0, watched(made), tmp_path, OPTIONS, quiet)
    assert made == [3, 4, 5]
    assert files(tmp_path) == files(trained)
    assert (tmp_path / "weights.safetensors").read_bytes() == (trained / "weights.safetensors").read_bytes()
