"""Is it the data or the architecture? The rule is in data-or-architecture.md beside this file.

``train RESULTS`` trains the eight cells one after the other, and copies each finished model to
``models/data-or-architecture``. It goes on where it was stopped. ``status`` writes the table of
cells into the page. ``evaluate RESULTS`` writes data-or-architecture.csv once all cells are
trained, and ``judge`` prints what the rule says of it.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import depth_range
import numpy as np
import pandas
import torch
from torch import Tensor

from benchmark.api.learning import CARD
from benchmark.protocols.pairs import data_of_training
from benchmark.protocols.trainings import SAMPLED_PEOPLE, TRAININGS
from benchmark.text import say
from learned.fitting import train
from learned.methods import Learned
from learned.pairs import keep

HERE = Path(__file__).parent
PAGE = HERE / "data-or-architecture.md"
SCORES = HERE / "data-or-architecture.csv"
MODELS = HERE / "models" / "data-or-architecture"

PREDICTED = "as predicted"
L2 = "as predicted, L2"

LEAST_T = 3.11
"""Least t of a difference over twelve bodies, with 11 degrees of freedom."""

IMAGES = 70_000
"""Images that each network is trained on, repeated ones included."""

NETWORKS = {"wide-extra": "global code", "literal": "the paper's network"}
DATA = {"people-fold-0": "200 pairs of fold 0", SAMPLED_PEOPLE: "70 000 pairs of random people"}
REPEATS = {"people-fold-0": 350, SAMPLED_PEOPLE: 1}
SEEDS = (0, 1)

RECIPE = {
    "resolution": 128,
    "epochs": 1,
    "early_epochs": 0,
    "batch": 32,
    "learning_rate": 1e-3,
    "precision": "bfloat16",
    "stretch_depth": True,
    "masked_depth": True,
    "cosine": True,
    "threads": 1,
}


@dataclass(frozen=True)
class Cell:
    """One training.

    Parameters
    ----------
    data
        Name of the training data.
    network
        Name of the configuration of the network.
    seed
        Seed of the weights and of the order of the pairs.
    """

    data: str
    network: str
    seed: int

    @property
    def folder(self) -> Path:
        """Folder of its model, relative to that of all models."""
        return Path(self.data) / f"{self.network}-seed{self.seed}"

    def train(self, results: Path) -> None:
        """Train the model into a folder of results, and copy it to the models of the experiment."""
        data = data_of_training(TRAININGS[self.data], None, say)
        folder = results / "models" / self.folder
        options: dict[str, Any] = {**RECIPE, "repeat": REPEATS[self.data]}
        train(self.network, self.seed, data, folder, options, say)
        shutil.copytree(folder, MODELS / self.folder, dirs_exist_ok=True)


def cells() -> Iterator[Cell]:
    """Yield all cells in the order in which they are trained."""
    for data in DATA:
        for network in NETWORKS:
            for seed in SEEDS:
                yield Cell(data, network, seed)


def status() -> str:
    """Return the table of cells: which are trained, where, and how long it took."""
    lines = [
        "| data | network | seed | trained | commit | core minutes |",
        "|---|---|---|---|---|---|",
    ]
    for cell in cells():
        path = MODELS / cell.folder / CARD
        facts = ["not yet", "", ""]
        if path.is_file():
            card = json.loads(path.read_text(encoding="utf-8"))
            minutes = round(card["core_seconds"] / 60)
            facts = [card["finished"][:10], card["commit"], str(minutes)]
        row = [DATA[cell.data], NETWORKS[cell.network], str(cell.seed), *facts]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def write_status() -> None:
    """Write the table of cells into the page, between its marks."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition("<!-- cells -->\n")
    _, _, after = rest.partition("<!-- end of cells -->\n")
    marked = f"<!-- cells -->\n{status()}\n<!-- end of cells -->\n"
    PAGE.write_text(before + marked + after, encoding="utf-8")


def finished_cells() -> list[Cell]:
    """Return all cells; raise ``SystemExit`` before all of them are trained, so that none is judged
    alone.
    """
    missing = [str(cell.folder) for cell in cells() if not (MODELS / cell.folder / CARD).is_file()]
    if missing:
        raise SystemExit(f"no model is evaluated before all are trained; missing: {missing}")
    return list(cells())


@cache
def average_body(data: str, results: Path) -> Tensor:
    """Return the mean depth of the bodies of some training data, as
    :func:`depth_range.average_body` does.
    """
    if data != SAMPLED_PEOPLE:
        return depth_range.average_body(0)
    bodies = data_of_training(TRAININGS[data], None, say).bodies
    assert bodies is not None
    resolution = depth_range.RESOLUTION
    pairs = keep(bodies, resolution, False, results / "models" / data / f"pairs-{resolution}", say)
    depth = torch.zeros(resolution, resolution, dtype=torch.float64)
    mask = torch.zeros_like(depth)
    for rows in pairs.target_of.unique().split(1000):
        _, targets = pairs[rows]
        depth += (targets[:, 0] * targets[:, 1]).double().sum(0)
        mask += targets[:, 1].double().sum(0)
    return depth_range.spread(depth / mask.clamp(min=1), mask)


