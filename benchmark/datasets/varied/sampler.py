"""Random bodies in random poses as depth images, without self-intersections; each batch depends only on its number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmark.api.streaming import Fresh, Surfaces
from benchmark.datasets.human_poses import Pose
from benchmark.datasets.scanning import _count_crossings
from benchmark.datasets.varied.bodies import Body, varied_body
from benchmark.datasets.varied.camera import (
    Perturbations,
    both_sides,
    drawn_perturbations,
    extents,
    perturbed,
    rendered,
    turned,
)
from benchmark.datasets.varied.model import CANONICAL, BodyModel, Shaped, body_model
from benchmark.datasets.varied.poses import varied_pose
from benchmark.errors import DatasetError
from benchmark.geometry.mesh import Faces, Points

CELL = 0.02
"""Spacing of the sampled lines and of samples along them, as a fraction of the height of the standing body."""

_MARGIN = 2
"""Number of empty samples around the body."""


def doubled_share(vertices: Points, faces: Faces, height: float) -> float:
    """Return the fraction of a solid that overlaps itself, with a winding number of two or more.

    The solid is sampled by a grid of vertical lines. Small triangles, open seams of a part and the creases of a knee
    hardly change this fraction; an arm in a chest changes it by the volume of the arm.

    Parameters
    ----------
    vertices, faces
        A closed surface.
    height
        Height of the standing body, in units of the vertices.

    Returns
    -------
    float
        In [0, 1].
    """
    points = vertices / (CELL * height)
    # Offset by an irrational fraction of a step, so that no line coincides with an edge of a symmetric body.
    points = points - extents(points)[0] + _MARGIN + np.sqrt([0.02, 0.03, 0.05])
    size = np.ceil(extents(points)[1]).astype(np.int64) + _MARGIN
    crossings: NDArray[np.int8] = np.zeros(tuple(size), dtype=np.int8)
    _count_crossings(points, faces, crossings)
    winding = np.cumsum(crossings, axis=2, dtype=np.int8)
    inside = np.count_nonzero(winding > 0)
    return float(np.count_nonzero(winding > 1) / inside) if inside else 1.0


S = TypeVar("S")

LARGEST_DOUBLED = 0.004
"""Maximum fraction of a body that overlaps itself.

