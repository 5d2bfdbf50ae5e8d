"""Scanned bodies as the field sees them: batches of which most show scans again, from a window that moves along.

A scan costs more than a step, so each is used several times: a batch shows the newest group of bodies and some older
ones, ``LAG`` batches apart, in another frame, as other points, and half of them mirrored. Which groups these are is a
matter of the batch's number alone, so that a training goes on as if it had not been stopped.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.api.streaming import MakesScans, Scan
from benchmark.errors import ConfigurationError
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh, Points, edges_of
from learned.field.batches import EDGES, SurfaceBatch, noised, shares
from learned.field.configuration import Field
from learned.field.sampling import random_samples
from learned.frame import centred, frame_of

LAG = 32
"""Batches between two uses of a group of bodies."""

LONGEST, SLACK = 2.0, 0.01
"""An edge joins two parts of the body, and is not asked for, if its ends lie farther apart in the canonical pose than
this multiple of its length and, in roots of the area, so much more."""

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Seen:
    """Everything of a scan that does not change from use to use.

    Parameters
    ----------
    vertices, faces
        Of the scan, in metres.
    normals
        Unit normals of the vertices.
    targets, target_normals
        Where the vertices belong in the canonical pose of the body, which has unit area and its centroid at the origin,
        and which way the surface looks there.
    edges, chances
        Edges that may be asked for, and how likely each is.
    height
        Of the body in the canonical pose, in roots of its area.
    """

    vertices: Single
    faces: NDArray[np.int32]
    normals: Single
    targets: Single
    target_normals: Single
    edges: NDArray[np.int64]
    chances: NDArray[np.float64]
    height: float

    @classmethod
    def of(cls, scan: Scan, canonical: Mesh) -> Seen:
        """Facts of a scan of a body that stands in the canonical pose, centred."""
        body_normals = _unit(vertex_normals(canonical))
        targets, target_normals = (
            np.einsum("nc,nck->nk", scan.weights, values[scan.corners]) for values in (canonical.vertices, body_normals)
        )
        mesh = scan.mesh
        ends = edges_of(mesh.faces).ends
        lengths, true_lengths = (
            np.linalg.norm(values[ends[:, 0]] - values[ends[:, 1]], axis=1) for values in (mesh.vertices, targets)
        )
        asked = true_lengths <= LONGEST * lengths / mesh.area**0.5 + SLACK
        ends = ends[asked] if asked.any() else ends
        # As if a vertex were drawn by its share of the area, and then one of its neighbours.
        chances = (shares(mesh) / np.bincount(ends.ravel(), minlength=mesh.n_vertices).clip(min=1))[ends].sum(axis=1)
        return cls(
            vertices=mesh.vertices.astype(np.float32),
            faces=mesh.faces,
            normals=_unit(vertex_normals(mesh)).astype(np.float32),
            targets=targets.astype(np.float32),
            target_normals=_unit(target_normals).astype(np.float32),
            edges=ends,
            chances=chances / chances.sum(),
            height=float(np.ptp(canonical.vertices[:, 2])),
        )

    def mirrored(self) -> Seen:
        """Return the scan of the mirror image of the body: left is right in both poses."""
        flip = np.array([-1, 1, 1], dtype=np.float32)
        places = {name: getattr(self, name) * flip for name in ("vertices", "normals", "targets", "target_normals")}
        return replace(self, faces=self.faces[:, ::-1], **places)


@dataclass(frozen=True, eq=False)
class Group:
    """Bodies that are used together: names, all scans, and how often something was drawn again."""

    identifiers: tuple[str, ...]
    seen: tuple[Seen, ...]
    drawn_again: dict[str, int]


_KEPT: dict[tuple[MakesScans, int, int], Group] = {}
"""Groups that later batches of this process show again, by maker, bodies and number."""


@dataclass(frozen=True)
class MakesScanBatches:
    """Makes batches; can be sent to another process.

    Parameters
    ----------
    make
        Makes scans of fresh bodies.
    configuration
        What the network sees of them.
    bodies
        Bodies of each batch.
    uses
        Batches that show each body; a divisor of ``bodies``.
    perturbed
        Whether frames and points are perturbed, and scans mirrored, as in training.
    """

    make: MakesScans
    configuration: Field
    bodies: int
    uses: int = 1
    perturbed: bool = True

    def __post_init__(self) -> None:
        """Raise ``ConfigurationError`` if a batch cannot be made of whole groups."""
        if self.bodies % self.uses:
            raise ConfigurationError(
                f"batches of {self.bodies} bodies cannot show each body {self.uses} times", "take a multiple as bodies"
            )

    def __call__(self, number: int) -> SurfaceBatch:
        """Make one batch."""
        groups = list(self._groups(number))
        rows = []
        for place, seen in enumerate(scan for group in groups for scan in group.seen):
            rows.append(self._row(seen, np.random.default_rng([number, place])))
        names = tuple(name for group in groups for name in group.identifiers)
        return SurfaceBatch.of(number, names, rows, groups[-1].drawn_again)

    def _groups(self, number: int) -> Iterator[Group]:
        """Groups of a batch, the newest last."""
        bodies = self.bodies // self.uses
        for old in [key for key in _KEPT if key[:2] == (self.make, bodies) and key[2] < number]:
            del _KEPT[old]
        for place in range(self.uses):
            key = (self.make, bodies, number + place * LAG)
            if key not in _KEPT:
                _KEPT[key] = self._drawn(key[2], bodies)
            yield _KEPT[key]

    def _drawn(self, number: int, bodies: int) -> Group:
        drawn = self.make(number, bodies)
        seen = []
        for canonical, scans in zip(drawn.canonical, drawn.scans, strict=True):
            target = centred(Mesh(canonical, drawn.faces))
            seen += [Seen.of(scan, target) for scan in scans]
        return Group(drawn.identifiers, tuple(seen), dict(drawn.drawn_again))

    def _row(self, seen: Seen, random: np.random.Generator) -> tuple[Points | Single | float, ...]:
        """Points and positions with their normals in the frame of a scan, where they belong, and the height."""
        if self.perturbed and random.random() < 0.5:
            seen = seen.mirrored()
        mesh = Mesh(seen.vertices.astype(np.float64), seen.faces)
        frame = frame_of(mesh, random if self.perturbed else None)
        inside = frame.seen(mesh)
        samples = random_samples(inside, self.configuration.points, random)
        asked = seen.edges[random.choice(len(seen.edges), EDGES, p=seen.chances)].T.ravel()
        points, positions = samples.points, inside.vertices[asked]
        if self.perturbed:
            points, positions = noised(points, random), noised(positions, random)
        normals = seen.normals[asked] @ frame.axes.T
        targets, target_normals = seen.targets[asked], seen.target_normals[asked]
        return points, samples.normals, positions, normals, targets, target_normals, seen.height


def bodies_made(steps: int, bodies: int, uses: int) -> int:
    """Return how many bodies a training of so many steps sees, each ``uses`` times but for the first and the last."""
    return bodies // uses * (steps + (uses - 1) * min(LAG, steps))


def _unit(vectors: Points) -> Points:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True).clip(min=np.finfo(float).tiny))