def evaluate_cell(cell: Cell, results: Path) -> pandas.DataFrame:
    """Return the scores of each body for a cell and its controls."""
    torch.set_num_threads(1)
    truth = depth_range.true_images(depth_range.RESOLUTION)
    average = average_body(cell.data, results)
    network = Learned(configuration=cell.network).load(MODELS / cell.folder)  # type: ignore[arg-type]
    given = depth_range.predictions(network)
    settings = {
        PREDICTED: given,
        depth_range.AVERAGE: [torch.stack([average, mask]) for _, mask in given],
        depth_range.FLAT: [torch.stack([torch.full_like(mask, 0.5), mask]) for _, mask in given],
        depth_range.TRUE: [
            torch.stack([depth_range.spread(*true), mask])
            for (_, mask), true in zip(given, truth, strict=True)
        ],
    }
    facts = {"data": cell.data, "network": cell.network, "seed": cell.seed}
    found: list[pandas.DataFrame] = []
    for setting, images in settings.items():
        scores = depth_range.ranked(images)
        found.append(depth_range.scored({**facts, "setting": setting}, scores, images, truth))
    scores = depth_range.by_pixels(given)
    found.append(depth_range.scored({**facts, "setting": L2}, scores, given, truth))
    return pandas.concat(found)


def evaluate(results: Path) -> None:
    """Write the scores of each body for all cells and their controls; two processes share them."""
    finished = finished_cells()
    with ProcessPoolExecutor(max_workers=2) as pool:
        found = list(pool.map(evaluate_cell, finished, [results] * len(finished)))
    pandas.concat(found).to_csv(SCORES, index=False, lineterminator="\n")


def difference(first: pandas.DataFrame, second: pandas.DataFrame) -> tuple[float, set[float]]:
    """Return t of the paired differences over bodies, and the signs of their mean for all choices
    of seeds.

    Parameters
    ----------
    first, second
        FT of each body (rows) and seed (columns).
    """
    gains = first.mean(axis=1) - second.mean(axis=1)
    signs = set()
    for one in first:
        for other in second:
            signs.add(float(np.sign((first[one] - second[other]).mean())))
    return float(gains.mean() / gains.sem()), signs


def has_effect(levels: Sequence[tuple[pandas.DataFrame, pandas.DataFrame]]) -> bool:
    """Return whether a factor has an effect by the rule, from its two cells at each level of the
    other one.
    """
    found = [difference(*level) for level in levels]
    signs = set[float]().union(*(of_level for _, of_level in found))
    return all(abs(t) > LEAST_T for t, _ in found) and len(signs) == 1


def judge() -> None:
    """Print the means of all settings, and what the rule says."""
    scores = pandas.read_csv(SCORES)
    facts = ["data", "network", "setting"]
    print(scores.groupby([*facts, "seed"], sort=False)[[*depth_range.MEASURES, "error"]].mean())

    def ft(data: str, network: str, setting: str = PREDICTED) -> pandas.DataFrame:
        rows = scores[
            (scores["data"] == data)
            & (scores["network"] == network)
            & (scores["setting"] == setting)
        ]
        return rows.pivot(index="body", columns="seed", values="FT")

    (small, large) = DATA
    (code, paper) = NETWORKS
    data = [(ft(large, network), ft(small, network)) for network in NETWORKS]
    architecture = [(ft(of, code), ft(of, paper)) for of in DATA]
    for name, levels in (("data", data), ("architecture", architecture)):
        for level in levels:
            t, signs = difference(*level)
            gain = (level[0].mean(axis=1) - level[1].mean(axis=1)).mean()
            print(f"{name}: FT {gain:+.4f}, t(11) {t:+.2f}, signs over seeds {sorted(signs)}")
        print(f"{name} has an effect: {has_effect(levels)}")
    errors = scores.groupby([*facts, "seed"])["error"].mean()
    for of in DATA:
        for network in NETWORKS:
            mine = ft(of, network)
            average = ft(of, network, depth_range.AVERAGE)
            t, _ = difference(mine, average)
            exceeds = all((mine[seed] - average[seed]).mean() > 0 for seed in SEEDS)
            is_below = all(
                errors[of, network, PREDICTED, seed]
                < errors[of, network, depth_range.AVERAGE, seed]
                for seed in SEEDS
            )
            sees = t > LEAST_T and exceeds and is_below
            print(
                f"{network} on {of}: t(11) against the average body {t:+.2f}, "
                f"sees the relief: {sees}"
            )


if __name__ == "__main__":
    torch.set_num_threads(1)
    what, *rest = sys.argv[1:]
    if what == "train":
        for each in cells():
            if not (MODELS / each.folder / CARD).is_file():
                say(f"{each.folder}")
                each.train(Path(rest[0]))
                write_status()
    elif what == "status":
        write_status()
    elif what == "evaluate":
        evaluate(Path(rest[0]))
    elif what == "judge":
        judge()
    else:
        raise SystemExit(__doc__)
