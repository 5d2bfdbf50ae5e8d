"""``python -m tools.studies.learning_curve``: how much training the network needs; draws :data:`PICTURE`.

Three of the ten training subjects of one fold are held back, by a rule that sees no score; the network trains on the
other seven, and the forms of the three are ranked against each other at each mark. The step size never changes, so what
stands at a mark is what a training of so many epochs would end with. The subjects that the fold is tested on are never
looked at. A run that was stopped goes on where it was; what it needs for that is in ``build/learning-curve``. The
curve is that of 128 x 128 pixels; ``--resolution 192 --mark 60`` adds a row of another size to the table alone.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Iterable, Mapping, Sequence  # noqa: E402
from dataclasses import asdict, replace  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402

import click  # noqa: E402
import torch  # noqa: E402
from torch import Tensor, nn  # noqa: E402

from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.jobs.pairs import training_data  # noqa: E402
from benchmark.jobs.stages.distances import form_distances  # noqa: E402
from benchmark.jobs.stages.measures import scores  # noqa: E402
from benchmark.protocols.trainings import TRAININGS, fold_name, with_validation  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.storage.store import Store  # noqa: E402
from learned.images import enlarge  # noqa: E402
from learned.paired.configuration import LITERAL  # noqa: E402
from learned.paired.model import predict  # noqa: E402
from learned.paired.pairs import Pairs, gather  # noqa: E402
from learned.paired.schedule import Schedule  # noqa: E402
from learned.paired.training import train  # noqa: E402
from learned.surface import surface_behind  # noqa: E402
from learned.training.loop import TrainingRun  # noqa: E402
from learned.training.measures import measures  # noqa: E402
from retrieval.cmbof import CMBOF  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402

MARKS = (30, 60, 125, 250, 500)
VALIDATION_SUBJECTS = 3
PLAN = Schedule(resolution=128, early_epochs=12)

FOLDER = Path("build/learning-curve")
FIGURES = Path("results/learning-curve.json")
PICTURE = Path("docs/images/learning-curve.png")

Row = dict[str, float]
say = partial(print, flush=True)


@click.command()
@click.option("--resolution", type=click.IntRange(32), default=PLAN.resolution, show_default=True, help="Pixels.")
@click.option(
    "--mark", "marks", type=click.IntRange(1), multiple=True, default=MARKS, show_default=True, help="Epochs."
)
def main(resolution: int, marks: Sequence[int]) -> None:
    """Train to each mark that is missing, measure there, and draw the curve."""
    torch.set_num_threads(1)
    found = curve(replace(PLAN, resolution=resolution), marks)
    draw([row for row in found if row["resolution"] == PLAN.resolution], PICTURE)
    print(table(found))


def curve(schedule: Schedule, marks: Iterable[int]) -> list[Row]:
    """Measure what is missing at marks in epochs, and give all rows there are, sorted by resolution and epochs."""
    training = with_validation(TRAININGS[fold_name("humans", 0)], VALIDATION_SUBJECTS)
    data = training_data(training, Store.open(FOLDER), None, say)
    pairs, held_back = (gather(made(), schedule.resolution) for made in (data.pairs, data.unseen))
    subjects = [pair.subject for pair in data.unseen()]
    recipe = {"data": data.digest, "schedule": {**asdict(schedule), "epochs": None}}
    found: list[Row] = json.loads(FIGURES.read_text()) if FIGURES.is_file() else []
    folder = FOLDER / str(schedule.resolution)
    for mark in sorted(set(marks)):
        if any((row["resolution"], row["epochs"]) == (schedule.resolution, mark) for row in found):
            continue
        plan = replace(schedule, epochs=mark)
        run = TrainingRun(folder=folder, recipe=recipe, seed=0, device=torch.device("cpu"), say=say)
        result = train(LITERAL, plan, pairs, None, run)
        if result.progress.epoch != mark:
            raise click.ClickException(f"{folder} stands at epoch {result.progress.epoch}: delete it to measure {mark}")
        measured = measure(result.network.eval(), pairs, held_back, subjects)
        seconds = round(result.progress.seconds)
        row = {"resolution": schedule.resolution, "epochs": mark, "seconds": seconds, **measured}
        found.append(row)
        found.sort(key=lambda each: (each["resolution"], each["epochs"]))
        FIGURES.write_text(json.dumps(found, indent=1) + "\n")
        say(row)
    return found


def measure(network: nn.Module, pairs: Pairs, held_back: Pairs, subjects: Sequence[str]) -> Row:
    """Errors on the images of seen and held back subjects, and the scores of the forms of the latter."""
    seen, unseen = (_predictions(network, images) for images in (pairs.images, held_back.images))
    found = {
        f"{kind} {name}": value
        for kind, predicted, of_kind in (("training", seen, pairs), ("validation", unseen, held_back))
        for name, value in measures(predicted, of_kind.targets[of_kind.target_of]).items()
    }
    retrieved = ranked([surface_behind(enlarge(prediction))[0] for prediction in unseen], subjects)
    return {name: round(value, 4) for name, value in {**found, **retrieved}.items()}


def ranked(forms: Iterable[Mesh], subjects: Sequence[str]) -> Row:
    """What the scorer of the tables finds in a gallery of these forms, and the level of chance."""
    scorer = CMBOF()
    signatures = [scorer.signature(form) for form in forms]
    matrices = (form_distances(scorer, signatures, draw) for draw in range(scorer.info.draws))
    found = scores(matrices, subjects)
    chance = {f"chance {name}": found["chance"][name] for name in PRINTED}
    return {name: found["scores"][name] for name in PRINTED} | chance


def _predictions(network: nn.Module, images: Tensor) -> Tensor:
    return torch.stack([predict(network, image) for image in images])


def table(found: Iterable[Mapping[str, float]]) -> str:
    """The curve as Markdown."""
    columns = (*PRINTED, "validation mask overlap", "validation depth error", "training depth error")
    body = [
        [
            *(f"{row[name]}" for name in ("resolution", "epochs")),
            *(f"{row[name]:.3f}" if "error" in name else f"{row[name]:.2f}" for name in columns),
        ]
        for row in found
    ]
    return "\n".join(markdown_table(["pixels", "epochs", *columns], body, n_left=0))


def draw(found: Sequence[Mapping[str, float]], path: Path) -> None:
    """Draw scores, overlap of masks and error of depths over the epochs."""
    from matplotlib.figure import Figure

    epochs = [row["epochs"] for row in found]
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    retrieval, masks, depths = figure.subplots(1, 3)
    for colour, name in enumerate(PRINTED):
        retrieval.plot(epochs, [row[name] for row in found], f"C{colour}o-", label=name)
        retrieval.axhline(found[0][f"chance {name}"], color=f"C{colour}", linewidth=0.7, linestyle=":")
    retrieval.set_title("retrieval of held-back subjects (dotted: chance)", fontsize=8)
    for axes, name in ((masks, "mask overlap"), (depths, "depth error")):
        for kind, style in (("validation", "C0o-"), ("training", "C7o--")):
            axes.plot(epochs, [row[f"{kind} {name}"] for row in found], style, label=f"{kind} subjects")
        axes.set_title(name, fontsize=8)
    for axes in (retrieval, masks, depths):
        axes.set_xscale("log")
        axes.set_xticks(epochs, [f"{epoch:g}" for epoch in epochs])
        axes.minorticks_off()
        axes.set_xlabel("epochs")
        axes.legend(fontsize=7)
    retrieval.set_ylim(0, 1)
    masks.set_ylim(0, 1)
    depths.set_ylim(bottom=0)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
