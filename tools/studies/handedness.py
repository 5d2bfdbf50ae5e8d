"""``python -m tools.studies.handedness FOLDER``: the share of forms that keep their side of the mirror.

Each shape is jittered, turned, divided into other triangles, and, if it is a validation body, posed anew; a form keeps
its side if it can be turned rather than mirrored onto that of the undisturbed shape. Printed are the share of forms
that do as their methods make them, and as :func:`baselines._kernels.handedness.right_handed` would make them.
Validation bodies are those of :mod:`tools.studies.people`; no subject of any set that methods are tested on is among
them, and a rule is chosen by them alone. Rows go to ``FOLDER/handedness.jsonl``, and a study that was stopped goes on.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import json  # noqa: E402
from collections.abc import Iterable, Iterator, Sequence  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import click  # noqa: E402
import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from baselines._kernels.handedness import handedness  # noqa: E402
from baselines._kernels.orientation import vertex_areas  # noqa: E402
from benchmark.api.contracts import FloatArray, Mesh, Shape  # noqa: E402
from benchmark.datasets.catalogue import open_dataset  # noqa: E402
from benchmark.datasets.jittered import jittered  # noqa: E402
from benchmark.datasets.varied.sampler import Sampler  # noqa: E402
from benchmark.errors import ShapeError  # noqa: E402
from benchmark.geometry.camera import Camera  # noqa: E402
from benchmark.geometry.preparation import decimate, prepare  # noqa: E402
from benchmark.jobs.stages.view import half_width_of, seen  # noqa: E402
from benchmark.methods.registry import MethodSpec, methods, variant  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from tools.studies.architectures import RANKED  # noqa: E402
from tools.studies.jitter import aligned  # noqa: E402

_METRIC = "classic-mds[metric=biharmonic]"
METHODS = ("classic-mds", _METRIC, "fast-mds", "nystrom-mds", "spectral-mds", "accelerated-mds", "gps")
"""Those whose reflection is open; others start from the surface, or from one of these."""

BODIES, POSES, AT_A_TIME = 20, 3, 5
FRONT = Camera((0.0, 1.0, 0.0))
SIZES = {"mesh": (2000, 1500, 2500), "view": (0, 1500, 1000)}
"""Vertices of the surface and of its other triangulations; views are drawn as they are."""

ROWS = "handedness.jsonl"
Row = dict[str, Any]
Source = tuple[str, Mesh, Camera, Mesh | None]
"""Name, mesh, camera, and the first pose of the same body."""


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option("--set", "dataset", type=click.Choice(["bodies", "tosca"]), default="bodies", show_default=True)
@click.option("--input", "input_", type=click.Choice(["mesh", "view"]), default="mesh", show_default=True)
@click.option("-m", "--method", "names", multiple=True, metavar="METHOD", help="Those of open reflection by default.")
@click.option("--every", type=click.IntRange(1), default=1, show_default=True, help="Take every n-th shape.")
@click.option("--data-root", type=click.Path(path_type=Path), envvar="CANONICAL_FORMS_DATA")
def main(folder: Path, dataset: str, input_: str, names: Sequence[str], every: int, data_root: Path | None) -> None:
    """Measure what is not measured yet, and print it."""
    specs = [variant(name, methods()) for name in names or METHODS]
    folder.mkdir(parents=True, exist_ok=True)
    done = {(row["set"], row["input"], row["shape"], row["method"]) for row in rows(folder)}
    for number, source in enumerate(bodies() if dataset == "bodies" else of_set(dataset, data_root)):
        missing = [spec for spec in specs if (dataset, input_, source[0], spec.name) not in done]
        if number % every == 0 and missing:
            found = [{"set": dataset, "input": input_, **row} for row in measured(source, input_, missing, number)]
            with (folder / ROWS).open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in found)
    print(table(rows(folder)))


def rows(folder: Path) -> list[Row]:
    """Rows that are there."""
    path = folder / ROWS
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def bodies() -> Iterator[Source]:
    """Validation bodies in some poses."""
    for start in range(0, BODIES, AT_A_TIME):
        made = Sampler(RANKED, poses=POSES).surfaces(start, AT_A_TIME)
        for name, posed in zip(made.identifiers, made.posed, strict=True):
            first = Mesh(posed[0], made.faces)
            for pose, vertices in enumerate(posed):
                yield f"{name}-{pose}", Mesh(vertices, made.faces), FRONT, first if pose else None


def of_set(name: str, data_root: Path | None) -> Iterator[Source]:
    """Shapes of a data set."""
    dataset = open_dataset(name, data_root)
    for entry in dataset.entries:
        yield entry.identifier, dataset.load(entry), dataset.camera(entry), None


def measured(source: Source, input_: str, specs: Sequence[MethodSpec], seed: int) -> Iterator[Row]:
    """Compare the forms of a shape with those of the perturbed shape."""
    name, mesh, camera, first = source
    usual, *others = SIZES[input_]
    surface, places = surface_of(mesh, camera, input_, usual)
    perturbed = {"jitter": surface_of(jittered(mesh, seed), camera, input_, usual)}
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    perturbed["rotation"] = surface.with_vertices(surface.vertices @ turn.T), places
    perturbed |= {f"{count} vertices": surface_of(mesh, camera, input_, count) for count in others}
    if first is not None and input_ == "mesh":
        posed, there = surface_of(first, camera, input_, usual)
        perturbed["pose"] = posed, mesh.vertices[cKDTree(first.vertices).query(there)[1]]
    for spec in specs:
        form = form_of(spec, surface, name)
        for perturbation, (other, there) in perturbed.items():
            found = form_of(spec, other, name)
            if form is not None and found is not None:
                weights = vertex_areas(other)
                here = form[cKDTree(places).query(there)[1]]
                yield {
                    "shape": name, "method": spec.name, "perturbation": perturbation,
                    "mirrored": aligned(here, found, weights / weights.sum())[2],
                    "handedness": [handedness(form, vertex_areas(surface)), handedness(found, weights)],
                }  # fmt: skip


def surface_of(mesh: Mesh, camera: Camera, input_: str, count: int) -> tuple[Mesh, FloatArray]:
    """Prepared surface with so many vertices, and where they lie on the mesh or in the image."""
    if input_ == "mesh":
        prepared = prepare(mesh, count)
        return prepared.mesh, prepared.centre + prepared.scale * prepared.mesh.vertices
    arrays = seen(mesh, camera, half_width_of(mesh, camera))
    surface = Mesh(arrays["vertices"], arrays["faces"])
    surface = decimate(surface, count) if count else surface
    return surface, surface.vertices * np.sqrt(float(arrays["source_area"]))


def form_of(spec: MethodSpec, mesh: Mesh, name: str) -> FloatArray | None:
    """Vertices of the form of a surface; None where the method refuses it."""
    method: Any = spec.create()
    try:
        return np.asarray(method.canonicalise(Shape(identifier=name, mesh=mesh)).vertices)
    except ShapeError:
        return None


def table(found: Iterable[Row]) -> str:
    """Shares of forms that keep their side, as made and by the rule, by set, input and method, as Markdown."""
    groups: dict[tuple[str, ...], dict[str, list[Row]]] = {}
    for row in found:
        of_place = groups.setdefault((row["set"], row["input"], row["method"]), {})
        kind = row["perturbation"] if row["perturbation"] in ("jitter", "rotation", "pose") else "triangles"
        of_place.setdefault(kind, []).append(row)
    kinds = ("jitter", "rotation", "triangles", "pose")
    head = ("set", "input", "method", *(f"{kind}, {how}" for kind in kinds for how in ("made", "rule")))
    body = [
        [*place, *(cell for kind in kinds for cell in shares(by_kind.get(kind, [])))]
        for place, by_kind in groups.items()
    ]
    return "\n".join(markdown_table(head, body, 3))


def shares(found: Sequence[Row]) -> tuple[str, str]:
    """Share of forms that keep their side as made, and by the rule."""
    if not found:
        return "--", "--"
    made = [not row["mirrored"] for row in found]
    ruled = [(np.prod(row["handedness"]) > 0) != row["mirrored"] for row in found]
    return f"{np.mean(made):.3f}", f"{np.mean(ruled):.3f}"


if __name__ == "__main__":
    main()
