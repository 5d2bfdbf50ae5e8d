"""Checkpoints: what goes in comes out, and what is damaged, foreign or half written is found."""

from __future__ import annotations

import errno
import json
import re
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from benchmark.errors import TrainingError
from learned.training import checkpoint
from learned.training.checkpoint import CHECKPOINT, Checkpoint, Progress
from tests.learned.toy import files

RECIPE = {"seed": 0, "schedule": {"epochs": 9, "learning_rate": 1e-3}, "data": "ellipsoids"}
PROGRESS = Progress(epoch=3, batch=4, seconds=1.5, history=({"epoch": 1.0, "loss": 0.1}, {"epoch": 2.0, "loss": 1 / 3}))


def stepped(steps: int) -> tuple[nn.Module, torch.optim.Optimizer]:
    """A small network after some steps of Adam."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = nn.Sequential(nn.Conv2d(1, 4, 3), nn.LeakyReLU(0.2), nn.Conv2d(4, 2, 1))
    network = network.to(memory_format=torch.channels_last)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    image = torch.linspace(0, 1, 64).reshape(1, 1, 8, 8)
    for _ in range(steps):
        optimiser.zero_grad()
        network(image).square().mean().backward()
        optimiser.step()
    return network, optimiser


def test_the_file_is_safetensors_and_only_that(tmp_path: Path) -> None:
    Checkpoint(tmp_path, *stepped(1)).keep(PROGRESS, RECIPE)
    content = (tmp_path / CHECKPOINT).read_bytes()
    # Eight bytes tell the length of a JSON header; all that follows are numbers.
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    metadata = header.pop("__metadata__")
    assert json.loads(metadata["recipe"]) == RECIPE
    assert {entry["dtype"] for entry in header.values()} == {"F32"}
    assert 8 + length + max(entry["data_offsets"][1] for entry in header.values()) == len(content)
    assert files(tmp_path) == {CHECKPOINT}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"seed": 1}, "another seed"),
        ({"schedule": {"epochs": 10, "learning_rate": 1e-3}}, "another schedule"),
        ({"seed": 1, "data": "boxes"}, "another data, seed"),
        ({"extra": True}, "another extra"),
    ],
)
def test_another_recipe_is_refused_by_name(tmp_path: Path, change: dict[str, Any], named: str) -> None:
    network, optimiser = stepped(1)
    Checkpoint(tmp_path, network, optimiser).keep(PROGRESS, RECIPE)
    before = [parameter.clone() for parameter in network.parameters()]
    with pytest.raises(TrainingError, match=f"{named}; train with the same options, or delete the folder"):
        Checkpoint(tmp_path, network, optimiser).resume(RECIPE | change)
    assert all(torch.equal(old, new) for old, new in zip(before, network.parameters(), strict=True))


@pytest.mark.parametrize(("version", "fits"), [("1.13.1", False), ("%s+cu999", True), ("%s.1", False)])
def test_a_checkpoint_of_another_torch_is_refused_but_not_one_of_another_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: str, fits: bool
) -> None:
    Checkpoint(tmp_path, *stepped(1)).keep(PROGRESS, RECIPE)
    made, now = torch.__version__, version.replace("%s", torch.__version__.partition("+")[0])
    monkeypatch.setattr(checkpoint, "VERSION", now)
    if fits:
        assert Checkpoint(tmp_path, *stepped(0)).resume(RECIPE) == PROGRESS
    else:
        message = re.escape(f"was made with torch {made}, not {now}; install that version, or delete the checkpoint")
        with pytest.raises(TrainingError, match=message):
            Checkpoint(tmp_path, *stepped(0)).resume(RECIPE)


@pytest.mark.parametrize("damage", ["empty", "truncated header", "truncated", "noise", "other safetensors"])
def test_a_damaged_checkpoint_is_named(tmp_path: Path, damage: str) -> None:
    from safetensors.torch import save

    Checkpoint(tmp_path, *stepped(1)).keep(PROGRESS, RECIPE)
    path = tmp_path / CHECKPOINT
    content = path.read_bytes()
    path.write_bytes(
        {
            "empty": b"",
            "truncated header": content[:100],
            "truncated": content[:-10],
            "noise": bytes(range(256)) * 10,
            "other safetensors": save({"x": torch.zeros(1)}),
        }[damage]
    )
    with pytest.raises(TrainingError, match=f"{CHECKPOINT} is damaged.*; delete it and train again"):
        Checkpoint(tmp_path, *stepped(0)).resume(RECIPE)


def test_a_full_disk_leaves_the_last_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Checkpoint(tmp_path, *stepped(1)).keep(PROGRESS, RECIPE)
    before = (tmp_path / CHECKPOINT).read_bytes()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("benchmark.files.os.fsync", full)
    with pytest.raises(TrainingError, match="No space left on device; free some space and start again"):
        Checkpoint(tmp_path, *stepped(2)).keep(PROGRESS, RECIPE)
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert files(tmp_path) == {CHECKPOINT}
