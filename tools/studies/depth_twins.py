"""Whether a perspective frame from far away gives the form of the orthographic view that the suite renders.

    python -m tools.studies.depth_twins [-n 100]

Bodies of the generated humans, noise-free, 50 m away through a long lens; and the same bodies as the suite sees them.
Told are how many forms are nearest to that of their own twin, and the mean distance from the vertices of a form to the
surface of its twin, as a share of the root of the area.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmark.datasets.humans import Humans
from benchmark.depth.frame import observe
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.scene import Pose, Scene
from benchmark.depth_forms import form_of_object, method_of_depth
from benchmark.geometry.interpolation import nearest_on_surface, vertex_normals
from benchmark.jobs.preparation import shape_of
from benchmark.jobs.stages.features import extract
from benchmark.jobs.stages.view import seen
from benchmark.methods.output_checks import form_of
from benchmark.methods.scorers import ScorerSpec

LONG_LENS = Intrinsics(10500.0, 10500.0, 319.5, 239.5, (640, 480))
DISTANCE = 50.0


def twins(entry, dataset, method):
    """Form of the frame from afar, and of the orthographic view."""
    mesh = dataset.load(entry)
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    centred = mesh.with_vertices(mesh.vertices - middle)
    depths, mask = Scene(centred, Pose((0, -DISTANCE, 0), (0, 0, 0)), wall=None, floor=False).drawn(LONG_LENS)
    far = form_of_object(observe(depths, LONG_LENS, mask), method).form.mesh
    near, _ = form_of(method, shape_of(seen(mesh, dataset.camera(entry), dataset.half_width), entry.identifier))
    return far, near


def main() -> None:
    """Print how near twins are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=100)
    parser.add_argument("-m", default="learned-streamed")
    parser.add_argument("--no-retrieval", action="store_true")
    asked = parser.parse_args()
    dataset, method, scorer = Humans(), method_of_depth(asked.m), ScorerSpec().create()
    places = np.linspace(0, len(dataset.entries) - 1, asked.n).round().astype(int)
    apart, far, near = [], [], []
    for place in places:
        one, other = twins(dataset.entries[place], dataset, method)
        found = nearest_on_surface(other, one.vertices, vertex_normals(one)).distances
        apart.append(float(found.mean()) / other.area**0.5)
        if not asked.no_retrieval:
            far.append(extract(scorer, one))
            near.append(extract(scorer, other))
    print(f"{asked.n} twins: mean distance {np.mean(apart):.2%} of the root of the area, largest {max(apart):.2%}, "
          f"{sum(each <= 0.01 for each in apart)} within 1 %", flush=True)  # fmt: skip
    if not asked.no_retrieval:
        matrix = np.mean([scorer.compare([*far, *near], draw) for draw in range(scorer.info.draws)], axis=0)
        own = matrix[: asked.n, asked.n :].argmin(axis=1) == np.arange(asked.n)
        print(f"{int(own.sum())} of {asked.n} are nearest to their own twin")


if __name__ == "__main__":
    main()