Of the 300 authored shapes, 99 % are below it, all but the deepest squats; above it, more than 1.5 % of the triangles
intersect others, unlike in any authored shape.
"""

SHORTEST, TALLEST = 0.6, 2.4
"""Minimum and maximum height of a standing body, in metres."""

MOST_DRAWS = 60
"""Maximum number of draws of a body or a pose before the batch fails; one in 10^8 needs more."""

SHARES = (0.6, 0.95)
"""Range of the fraction of the frame filled by a body's largest image; a folder's frame fits its largest shape."""

BODIES_LEAVE, POSES_OVERLAP = "bodies of no human height", "poses through the body itself"
"""Reasons for redrawing."""


@dataclass(frozen=True)
class Sampler:
    """Sampler of batches; see :class:`benchmark.api.streaming.MakesFresh`.

    Parameters
    ----------
    seed
        Seed of the stream; streams with different seeds share no body.
    poses
        Number of poses per body.
    perturbations
        Whether the images have camera faults.
    """

    seed: int
    poses: int = 2
    perturbations: bool = True

    def __call__(self, number: int, bodies: int, size: int) -> Fresh:
        """Generate a batch."""
        model, redrawn = body_model(), Counter[str]()
        names, randoms, shapes, posed = self._drawn(number, bodies, redrawn)
        images = np.zeros((bodies, self.poses, size, size), dtype=np.float32)
        fronts, backs = (np.zeros((bodies, size, size), dtype=np.float32) for _ in range(2))
        for place, random in enumerate(randoms):
            wrong = [drawn_perturbations(random) if self.perturbations else Perturbations() for _ in range(self.poses)]
            target = turned(shapes[place], Perturbations())
            inputs = [turned(vertices, errors) for vertices, errors in zip(posed[place], wrong, strict=True)]
            extent = max(float(np.abs(points).max()) for points in (target, *inputs))
            half_width = extent / random.uniform(*SHARES)
            fronts[place], backs[place] = both_sides(target, model.faces, half_width, size)
            for row, (points, errors) in enumerate(zip(inputs, wrong, strict=True)):
                hidden = [hand for hand, is_missing in zip(model.hands, errors.missing, strict=True) if is_missing]
                faces = model.faces[~np.any(hidden, axis=0)] if hidden else model.faces
                images[place, row] = perturbed(rendered(points, faces, half_width, size), errors, random)
        return Fresh(identifiers=tuple(names), images=images, fronts=fronts, backs=backs, drawn_again=dict(redrawn))

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        """Generate the bodies of a batch without images; see :class:`benchmark.api.streaming.MakesSurfaces`."""
        redrawn = Counter[str]()
        names, _, shapes, posed = self._drawn(number, bodies, redrawn)
        return Surfaces(
            identifiers=tuple(names),
            canonical=np.stack(shapes),
            posed=np.stack([np.stack(of_body) for of_body in posed]),
            faces=body_model().faces,
            drawn_again=dict(redrawn),
        )

    def _drawn(
        self, number: int, bodies: int, redrawn: Counter[str]
    ) -> tuple[list[str], list[np.random.Generator], list[Points], list[list[Points]]]:
        """Return names, random generators, and vertices in the canonical pose and in the drawn poses of the bodies."""
        model = body_model()
        names = [f"varied-{self.seed}-{number}-{place}" for place in range(bodies)]
        randoms = [np.random.default_rng([self.seed, number, place]) for place in range(bodies)]

        def standing(candidates: Sequence[Shaped]) -> list[Points]:
            return [vertices for (vertices,) in model.posed(candidates, [[CANONICAL]] * len(candidates))]

        drawn, shapes = drawn_bodies(model.shaped, standing, model.faces, names, randoms, redrawn)
        return names, randoms, shapes, self._posed(model, names, drawn, shapes, randoms, redrawn)

    def _posed(
        self,
        model: BodyModel,
        names: list[str],
        bodies: list[Shaped],
        shapes: list[Points],
        randoms: list[np.random.Generator],
        redrawn: Counter[str],
    ) -> list[list[Points]]:
        """Return the vertices of each body in poses without self-intersections."""
        accepted: list[list[Points]] = [[] for _ in names]
        for _ in range(MOST_DRAWS):
            missing = [place for place, vertices in enumerate(accepted) if len(vertices) < self.poses]
            if not missing:
                return accepted
            poses: list[list[Pose]] = [[varied_pose(randoms[place]) for _ in range(self.poses)] for place in missing]
            posed = model.posed([bodies[place] for place in missing], poses)
            for place, candidates in zip(missing, posed, strict=True):
                height = height_of(shapes[place])
                for vertices in candidates:
                    if len(accepted[place]) == self.poses:
                        break
                    if doubled_share(vertices, model.faces, height) > LARGEST_DOUBLED:
                        redrawn[POSES_OVERLAP] += 1
                    else:
                        accepted[place].append(vertices)
        raise hopeless(next(name for name, vertices in zip(names, accepted, strict=True) if len(vertices) < self.poses))


def drawn_bodies(
    shaped: Callable[[list[Body]], Sequence[S]],
    standing: Callable[[Sequence[S]], Iterable[Points]],
    faces: Faces,
    names: Sequence[str],
    randoms: Sequence[np.random.Generator],
    redrawn: Counter[str],
) -> tuple[list[S], list[Points]]:
    """Draw bodies of human height without self-intersections in the canonical pose.

    Parameters
    ----------
    shaped
        Function from drawn bodies to bodies at rest.
    standing
        Function from bodies at rest to their vertices in the canonical pose.
    faces
        Triangles of the vertices.
    names, randoms
        Name and random generator of each body.
    redrawn
        Counter of redraws by reason, updated in place.

    Returns
    -------
    bodies, vertices
        Bodies at rest, and their vertices in the canonical pose.
    """
    drawn: dict[int, S] = {}
    shapes: dict[int, Points] = {}
    missing = list(range(len(names)))
    for _ in range(MOST_DRAWS):
        candidates = shaped([varied_body(randoms[place]) for place in missing])
        for place, body, vertices in zip(missing, candidates, standing(candidates), strict=True):
            height = height_of(vertices)
            if not SHORTEST < height < TALLEST:
                redrawn[BODIES_LEAVE] += 1
            elif doubled_share(vertices, faces, height) > LARGEST_DOUBLED:
                redrawn[POSES_OVERLAP] += 1
            else:
                drawn[place], shapes[place] = body, vertices
        missing = [place for place in missing if place not in drawn]
        if not missing:
            return [drawn[place] for place in range(len(names))], [shapes[place] for place in range(len(names))]
    raise hopeless(names[missing[0]])


def height_of(vertices: Points) -> float:
    """Return the extent of a standing body along the vertical axis."""
    return float(np.ptp(vertices[:, 2]))


def hopeless(name: str) -> DatasetError:
    """Return the error for a body without a valid draw."""
    return DatasetError(
        f"{name} has no pose that does not push it through itself in {MOST_DRAWS} draws", "take another seed"
    )
