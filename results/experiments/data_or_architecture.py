"""Is it the data or the architecture? The rule is in data-or-architecture.md beside this file.

``train RESULTS`` trains the eight cells one after the other, and copies each finished model to
``models/data-or-architecture``. It goes on where it was stopped. ``status`` writes the table of
cells into the page.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from benchmark.api.learning import CARD
from benchmark.protocols.pairs import training_data
from benchmark.protocols.trainings import SAMPLED_PEOPLE, TRAININGS
from benchmark.text import say
from learned.fitting import train

HERE = Path(__file__).parent
PAGE = HERE / "data-or-architecture.md"
MODELS = HERE / "models" / "data-or-architecture"

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
        data = training_data(TRAININGS[self.data], None, say)
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


if __name__ == "__main__":
    torch.set_num_threads(1)
    what, *rest = sys.argv[1:]
    if what == "train":
        for each in cells():
            if not (MODELS / each.folder / CARD).is_file():
                say(f"{each.folder}")
                each.train(Path(rest[0]))
    elif what == "status":
        write_status()
    else:
        raise SystemExit(__doc__)
