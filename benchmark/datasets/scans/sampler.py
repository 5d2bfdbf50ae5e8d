"""Scans of random bodies; each batch depends only on its number."""

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
    """Sampler of batches; shares no body with :class:`benchmark.datasets.varied.wide.WideSampler`."""

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        """Generate a batch; see :class:`benchmark.api.streaming.MakesSurfaces`."""
        model, redrawn = coarse_model(self.triangles), Counter[str]()
        names = [f"scanned-{self.seed}-{number}-{place}" for place in range(bodies)]
        # Seeds differ from those of the two image streams, so that no bodies are shared.
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
"""Target number of vertices of decimation, as in the preparation of every comparison, and maximum number without
decimation, which is the most expensive step and hardly changes a thousand points of the surface."""

WELDED, WRAPPED = 0.55, 0.1
"""Fractions of scans with welded parts, and of wrapped scans, which are the most expensive."""

GAPS = (0.004, 0.03)
"""Widths of welded gaps, as fractions of the height of the standing body: from finger gaps to 5 centimetres."""

BALLS, OFFSETS = (0.018, 0.04), (0.0015, 0.004)
"""Ball radii and offsets of a wrap, as fractions of the diagonal of the bounding box."""

FINE, FINEST, COARSE = 0.06, 0.01, 0.4
"""Fractions of scans subdivided once, subdivided twice (the most expensive), and coarsened."""

FEWEST = 1000
"""Minimum number of vertices of a coarsened scan."""

MOST = 50_000
"""Maximum number of vertices after two subdivisions."""

WHITE = (5e-5, 2e-3)
"""Standard deviations of the noise, as fractions of the height: from .1 to 3.5 millimetres."""

SLIPPED, VIEWS, SLIPS = 0.5, (3, 9), (3e-4, 3e-3)
"""Fraction of scans with misaligned views, number of views, and standard deviations as fractions of the height."""

PATCHED, RADII, MOST_PATCHES = 0.5, (0.006, 0.05), 6
"""Fraction of scans with missing patches, their radii as fractions of the height, and their maximum number."""

BLIND, DEPTHS = 0.3, (0.005, 0.03)
"""Fraction of scans with a blind end, and its depth as a fraction of the height."""


@dataclass(frozen=True, kw_only=True)
class ScanSampler:
    """Sampler of batches; see :class:`benchmark.api.streaming.MakesScans`.

    Parameters
    ----------
    seed
        Seed of the stream; streams with different seeds share no body.
    poses
        Number of poses per body, each scanned once.
    """

    seed: int
    poses: int = 2

    def __call__(self, number: int, bodies: int) -> Scans:
        """Generate a batch."""
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
    """Scan a body: add random faults to its surface and map each vertex to the body.

    A vertex maps to the nearest position on the body with a similar normal. A skin over a gap is thus divided between
    the two parts that it joins, and no vertex maps to a wall invisible to a scanner.

    Parameters
    ----------
    body
        A closed surface in a pose.
    height
        Height of the standing body, in units of the vertices.
    random
        Random generator for the faults.
    """
    mesh = _retriangulated(_joined(body, height, random), random)
    mesh = _measured(mesh, height, random)
    mesh = _incomplete(mesh, height, random)
    if mesh.n_vertices > SMALL:
        mesh = largest_component(decimate(mesh, PREPARED))
    places = nearest_on_surface(body, mesh.vertices, vertex_normals(mesh))
    return Scan(mesh=mesh, corners=places.corners, weights=places.weights)


def _joined(body: Mesh, height: float, random: np.random.Generator) -> Mesh:
    """Fuse nearly touching parts."""
    kind = random.random()
    if kind < WELDED:
        return welded(body, height * _log_uniform(GAPS, random))
    if kind < WELDED + WRAPPED:
        return wrapped(body, _log_uniform(BALLS, random), _log_uniform(OFFSETS, random))
    return body


def _retriangulated(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """Change the triangulation."""
    kind = random.random()
    if kind < FINE + FINEST:
        return subdivided(mesh, 1 if kind < FINE or 16 * mesh.n_vertices > MOST else 2)
    fewer = int(_log_uniform((FEWEST, PREPARED), random))
    if kind > FINE + FINEST + COARSE or fewer >= mesh.n_vertices:
        return mesh
    return (clustered if random.random() < 0.5 else collapsed)(mesh, fewer)


def _measured(mesh: Mesh, height: float, random: np.random.Generator) -> Mesh:
    """Add measurement errors."""
    if random.random() < SLIPPED:
        mesh = misaligned(mesh, int(random.integers(*VIEWS)), height * _log_uniform(SLIPS, random), random)
    return noisy(mesh, height * _log_uniform(WHITE, random), random)


def _incomplete(mesh: Mesh, height: float, random: np.random.Generator) -> Mesh:
    """Remove unseen parts."""
    if random.random() < PATCHED:
        count = int(random.integers(1, MOST_PATCHES + 1))
        mesh = patched(mesh, height * np.array([_log_uniform(RADII, random) for _ in range(count)]), random)
    if random.random() < BLIND:
        direction = np.array([0.0, 0.0, random.choice([-1.0, 1.0])])
        mesh = blind(mesh, direction, height * _log_uniform(DEPTHS, random))
    return mesh


def _log_uniform(limits: tuple[float, float], random: np.random.Generator) -> float:
    return float(np.exp(random.uniform(*np.log(limits))))
