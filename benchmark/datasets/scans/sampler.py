"""Scans of new bodies; a batch is a function of its number alone."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from benchmark.api.streaming import Scan, Scans, Surfaces
from benchmark.datasets.scans.noise import blind, misaligned, noisy, patched
from benchmark.datasets.scans.surfaces import clustered, collapsed, subdivided, welded, wrapped
from benchmark.datasets.varied.coarse import coarse_model
from benchmark.datasets.varied.sampler import height_of
from benchmark.datasets.varied.wide import WideSampler
from benchmark.geometry.cleaning import largest_component
from benchmark.geometry.interpolation import nearest_on_surface, vertex_normals
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import decimate


@dataclass(frozen=True, kw_only=True)
class WideBodies(WideSampler):
    """Makes batches; see :class:`benchmark.datasets.varied.wide.WideSampler`, with which it shares no body."""

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        """Make one batch; see :class:`benchmark.api.streaming.MakesSurfaces`."""
        model, redrawn = coarse_model(self.triangles), Counter[str]()
        names = [f"scanned-{self.seed}-{number}-{place}" for place in range(bodies)]
        # A number other than those of the two streams of images, so that no body of theirs comes here.
        randoms = [np.random.default_rng([self.seed, number, place, 2]) for place in range(bodies)]
        shapes, posed = self._drawn(model, names, randoms, redrawn)
        return Surfaces(
            identifiers=tuple(names),
            canonical=np.stack(shapes),
            posed=posed,
            faces=model.faces,
            drawn_again=dict(redrawn),
        )


PREPARED, SMALL = 2000, 4000
"""Vertices that a scan is decimated to, as in the preparation of every comparison, and up to which that is left out: it
costs more than all the rest, and changes little that a thousand points of the surface show."""

WELDED, WRAPPED = 0.55, 0.1
"""Shares of the scans whose parts are welded, and that are wrapped; a wrap costs the most."""

GAPS = (0.004, 0.03)
"""Widths of welded gaps, as shares of the height of the standing body: from a finger's distance to 5 centimetres."""

BALLS, OFFSETS = (0.018, 0.04), (0.0015, 0.004)
"""Radii of the ball and distances of the skin of a wrap, as shares of the diagonal of the body's box."""

FINE, FINEST, COARSE = 0.06, 0.01, 0.4
"""Shares of the scans that are subdivided once and twice, which cost the most, and that are made coarser."""

FEWEST = 1000
"""Vertices of the coarsest scan."""

MOST = 50_000
"""Vertices of the finest scan."""

WHITE = (5e-5, 2e-3)
"""Standard deviations of the noise, as shares of the height: from .1 to 3.5 millimetres."""

SLIPPED, VIEWS, SLIPS = 0.5, (3, 9), (3e-4, 3e-3)
"""Share of the scans of several views, how many, and the deviation of their slips as shares of the height."""

PATCHED, RADII, MOST_PATCHES = 0.5, (0.006, 0.05), 6
"""Share of the scans with patches missing, their radii as shares of the height, and how many at most."""

BLIND, DEPTHS = 0.3, (0.005, 0.03)
"""Share of the scans with a blind end, and how deep it is as a share of the height."""


@dataclass(frozen=True, kw_only=True)
class ScanSampler:
    """Makes batches; see :class:`benchmark.api.streaming.MakesScans`.

    Parameters
    ----------
    seed
        Seed of the stream; streams of different seeds share no body.
    poses
        Poses of each body, each scanned once.
    """

    seed: int
    poses: int = 2

    def __call__(self, number: int, bodies: int) -> Scans:
        """Make one batch."""
        surfaces = WideBodies(seed=self.seed, poses=self.poses).surfaces(number, bodies)
        scans = []
        for place, (canonical, posed) in enumerate(zip(surfaces.canonical, surfaces.posed, strict=True)):
            random = np.random.default_rng([self.seed, number, place, 3])
            scans.append(tuple(scan(Mesh(points, surfaces.faces), height_of(canonical), random) for points in posed))
        return Scans(
            identifiers=surfaces.identifiers,
            canonical=surfaces.canonical,
            faces=surfaces.faces,
            scans=tuple(scans),
            drawn_again=surfaces.drawn_again,
        )


def scan(body: Mesh, height: float, random: np.random.Generator) -> Scan:
    """Scan a body: its surface with faults that are drawn, and where each vertex belongs.

    A vertex belongs to the nearest place of the body that looks the same way. So a skin over a gap is shared between
    the two parts that it joins, each taking what is nearer, and no wall that a scanner cannot see is asked for.

    Parameters
    ----------
    body
        A closed surface in a pose.
    height
        Height of the body when it stands, in units of the vertices.
    random
        Source of the faults.
    """
    mesh = _retriangulated(_joined(body, height, random), random)
    mesh = _measured(mesh, height, random)
    mesh = _incomplete(mesh, height, random)
    if mesh.n_vertices > SMALL:
        mesh = largest_component(decimate(mesh, PREPARED))
    places = nearest_on_surface(body, mesh.vertices, vertex_normals(mesh))
    return Scan(mesh=mesh, corners=places.corners, weights=places.weights)


def _joined(body: Mesh, height: float, random: np.random.Generator) -> Mesh:
    """The surface, with parts that nearly touch made one."""
    kind = random.random()
    if kind < WELDED:
        return welded(body, height * _log_uniform(GAPS, random))
    if kind < WELDED + WRAPPED:
        return wrapped(body, _log_uniform(BALLS, random), _log_uniform(OFFSETS, random))
    return body


def _retriangulated(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """The same surface of other triangles."""
    kind = random.random()
    if kind < FINE + FINEST:
        return subdivided(mesh, 1 if kind < FINE or 16 * mesh.n_vertices > MOST else 2)
    fewer = int(_log_uniform((FEWEST, PREPARED), random))
    if kind > FINE + FINEST + COARSE or fewer >= mesh.n_vertices:
        return mesh
    return (clustered if random.random() < 0.5 else collapsed)(mesh, fewer)


def _measured(mesh: Mesh, height: float, random: np.random.Generator) -> Mesh:
    """The surface with errors of measurement."""
    if random.random() < SLIPPED:
        mesh = misaligned(mesh, int(random.integers(*VIEWS)), height * _log_uniform(SLIPS, random), random)
    return noisy(mesh, height * _log_uniform(WHITE, random), random)


def _incomplete(mesh: Mesh, height: float, random: np.random.Generator) -> Mesh:
    """The surface without what was not seen."""
    if random.random() < PATCHED:
        count = int(random.integers(1, MOST_PATCHES + 1))
        mesh = patched(mesh, height * np.array([_log_uniform(RADII, random) for _ in range(count)]), random)
    if random.random() < BLIND:
        direction = np.array([0.0, 0.0, random.choice([-1.0, 1.0])])
        mesh = blind(mesh, direction, height * _log_uniform(DEPTHS, random))
    return mesh


def _log_uniform(limits: tuple[float, float], random: np.random.Generator) -> float:
    return float(np.exp(random.uniform(*np.log(limits))))
