"""``python -m tools.studies.people FOLDER``: what doubling the bodies of a training buys; draws :data:`PICTURE`.

A training of unknown length keeps its weights whenever the bodies that it has seen have doubled. Each of these
snapshots is measured once: its losses, and the retrieval of the forms that it predicts for 60 validation bodies in
five poses each, with every fault of the camera. They are another stream; no subject of any set that methods are
tested on is looked at. Rows go to ``FOLDER/validation.jsonl``; with ``--shipped`` there is one of the shipped model.
With ``--newest`` the weights of the checkpoint are kept and measured too: a training of which nothing else is left goes
on from them.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import functools  # noqa: E402
import json  # noqa: E402
import time  # noqa: E402
from collections.abc import Sequence  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from safetensors import safe_open  # noqa: E402

from benchmark.api.learning import read_card  # noqa: E402
from benchmark.api.streaming import Fresh, MakesFresh  # noqa: E402
from benchmark.datasets.varied.sampler import Sampler  # noqa: E402
from benchmark.geometry.depth import SIZE  # noqa: E402
from benchmark.jobs.stages.distances import form_distances  # noqa: E402
from benchmark.jobs.stages.measures import scores  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from learned.streamed.configuration import Streamed, from_card  # noqa: E402
from learned.streamed.images import batch_of  # noqa: E402
from learned.streamed.losses import NAMES, losses  # noqa: E402
from learned.streamed.methods import StreamedLearner  # noqa: E402
from learned.streamed.model import load_streamed  # noqa: E402
from learned.streamed.network import StreamedNetwork, build_streamed  # noqa: E402
from learned.training.checkpoint import CHECKPOINT, SNAPSHOTS, keep_snapshot  # noqa: E402
from learned.training.measures import measures  # noqa: E402
from retrieval.cmbof import CMBOF  # noqa: E402
from retrieval.measures import PRINTED  # noqa: E402
from tools.studies.architectures import RANKED, ArtefactReader, forms_of  # noqa: E402

BODIES, POSES = 60, 5
DRAWS = 2000
"""Samples of bodies for an interval of 95 per cent."""

GALLERY = Path("build/people")
PICTURE = Path("docs/images/people.png")
ROWS = "validation.jsonl"

Row = dict[str, Any]


@dataclass(frozen=True)
class Weights:
    """A network that is measured, and how many bodies it was trained on."""

    name: str
    bodies: int
    network: StreamedNetwork
    configuration: Streamed


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--shipped", is_flag=True, help="Measure the shipped model too.")
@click.option("--newest", is_flag=True, help="Keep the weights of the checkpoint, and measure them too.")
def main(folder: Path, shipped: bool, newest: bool) -> None:
    """Measure what is not measured yet, draw the curve and print it."""
    torch.set_num_threads(1)
    if newest:
        keep_newest(folder)
    measure_missing(folder, ArtefactReader(Sampler(RANKED, poses=POSES), GALLERY), shipped)
    found = rows(folder)
    draw(found, PICTURE)
    print(table(found))


def measure_missing(folder: Path, held_back: MakesFresh, shipped: bool, bodies: int = BODIES) -> None:
    """Append a row for each snapshot of a training that has none, oldest first, and for the shipped model."""
    done = {row["weights"] for row in rows(folder)}
    missing = [path for path in sorted((folder / SNAPSHOTS).glob("*.safetensors")) if path.stem not in done]
    makers = [functools.partial(snapshot, path) for path in missing]
    if shipped and "shipped" not in done:
        makers.insert(0, shipped_model)
    for make in makers:
        with (folder / ROWS).open("a") as file:
            file.write(json.dumps(measured(make(), held_back(0, bodies, SIZE))) + "\n")


def keep_newest(folder: Path) -> None:
    """Keep the weights of the checkpoint of a training, averaged where it averages, as a snapshot."""
    with safe_open(str(folder / CHECKPOINT), framework="pt") as file:
        told = file.metadata()
        names = list(file.keys())
        mark = "average." if any(name.startswith("average.") for name in names) else "weights."
        weights = {name.removeprefix(mark): file.get_tensor(name) for name in names if name.startswith(mark)}
    bodies = int(told["epoch"]) * int(told["batch"])
    keep_snapshot(folder, weights, bodies, json.loads(told["recipe"]))


def rows(folder: Path) -> list[Row]:
    """Rows that are there, by bodies."""
    path = folder / ROWS
    lines = path.read_text().splitlines() if path.is_file() else []
    return sorted(map(json.loads, lines), key=lambda row: row["bodies"])


def snapshot(path: Path) -> Weights:
    """Network of a file that a training kept."""
    with safe_open(str(path), framework="pt") as file:
        told = file.metadata()
        tensors = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
    configuration = from_card(json.loads(told["recipe"])["configuration"])
    network = build_streamed(configuration)
    network.load_state_dict(tensors)
    network.to(memory_format=torch.channels_last).eval()
    return Weights(path.stem, int(told["bodies"]), network, configuration)


def shipped_model() -> Weights:
    """The model that comes with the project."""
    folder = StreamedLearner().model_folder
    return Weights("shipped", int(read_card(folder)["bodies"]), *load_streamed(folder))


def measured(weights: Weights, gallery: Fresh) -> Row:
    """Losses on a gallery, and scores of its forms; one that cannot be made is a query that finds nothing."""
    began = time.process_time()
    found = _losses(weights, gallery)
    forms, subjects, refused = forms_of(weights.network, weights.configuration, gallery.images, gallery.identifiers)
    scorer = CMBOF()
    signatures = [scorer.signature(form) for form in forms]
    ranked = scores((form_distances(scorer, signatures, draw) for draw in range(scorer.info.draws)), subjects)
    queries = {name: [value or 0.0 for value in ranked["per_query"][name]] for name in PRINTED}
    of_body = {name: _of_bodies(gallery.identifiers, subjects, queries[name], POSES) for name in PRINTED}
    return {
        "weights": weights.name,
        "bodies": weights.bodies,
        **found,
        **{name: float(np.mean(of_body[name])) for name in PRINTED},
        **{f"{name} interval": interval(of_body[name]) for name in PRINTED},
        **{f"chance {name}": ranked["chance"][name] for name in PRINTED},
        "refused": refused,
        "of bodies": of_body,
        "seconds": round(time.process_time() - began, 1),
    }


@torch.no_grad()
def _losses(weights: Weights, gallery: Fresh) -> dict[str, float]:
    batch = batch_of(gallery, 0, weights.configuration)
    sums: dict[str, float] = {}
    whole = batch.poses * 4
    parts = list(zip(batch.images.split(whole), batch.targets.split(whole), strict=True))
    for images, targets in parts:
        code = weights.network.code(images)
        prediction = weights.network.decoded(code)
        terms = losses(prediction, targets, code, batch.poses, weights.configuration).tolist()
        depth_and_mask = [0, targets.shape[1] - 1]
        near = measures(prediction[:, depth_and_mask], targets[:, depth_and_mask])
        for name, value in (*zip(NAMES, terms, strict=True), *near.items()):
            sums[name] = sums.get(name, 0.0) + value / len(parts)
    return sums


def _of_bodies(names: Sequence[str], subjects: Sequence[str], values: Sequence[float], poses: int) -> list[float]:
    """Mean of each body over its poses; a refused one counts 0."""
    found = dict.fromkeys(names, 0.0)
    for subject, value in zip(subjects, values, strict=True):
        found[subject] += value / poses
    return [round(value, 6) for value in found.values()]


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Bootstrap interval of 95 per cent of a mean over bodies."""
    drawn = np.random.default_rng(0).choice(values, (DRAWS, len(values))).mean(axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return float(low), float(high)


def table(found: Sequence[Row]) -> str:
    """The curve as Markdown."""
    head = ("weights", "bodies", *PRINTED, "95 % of FT", "mask overlap", "depth error", "depth loss", "mask loss")
    body = []
    for row in found:
        low, high = row["FT interval"]
        name = "shipped" if row["weights"] == "shipped" else ""
        cells = [name, f"{row['bodies']}", *(f"{row[name]:.2f}" for name in PRINTED), f"{low:.2f} to {high:.2f}"]
        body.append([*cells, f"{row['mask overlap']:.3f}", *(f"{row[name]:.5f}" for name in head[8:])])
    return "\n".join(markdown_table(head, body))


def draw(found: Sequence[Row], path: Path) -> None:
    """Draw scores and losses over the bodies, with those of the shipped model as dotted lines."""
    from matplotlib.figure import Figure

    curve = [row for row in found if row["weights"] != "shipped"]
    shipped = next((row for row in found if row["weights"] == "shipped"), None)
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    bodies = [row["bodies"] for row in curve]
    for axes, names in ((left, PRINTED), (right, ("depth loss", "mask loss"))):
        for colour, name in enumerate(names):
            axes.plot(bodies, [row[name] for row in curve], f"C{colour}o-", label=name, markersize=3)
            if shipped:
                axes.axhline(shipped[name], color=f"C{colour}", linewidth=0.7, linestyle=":")
        axes.set_xscale("log")
        axes.set_xlabel("bodies seen")
        axes.legend(fontsize=7)
    left.set_title("retrieval of validation bodies (dotted: shipped)", fontsize=8)
    right.set_title("losses on validation bodies", fontsize=8)
    right.set_yscale("log")
    left.set_ylim(0, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
