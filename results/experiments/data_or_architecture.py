"""Is it the data or the architecture? The rule is in data-or-architecture.md beside this file.

``train RESULTS`` trains the eight cells one after the other, and copies each finished model to
``models/data-or-architecture``. It goes on where it was stopped. ``status`` writes the table of
cells into the page. ``evaluate RESULTS`` writes data-or-architecture.csv once all cells are
trained, and ``judge`` writes into the page what the rule says of it.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import product
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
from benchmark.report.formats import markdown_table
from benchmark.report.notation import hundredths, signed_hundredths
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


def write_between(mark: str, text: str) -> None:
    """Write a text into the page, between the marks of its place."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n")
    _, _, after = rest.partition(f"<!-- end of {mark} -->\n")
    marked = f"<!-- {mark} -->\n{text}\n<!-- end of {mark} -->\n"
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


@dataclass(frozen=True)
class Judgement:
    """What the rule says of the scores.

    Parameters
    ----------
    scores
        The table that ``evaluate`` writes.
    """

    scores: pandas.DataFrame

    def values(
        self, measure: str, data: str, network: str, setting: str = PREDICTED
    ) -> pandas.DataFrame:
        """Return a measure of each body (rows) and seed (columns)."""
        rows = self.scores[
            (self.scores["data"] == data)
            & (self.scores["network"] == network)
            & (self.scores["setting"] == setting)
        ]
        return rows.pivot(index="body", columns="seed", values=measure)

    def ft(self, data: str, network: str, setting: str = PREDICTED) -> pandas.DataFrame:
        """Return FT of each body (rows) and seed (columns)."""
        return self.values("FT", data, network, setting)

    def levels_of_data(self) -> dict[str, tuple[pandas.DataFrame, pandas.DataFrame]]:
        """Return FT on random people and on fold 0, for each network."""
        fold, random_people = DATA
        return {
            network: (self.ft(random_people, network), self.ft(fold, network))
            for network in NETWORKS
        }

    def levels_of_architecture(self) -> dict[str, tuple[pandas.DataFrame, pandas.DataFrame]]:
        """Return FT of the global code and of the paper's network, for each data."""
        code, paper = NETWORKS
        return {data: (self.ft(data, code), self.ft(data, paper)) for data in DATA}

    def against_average_body(self, data: str, network: str) -> float:
        """Return t of FT of a cell minus that of the average body in its masks."""
        average = self.ft(data, network, depth_range.AVERAGE)
        return difference(self.ft(data, network), average)[0]

    def sees_the_relief(self, data: str, network: str) -> bool:
        """Return whether the rule lets us write that the network sees the relief."""
        gains = self.ft(data, network) - self.ft(data, network, depth_range.AVERAGE)
        errors = self.values("error", data, network)
        errors_of_average = self.values("error", data, network, depth_range.AVERAGE)
        is_higher = bool((gains.mean() > 0).all())
        is_nearer = bool((errors.mean() < errors_of_average.mean()).all())
        return self.against_average_body(data, network) > LEAST_T and is_higher and is_nearer


def score_table(judged: Judgement) -> list[str]:
    """Return the scores of all cells and of their controls as lines of a table."""
    head = ["cell", "FT", "seed 0", "seed 1", "average body", "flat", "true depth", "L2"]
    body = []
    for data, network in product(DATA, NETWORKS):
        of_seeds = judged.ft(data, network).mean()
        scores = [of_seeds.mean(), *of_seeds]
        for setting in (depth_range.AVERAGE, depth_range.FLAT, depth_range.TRUE, L2):
            scores.append(judged.ft(data, network, setting).to_numpy().mean())
        errors = []
        for setting in (PREDICTED, depth_range.AVERAGE):
            error = judged.values("error", data, network, setting).to_numpy().mean()
            errors.append(f"{error:.4f}".removeprefix("0"))
        body.append([cell_title(data, network), *map(hundredths, scores), *errors])
    return markdown_table([*head, "error", "error of the average body"], body)


def comparison_table(judged: Judgement) -> list[str]:
    """Return the four differences that the rule judges as lines of a table."""
    head = ["difference of FT", "mean", "t(11)", "signs over the choices of seeds"]
    pairs = {}
    for network, pair in judged.levels_of_data().items():
        pairs[f"random people minus fold 0, {NETWORKS[network]}"] = pair
    for data, pair in judged.levels_of_architecture().items():
        pairs[f"global code minus the paper's network, {DATA[data]}"] = pair
    body = []
    for title, (first, second) in pairs.items():
        t, signs = difference(first, second)
        mean = (first - second).to_numpy().mean()
        words = " and ".join("+" if sign > 0 else "-" for sign in sorted(signs, reverse=True))
        body.append([title, signed_hundredths(mean), f"{t:+.2f}", words])
    return markdown_table(head, body)


def relief_table(judged: Judgement) -> list[str]:
    """Return what the rule says of the relief of each cell as lines of a table."""
    body = []
    for data, network in product(DATA, NETWORKS):
        t = judged.against_average_body(data, network)
        sees = "yes" if judged.sees_the_relief(data, network) else "not shown"
        body.append([cell_title(data, network), f"{t:+.2f}", sees])
    return markdown_table(["cell", "t(11) against the average body", "sees the relief"], body)


def cell_title(data: str, network: str) -> str:
    """Return the data and the network of a cell in words."""
    return f"{NETWORKS[network]}, {DATA[data]}"


def results() -> str:
    """Return the three tables of what came out."""
    judged = Judgement(pandas.read_csv(SCORES))
    tables = [score_table(judged), comparison_table(judged), relief_table(judged)]
    return "\n\n".join("\n".join(lines) for lines in tables)


if __name__ == "__main__":
    torch.set_num_threads(1)
    what, *rest = sys.argv[1:]
    if what == "train":
        for each in cells():
            if not (MODELS / each.folder / CARD).is_file():
                say(f"{each.folder}")
                each.train(Path(rest[0]))
                write_between("cells", status())
    elif what == "status":
        write_between("cells", status())
    elif what == "evaluate":
        evaluate(Path(rest[0]))
    elif what == "judge":
        write_between("results", results())
    else:
        raise SystemExit(__doc__)
