"""Pairs on disk: made once, in steps, and equal to those in memory but for rounding."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmark.api.learning import Bodies
from benchmark.errors import TrainingError
from learned.pairs import PairsOnDisk, gather, keep
from tests.learned.toy import BUILDS, Image, ellipsoid, quiet

ROUNDING = 2**-13
"""Half the distance of two numbers of half precision just below a half."""


def images(number: int) -> Iterable[Image]:
    width, height = list(BUILDS.values())[number]
    return [ellipsoid(width, height, x=x, thickness=0.05) for x in (0.0, 0.1, 0.2)]


BODIES = Bodies(names=tuple(BUILDS), n_images=3, images=images, recipe="toy")


def kept(folder: Path, bodies: Bodies = BODIES) -> PairsOnDisk:
    return keep(bodies, 32, False, folder, quiet)


def test_pairs_on_disk_are_those_in_memory_in_half_precision(tmp_path: Path) -> None:
    ours, others = kept(tmp_path / "pairs"), gather(BODIES.pairs(), 9, 32)
    assert ours.names == others.names
    rows = torch.tensor([8, 0, 4])
    for mine, theirs in zip(ours[rows], others[rows], strict=True):
        assert mine.shape == theirs.shape and mine.dtype == theirs.dtype
        assert torch.allclose(mine, theirs, rtol=0, atol=ROUNDING)
        assert torch.equal(mine > 0, theirs > 0)


def test_targets_on_disk_are_stretched_like_those_in_memory(tmp_path: Path) -> None:
    ours = kept(tmp_path / "pairs").stretched()
    others = gather(BODIES.pairs(), 9, 32).stretched()
    assert ours.scale.mean == pytest.approx(others.scale.mean, abs=1e-5)
    assert ours.scale.factor == pytest.approx(others.scale.factor, rel=1e-3)
    rows = torch.arange(9)
    assert torch.allclose(ours[rows][1], others[rows][1], rtol=0, atol=1e-3)
    seen = ours[rows][1][:, 0][ours[rows][1][:, 1] > 0]
    assert float(seen.min()) >= 0.1 - 1e-6 and float(seen.max()) <= 0.9 + 1e-6


def test_the_mean_on_disk_is_exact(tmp_path: Path) -> None:
    pairs = kept(tmp_path / "pairs")
    targets = pairs.depths[::3].astype(np.float64)
    depths = targets[targets > -0.5]
    assert pairs.stretched().scale.mean == float(np.mean(depths * 2**24)) / 2**24 + 0.5


def test_an_interrupted_call_goes_on_with_the_next_body(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("learned.pairs.KEEPING_SECONDS", 0.0)
    made: list[int] = []

    def stopping(number: int) -> Iterable[Image]:
        if number == 2 and 2 not in made:
            made.append(number)
            raise KeyboardInterrupt
        made.append(number)
        return images(number)

    bodies = Bodies(names=tuple(BUILDS), n_images=3, images=stopping, recipe="toy")
    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path / "pairs", bodies)
    again = kept(tmp_path / "pairs", bodies)
    assert made == [0, 1, 2, 2]
    assert again.digest() == kept(tmp_path / "whole").digest()
    assert kept(tmp_path / "pairs", bodies).digest() == again.digest()
    assert made == [0, 1, 2, 2]


def test_pairs_of_other_code_are_refused(tmp_path: Path) -> None:
    kept(tmp_path / "pairs")
    other = Bodies(names=BODIES.names, n_images=3, images=images, recipe="other")
    with pytest.raises(TrainingError, match="made by other code; delete that folder"):
        kept(tmp_path / "pairs", other)
    assert json.loads((tmp_path / "pairs" / "progress.json").read_text())["bodies"] == 3


def test_pairs_whose_images_were_deleted_are_made_again(tmp_path: Path) -> None:
    before = kept(tmp_path / "pairs").digest()
    (tmp_path / "pairs" / "depths.npy").unlink()

    def stopping(number: int) -> Iterable[Image]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kept(tmp_path / "pairs", replace(BODIES, images=stopping))
    assert kept(tmp_path / "pairs").digest() == before


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", None])
def test_pairs_whose_images_were_cut_short_are_made_again(
    tmp_path: Path, content: bytes | None
) -> None:
    before = kept(tmp_path / "pairs").digest()
    path = tmp_path / "pairs" / "depths.npy"
    path.write_bytes(path.read_bytes()[:-2] if content is None else content)
    assert kept(tmp_path / "pairs").digest() == before


def test_images_of_which_nothing_is_noted_are_made_again(tmp_path: Path) -> None:
    """As those of other code, of which only the note was deleted."""
    more = replace(BODIES, names=(*BODIES.names, "other"), images=lambda number: images(number % 3))
    kept(tmp_path / "pairs", more)
    (tmp_path / "pairs" / "progress.json").unlink()
    made = kept(tmp_path / "pairs")
    assert made.digest() == kept(tmp_path / "whole").digest()
    assert made.stretched().scale == kept(tmp_path / "whole").stretched().scale
    assert len(made.depths) == len(made) == 9


def test_a_training_waits_while_another_makes_its_images(tmp_path: Path) -> None:
    """The second begins before the first has made any image."""
    said: list[str] = []
    others: list[PairsOnDisk] = []
    waits = threading.Event()

    def say(text: str) -> None:
        said.append(text)
        waits.set()

    def second() -> None:
        others.append(keep(replace(BODIES, images=never), 32, False, tmp_path / "pairs", say))

    def never(number: int) -> Iterable[Image]:
        raise AssertionError(number)

    thread = threading.Thread(target=second)

    def first(number: int) -> Iterable[Image]:
        if number == 0:
            thread.start()
            assert waits.wait(60)
        return images(number)

    ours = kept(tmp_path / "pairs", replace(BODIES, images=first))
    thread.join(60)
    assert "waiting for another training" in said[0]
    assert others[0].digest() == ours.digest()


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="space cannot be reserved")
def test_a_disk_that_is_full_is_named_before_images_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left on device: .*depths.npy"):
        kept(tmp_path / "pairs")
    assert [path.name for path in (tmp_path / "pairs").iterdir()] == ["lock"]
