"""``python -m tools.studies.continued``: what an idea adds to a training that is well under way.

The shipped weights are trained on, with and without each idea, on the same bodies for as many steps, and
measured on the validation bodies of :mod:`tools.studies.people`. Differences to going on as before are taken body by
body. A run that was stopped goes on where it was. Writes ``results/continued.json``.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Mapping, Sequence  # noqa: E402
from dataclasses import asdict, replace  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402

from benchmark.api.streaming import Fresh, MakesFresh  # noqa: E402
from benchmark.datasets.varied.sampler import Sampler  # noqa: E402
from benchmark.datasets.varied.wide import WideSampler  # noqa: E402
from benchmark.geometry.depth import SIZE  # noqa: E402
from benchmark.jobs.pairs.stream import TRAINED, VIEWS  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.system.files import write_text  # noqa: E402
from learned.streamed.configuration import STREAMED  # noqa: E402
from learned.streamed.methods import StreamedLearner  # noqa: E402
from learned.streamed.network import build_streamed  # noqa: E402
from learned.streamed.training import train_streamed  # noqa: E402
from learned.training.checkpoint import SNAPSHOTS, keep_snapshot, newest_snapshot  # noqa: E402
from learned.training.loop import Plan, TrainingRun  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.architectures import RANKED, ArtefactReader  # noqa: E402
from tools.studies.people import BODIES, GALLERY, POSES, Row, Weights, interval, measured  # noqa: E402

STEPS = 3000
FOLDER = Path("build/continued")
FIGURES = Path("results/continued.json")
BEFORE, AS_BEFORE = "not trained on", "as before"
say = partial(print, flush=True)


class Idea(NamedTuple):
    """Fields of the configuration and of the plan that differ."""

    configuration: Mapping[str, Any] = {}
    plan: Mapping[str, Any] = {}


IDEAS = {
    AS_BEFORE: Idea(),
    "`one_form` .01": Idea(configuration={"one_form": 0.01}),
    "`one_form` .05": Idea(configuration={"one_form": 0.05}),
    "`gradient` 1": Idea(configuration={"gradient": 1.0}),
    "a third of the step size": Idea(plan={"learning_rate": Plan.learning_rate / 3}),
}


@click.command()
@click.option("--steps", type=click.IntRange(1), default=STEPS, show_default=True, help="Further steps of 16 bodies.")
@click.option("--only", multiple=True, metavar="IDEA", help="Ideas; all by default.")
def main(steps: int, only: Sequence[str]) -> None:
    """Train on with each idea, and measure what is not measured yet."""
    torch.set_num_threads(1)
    gallery = ArtefactReader(Sampler(RANKED, poses=POSES), GALLERY)(0, BODIES, SIZE)
    fresh = WideSampler(seed=TRAINED, views=VIEWS)
    for name in only or IDEAS:
        compare(name, StreamedLearner().model_folder, steps, fresh, gallery)
    print(table(found()))


def compare(name: str, shipped: Path, steps: int, fresh: MakesFresh, gallery: Fresh) -> None:
    """Add rows of the weights that a training begins with, and of those after further steps with an idea.

    Parameters
    ----------
    name
        Name of the idea.
    shipped
        Folder of a model with the weights that its training goes on from.
    steps
        Further steps.
    fresh
        Makes the bodies.
    gallery
        Bodies that are ranked.
    """
    start = newest_snapshot(shipped)
    if start is None:
        raise click.ClickException(f"no weights to go on from in {shipped / SNAPSHOTS}")
    bodies, recipe, weights = start
    idea, base = IDEAS[name], STREAMED[recipe["configuration"]["name"]]
    configuration = replace(base, **idea.configuration)
    plan = replace(Plan(**recipe["plan"]), falling=0, **idea.plan)
    plan = replace(plan, steps=bodies // plan.bodies + steps)
    done = {row["weights"] for row in found()}
    if BEFORE not in done:
        network = build_streamed(base)
        network.load_state_dict(weights)
        keep(Weights(BEFORE, bodies, network.eval(), base), gallery)
    if name in done:
        return
    folder = FOLDER / "".join(letter if letter.isalnum() else "-" for letter in name)
    own = {"configuration": configuration.described(), "plan": asdict(plan), "fresh": repr(fresh)}
    if newest_snapshot(folder) is None:
        keep_snapshot(folder, weights, bodies, own)
    run = TrainingRun(folder=folder, recipe=own, seed=0, device=torch.device("cpu"), say=say)
    network = train_streamed(configuration, plan, fresh, None, run).network.eval()
    keep(Weights(name, plan.steps * plan.bodies, network, configuration), gallery)


def found() -> list[Row]:
    """Rows that are there."""
    return json.loads(FIGURES.read_text()) if FIGURES.is_file() else []


def keep(weights: Weights, gallery: Fresh) -> None:
    """Measure weights and keep the row."""
    row = measured(weights, gallery)  # before the others are read, to which another process may add meanwhile
    write_text(FIGURES, json.dumps([*found(), row], indent=1) + "\n")


def table(rows: Sequence[Row]) -> str:
    """The comparison as Markdown: scores, and by how much FT is above that of going on as before."""
    head = ("trained on", "bodies", *PRINTED, "FT above going on as before")
    body: list[list[str]] = []
    as_before = next((np.array(row["of bodies"]["FT"]) for row in rows if row["weights"] == AS_BEFORE), None)
    for row in rows:
        above = ""
        if as_before is not None and row["weights"] not in (AS_BEFORE, BEFORE):
            gain = np.array(row["of bodies"]["FT"]) - as_before
            above = "{:.3f} ({:.3f} to {:.3f})".format(gain.mean(), *interval(gain.tolist()))
        body.append([row["weights"], f"{row['bodies']}", *(f"{row[name]:.3f}" for name in PRINTED), above])
    return "\n".join(markdown_table(head, body))


if __name__ == "__main__":
    main()
