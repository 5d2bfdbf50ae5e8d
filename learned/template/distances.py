"""Signed distances around a surface, as rays: from a place on it straight away, as long as nothing else is nearer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh

Numbers = NDArray[np.float32]

MARGIN = 0.15
"""How far beyond the bounding box distances are known; the surface has unit area, a person a height of about 1.3."""

NEAR = 0.1
"""Rays that are no longer than this are near the surface."""

NEAR_SHARE = 0.75
"""Share of the rays that are near it, if there are as many: a person fills little of its bounding box."""

CANDIDATES = 3
"""Points in the box for each ray that is kept."""

LEAST_INSIDE = 1e-3
"""Share of the points in the box that must be inside: of a person some tens of times as many are."""

_SHORTEST = 1e-7
"""Points that are nearer to the surface have no direction."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays on which the signed distance to a surface is known: at ``feet + t * directions`` it is t in [0, length].

    Parameters
    ----------
    feet
        Places on the surface, shape (n, 3).
    directions
        Outward normals there, of unit length, shape (n, 3); the gradient of the distance along the whole ray.
    lengths
        Signed, negative inside, shape (n,).
    """

    feet: Numbers
    directions: Numbers
    lengths: Numbers


def rays_around(mesh: Mesh, count: int) -> Rays:
    """Rays from a surface to points that fill the space around it evenly.

    The points are those of a Halton sequence in the bounding box, so they do not depend on the numbering of the mesh or
    on its resolution. Inside is where the surface winds around [Jacobson et al. 2013; Barill et al. 2018], so that
    small holes do no harm; a surface that is turned inside out is turned back.

    Parameters
    ----------
    mesh
        A surface of unit area.
    count
        Number of rays.

    Raises
    ------
    UnsupportedShape
        If the surface encloses nothing.
    """
    import igl

    faces = mesh.faces.astype(np.int64)
    lowest, highest = mesh.vertices.min(axis=0) - MARGIN, mesh.vertices.max(axis=0) + MARGIN
    points = qmc.scale(qmc.Halton(3, scramble=False).random(CANDIDATES * count + 1)[1:], lowest, highest)
    winding = igl.fast_winding_number(mesh.vertices, faces, points)
    inside = winding * np.sign(winding[np.argmax(np.abs(winding))]) > 0.5
    if inside.mean() < LEAST_INSIDE:
        raise UnsupportedShape(
            "the surface encloses nothing, so there is no inside of it",
            "pass a closed surface, small holes aside, and not what one camera sees",
        )
    squared, _, feet = igl.point_mesh_squared_distance(points, mesh.vertices, faces)
    lengths = np.sqrt(squared) * np.where(inside, -1.0, 1.0)
    known = np.abs(lengths) > _SHORTEST
    chosen = _chosen(np.abs(lengths[known]), count)
    points, feet, lengths = (values[known][chosen] for values in (points, feet, lengths))
    directions = (points - feet) / lengths[:, None]
    return Rays(feet.astype(np.float32), directions.astype(np.float32), lengths.astype(np.float32))


def _chosen(lengths: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return which rays are kept, in their order, so that any first part of them is spread evenly, too."""
    near = np.flatnonzero(lengths <= NEAR)
    far = np.flatnonzero(lengths > NEAR)
    n_near = min(len(near), max(round(NEAR_SHARE * count), count - len(far)))
    kept = np.concatenate([near[:n_near], far[: count - n_near]])
    # The two kinds alternate as the points of the box did, near ones more often.
    place = np.concatenate(
        [np.arange(n_near) / max(n_near, 1), np.arange(len(kept) - n_near) / max(len(kept) - n_near, 1)]
    )
    return np.asarray(kept[np.argsort(place, kind="stable")])
