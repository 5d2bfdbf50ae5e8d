"""Gathering of training pairs in memory, cached on disk: making many of them takes longer than an epoch."""

from __future__ import annotations

import io
import itertools
import json
import shutil
import time
import tokenize
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from benchmark.api.learning import TrainingData
from learned.paired.pairs import Pairs, gather, joined
from learned.training.checkpoint import write

RUN = 512
"""Pairs per file, a few seconds of work that an interruption may cost; fewer pairs are gathered without a file."""

TELL_SECONDS = 20.0
"""Seconds between progress messages."""

_FOLDER = "gathered"


def gather_kept(data: TrainingData, resolution: int, crop: bool, folder: Path, say: Callable[[str], None]) -> Pairs:
    """Load all pairs of a training into memory, downsampled, from files if they were gathered before.

    Parameters
    ----------
    data
        Training data.
    resolution
        Pixels per side.
    crop
        Whether images and targets are cropped to the body.
    folder
        Folder of the model; the files go into a subfolder, see :func:`forget`.
    say
        Called with each progress message.

    Raises
    ------
    TrainingError
        If there is no pair, or a file cannot be written.
    """
    recipe = json.dumps({"data": data.digest, "resolution": resolution, "crop": crop}, sort_keys=True)
    runs: list[Pairs] = []
    while (run := _read(_path(folder, len(runs)), recipe)) is not None:
        runs.append(run)
    count = RUN * len(runs)
    if count:
        say(f"found {count} pairs that were gathered before")
    reported = began = time.perf_counter()
    gathered_before = count
    pairs = data.pairs(count)
    while some := list(itertools.islice(pairs, RUN)):
        runs.append(gather(some, resolution, crop))
        count += len(some)
        if len(some) == RUN:
            _write(_path(folder, len(runs) - 1), runs[-1], recipe)
        if (now := time.perf_counter()) - reported > TELL_SECONDS:
            left = (now - began) / (count - gathered_before) * (data.n_pairs - count)
            say(f"gathered {count} of {data.n_pairs} pairs, about {left:.0f} s left")
            reported = now
    return joined(runs) if runs else gather((), resolution, crop)


def forget(folder: Path) -> None:
    """Remove the files, which a finished model no longer needs."""
    shutil.rmtree(folder / _FOLDER, ignore_errors=True)


def _path(folder: Path, run: int) -> Path:
    return folder / _FOLDER / f"{run:05d}.npz"


def _write(path: Path, pairs: Pairs, recipe: str) -> None:
    path.parent.mkdir(exist_ok=True)
    content = io.BytesIO()
    np.savez_compressed(
        content,
        recipe=np.array(recipe),
        identifiers=np.array(pairs.identifiers),
        images=pairs.images.numpy(),
        targets=pairs.targets.numpy(),
        target_of=pairs.target_of.numpy(),
    )
    write(path, content.getvalue())


def _read(path: Path, recipe: str) -> Pairs | None:
    """Return the pairs of a file, or None if it is missing, damaged, or of another recipe."""
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["recipe"]) != recipe:
                return None
            tensors = (torch.from_numpy(file[name]) for name in ("images", "targets", "target_of"))
            return Pairs(tuple(file["identifiers"].tolist()), *tensors)
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, tokenize.TokenError):
        return None
