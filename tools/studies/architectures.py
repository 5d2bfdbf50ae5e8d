"""``python -m tools.studies.architectures``: which network earns its place; writes ``results/architectures.json``.

Each configuration is trained for an equal number of processor seconds, on the same stream of bodies, and its forms of
validation bodies, which are another stream, are ranked against each other. No subject of any set that methods are
tested on is looked at. A run that was stopped goes on where it was, and two may share the work if they are told
different names; the bodies are made once for all networks of a resolution. What they need for that is in
``build/architectures``, to be deleted when the bodies, the networks or what is ranked have changed.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
import tempfile  # noqa: E402
from collections.abc import Iterable, Mapping, Sequence  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from benchmark.api.streaming import Fresh, MakesFresh  # noqa: E402
from benchmark.datasets.varied.sampler import Sampler  # noqa: E402
from benchmark.errors import UnsupportedShape  # noqa: E402
from benchmark.geometry.depth import SIZE  # noqa: E402
from benchmark.geometry.mesh import Mesh  # noqa: E402
from benchmark.jobs.pairs.stream import TRAINED  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from benchmark.system.files import write_atomically, write_text  # noqa: E402
from learned.streamed.configuration import STREAMED, Streamed, streamed  # noqa: E402
from learned.streamed.model import form_of, predicted  # noqa: E402
from learned.streamed.network import StreamedNetwork  # noqa: E402
from learned.streamed.training import train_streamed  # noqa: E402
from learned.training.loop import Plan, TrainingRun  # noqa: E402
from learned.weights import n_parameters  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.learning_curve import ranked  # noqa: E402

#: Seed of the bodies that are ranked, neither trained on nor looked at while training.
RANKED = 2
BODIES, POSES = 30, 5
TRIAL_STEPS = 12

#: The step size rises over this part of a training at most; a short one would else be over before it has risen.
RISING = 10

CPU = torch.device("cpu")
FOLDER = Path("build/architectures")
FIGURES = Path("results/architectures.json")

Row = dict[str, float | str]
say = partial(print, flush=True)


@click.command()
@click.option("--minutes", type=click.FloatRange(min=0, min_open=True), default=30.0, show_default=True)
@click.option("--only", multiple=True, metavar="NAME", help="Configurations; all by default.")
@click.option("--bodies", type=click.IntRange(2), default=BODIES, show_default=True, help="Bodies that are ranked.")
@click.option("--workers", type=click.IntRange(0), default=1, show_default=True, help="Processes that make bodies.")
def main(minutes: float, only: Sequence[str], bodies: int, workers: int) -> None:
    """Train each configuration for so many minutes of one core, the making of bodies apart, and rank its forms."""
    torch.set_num_threads(1)
    for name in only:
        streamed(name)
    compare(
        [STREAMED[name] for name in only or STREAMED],
        60 * minutes,
        ArtefactReader(Sampler(TRAINED), FOLDER / "bodies"),
        Sampler(RANKED, poses=POSES),
        bodies,
        workers,
    )
    print(table(json.loads(FIGURES.read_text())))


def compare(
    chosen: Iterable[Streamed], seconds: float, fresh: MakesFresh, held_back: MakesFresh, bodies: int, workers: int
) -> None:
    """Train and measure what is missing in the figures.

    Parameters
    ----------
    chosen
        The configurations.
    seconds
        Processor seconds of each training.
    fresh
        Makes the bodies that all of them are trained on.
    held_back
        Makes those that are ranked.
    bodies
        How many are ranked.
    workers
        Processes that make bodies.
    """
    gallery = held_back(0, bodies, SIZE)
    for configuration in chosen:
        if any(row["configuration"] == configuration.name and row["budget"] == seconds for row in _found()):
            continue
        folder = FOLDER / f"{configuration.name}-{seconds:g}"
        steps = _planned(folder, configuration, fresh, seconds)
        plan = Plan(steps=steps, warm_up=min(Plan.warm_up, steps // RISING))
        recipe = {"configuration": configuration.described(), "steps": steps, "fresh": repr(fresh)}
        run = TrainingRun(folder=folder, recipe=recipe, seed=0, device=CPU, workers=workers, say=say)
        trained = train_streamed(configuration, plan, fresh, None, run)
        network = trained.network.eval()
        spent = sum(row["processor seconds"] for row in trained.progress.history)
        row: Row = {
            "configuration": configuration.name,
            "budget": seconds,
            "processor seconds": round(spent, 1),
            "steps": plan.steps,
            "ms a step": round(1000 * spent / plan.steps, 1),
            "parameters": float(n_parameters(network)),
            **measure(network, configuration, gallery.images, gallery.identifiers),
        }
        write_text(FIGURES, json.dumps([*_found(), row], indent=1) + "\n")
        say(row)


def _found() -> list[Row]:
    """Rows that are there, another process's too."""
    return json.loads(FIGURES.read_text()) if FIGURES.is_file() else []


