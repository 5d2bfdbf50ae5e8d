"""Training batches of scanned bodies for the field, from a moving window of groups.

A scan costs more than a step, so it is used several times: a batch shows the newest group of bodies and some older
ones, ``LAG`` batches apart, in another frame, with other points, and half of them mirrored. The groups depend only on
the number of the batch, so an interrupted training resumes with the same batches.
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
"""An edge joins two parts of the body, and is not sampled, if its ends are farther apart in the canonical pose than
``LONGEST`` times its length plus ``SLACK``, in units of sqrt(area)."""

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Seen:
    """Data of a scan that does not change between uses.

    Parameters
    ----------
    vertices, faces
        Mesh of the scan, in metres.
    normals
        Unit normals of the vertices.
    targets, target_normals
        Positions and unit normals of the vertices in the canonical pose of the body, which has unit area and its
        centroid at the origin.
    edges, chances
        Edges that may be sampled, and their probabilities.
    height
        Height of the body in the canonical pose, in units of sqrt(area).
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
        """Compute the data of a scan from its body in the canonical pose, centred."""
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
        # As if drawing a vertex by its share of the area, and then one of its neighbours.
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
        """Return the scan of the mirrored body, with left and right swapped in both poses."""
        flip = np.array([-1, 1, 1], dtype=np.float32)
        places = {name: getattr(self, name) * flip for name in ("vertices", "normals", "targets", "target_normals")}
        return replace(self, faces=self.faces[:, ::-1], **places)


@dataclass(frozen=True, eq=False)
class Group:
    """Bodies that are used together: names, all scans, and number of redraws by reason."""

    identifiers: tuple[str, ...]
    seen: tuple[Seen, ...]
    drawn_again: dict[str, int]


_KEPT: dict[tuple[MakesScans, int, int], Group] = {}
"""Groups that later batches of this process use again, by maker, group size and number."""


@dataclass(frozen=True)
class MakesScanBatches:
    """Maker of batches; can be sent to another process.

    Parameters
    ----------
    make
        Maker of scans of fresh bodies.
    configuration
        Configuration of the network.
    bodies
        Bodies per batch.
    uses
        Batches that show each body; a divisor of ``bodies``.
    perturbed
        Whether to perturb frames and points, and mirror scans, as in training.
    """

    make: MakesScans
    configuration: Field
    bodies: int
    uses: int = 1
    perturbed: bool = True

    def __post_init__(self) -> None:
        """Raise ``ConfigurationError`` if ``uses`` does not divide ``bodies``."""
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
        """Yield the groups of a batch, the newest last."""
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
        """Return points and positions in the frame of a scan, and targets, all with normals, and the height."""
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
    """Return the number of bodies in a training, each used ``uses`` times except for the first and the last."""
    return bodies // uses * (steps + (uses - 1) * min(LAG, steps))


def _unit(vectors: Points) -> Points:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True).clip(min=np.finfo(float).tiny))