class ArtefactReader:
    """Batches that were made once, for whoever trains on them next; as foregrounds, a fifth of the bytes.

    Parameters
    ----------
    make
        Makes those that are not there yet.
    folder
        Where they are kept.
    """

    def __init__(self, make: MakesFresh, folder: Path) -> None:
        self._make, self._folder = make, folder

    def __repr__(self) -> str:
        return repr(self._make)

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        """Batch of a number, made or read."""
        path = self._folder / f"{size}-{bodies}" / f"{number}.npz"
        if path.is_file():
            with np.load(path, allow_pickle=False) as artefacts:
                images, fronts, backs = (_unpacked(artefacts, name) for name in ("images", "fronts", "backs"))
                names, drawn = tuple(map(str, artefacts["identifiers"])), json.loads(str(artefacts["drawn_again"]))
            return Fresh(identifiers=names, images=images, fronts=fronts, backs=backs, drawn_again=drawn)
        fresh = self._make(number, bodies, size)
        arrays = {**_packed("images", fresh.images), **_packed("fronts", fresh.fronts), **_packed("backs", fresh.backs)}
        names, drawn = np.array(fresh.identifiers), np.array(json.dumps(dict(fresh.drawn_again)))
        write_atomically(path, partial(np.savez, identifiers=names, drawn_again=drawn, **arrays))
        return fresh


def _packed(name: str, images: NDArray[np.float32]) -> dict[str, NDArray]:
    foreground = images != 0
    return {
        f"{name} shape": np.array(images.shape),
        f"{name} foreground": np.packbits(foreground),
        f"{name} depth": images[foreground],
    }


def _unpacked(artefacts: Mapping[str, NDArray], name: str) -> NDArray[np.float32]:
    shape = tuple(artefacts[f"{name} shape"])
    foreground = np.unpackbits(artefacts[f"{name} foreground"], count=int(np.prod(shape))).astype(bool)
    images = np.zeros(foreground.size, np.float32)
    images[foreground] = artefacts[f"{name} depth"]
    return images.reshape(shape)


def _planned(folder: Path, configuration: Streamed, fresh: MakesFresh, seconds: float) -> int:
    """Steps of a training; those that it began with, for no machine is as fast twice, and a plan is one."""
    path = folder / "steps.json"
    if path.is_file():
        return int(json.loads(path.read_text()))
    each = step_seconds(configuration, fresh)
    steps = max(1, round(seconds / each))
    say(f"{configuration.name}: {1000 * each:.0f} ms a step, {steps} steps")
    write_text(path, json.dumps(steps))
    return steps


def step_seconds(configuration: Streamed, fresh: MakesFresh) -> float:
    """Processor seconds of one step, from a short training whose weights are thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        run = TrainingRun(folder=Path(folder), recipe={}, seed=0, device=CPU, say=lambda _: None)
        trained = train_streamed(configuration, Plan(steps=TRIAL_STEPS), _Repeated(fresh), None, run)
    return sum(row["processor seconds"] for row in trained.progress.history) / TRIAL_STEPS


class _Repeated:
    """The first batch, again and again: making it is no part of a step."""

    def __init__(self, make: MakesFresh) -> None:
        self._make = make
        self._made = {}

    def __call__(self, number: int, bodies: int, size: int):
        if size not in self._made:
            self._made[size] = self._make(0, bodies, size)
        return self._made[size]


def measure(network: StreamedNetwork, configuration: Streamed, images, names: Sequence[str]) -> Row:
    """Scores of the forms of a gallery, of bodies in poses; one that cannot be made is a query that finds nothing."""
    forms, subjects, refused = forms_of(network, configuration, images, names)
    share = len(forms) / (len(forms) + refused)
    scores = (
        ranked(forms, subjects) if forms else dict.fromkeys([*PRINTED, *(f"chance {name}" for name in PRINTED)], 0.0)
    )
    scores |= {name: scores[name] * share for name in PRINTED}
    return {name: round(value, 4) for name, value in scores.items()} | {"refused": refused}


def forms_of(
    network: StreamedNetwork, configuration: Streamed, images, names: Sequence[str]
) -> tuple[list[Mesh], list[str], int]:
    """Forms of a gallery, of bodies in poses, with the subject of each, and how many could not be made."""
    forms, subjects, refused = [], [], 0
    for name, of_body in zip(names, images, strict=True):
        for image in of_body:
            try:
                forms.append(form_of(predicted(network, configuration, image))[0])
                subjects.append(name)
            except UnsupportedShape:
                refused += 1
    return forms, subjects, refused


def table(found: Iterable[Mapping[str, float | str]]) -> str:
    """The comparison as Markdown, for ``docs/appendix/streamed-network.md``."""
    head = ("configuration", "minutes", "steps", "ms a step", "parameters", *PRINTED, "refused")
    rows, body = list(found), []
    for row in rows:
        scores = [f"{row[name]:.2f}" for name in PRINTED]
        numbers = [f"{row['processor seconds'] / 60:.1f}", f"{row['steps']}", f"{row['ms a step']:.0f}"]
        body.append([f"`{row['configuration']}`", *numbers, f"{row['parameters']:.0f}", *scores, f"{row['refused']}"])
    if rows:
        body.append(["*chance*", *[""] * 4, *(f"{rows[0][f'chance {name}']:.2f}" for name in PRINTED), ""])
    return "\n".join(markdown_table(head, body))


if __name__ == "__main__":
    main()
