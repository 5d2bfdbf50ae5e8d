"""Prepare a mesh for all methods (one component, unit area, about 2000 vertices), and re-mesh it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmark.errors import InvalidMesh
from benchmark.geometry.bridging import bridge_components
from benchmark.geometry.cleaning import (
    LARGEST_LOSS,
    clean,
    compact,
    component_areas,
    extent_of,
    make_manifold,
)
from benchmark.geometry.mesh import Mesh, Points, edges_of, in_spatial_order

# Components with a smaller share of the area are debris; larger ones are parts of the shape.
SMALLEST_SHARE = 0.01
LARGEST_DEGENERATE_SHARE = 0.5
"""Share of triangles without area: beyond it, one stray vertex has made all others vanish beside it."""

_LARGEST_MISS = 0.01
_MOST_ROUNDS = 8
_FEWEST_VERTICES = 4


@dataclass(frozen=True, eq=False)
class Prepared:
    """A mesh that is ready for the methods.

    Parameters
    ----------
    mesh
        One component, unit area, at most about the number of vertices that was asked for.
    source_area
        Area of the components that were kept, before decimation, in squared file units.
    centre, scale
        How it lies in the file: a point of the mesh is at ``centre + scale * point`` there; shape (3,), and a factor.
    report
        What preparation found and did: ``vertices_before``, ``faces_before``, ``merged``, ``degenerate_faces``,
        ``duplicate_faces``, ``unreferenced``, ``boundary_edges``, ``non_manifold_edges`` and
        ``non_manifold_vertices`` of the cleaned mesh, ``components``, ``dropped_components``, ``lost_area`` (share of
        the area that went with them or with faces at non-manifold edges), ``bridges``, ``vertices`` and ``faces`` of
        the result, ``euler_characteristic``.
    """

    mesh: Mesh
    source_area: float
    centre: Points
    scale: float
    report: dict[str, float] = field(default_factory=dict)


def prepare(mesh: Mesh, n_vertices: int = 2000) -> Prepared:
    """Clean, decimate and scale a mesh.

    Duplicates and debris go, non-manifold edges and vertices are opened, quadric edge collapse [Garland and Heckbert
    1997] brings the mesh to ``n_vertices`` (a mesh with fewer keeps all of them), components that hold at least one
    per cent of the area are joined by bridges rather than dropped, and the area becomes 1. Vertices and triangles stand
    in an order that follows from positions alone.

    Parameters
    ----------
    mesh
        Any triangle mesh.
    n_vertices
        Number of vertices to reach, within one per cent where the topology allows it.

    Returns
    -------
    Prepared
        The mesh, its area before, and the counts.

    Raises
    ------
    InvalidMesh
        If nothing usable is left: no area, fewer than four vertices, or less than ``1 - LARGEST_LOSS`` of the area.
    """
    # Areas must not underflow, whatever the unit of the file; a power of two changes no digit: duplicates stay equal.
    unit = 2.0 ** np.floor(np.log2(extent_of(mesh)))
    cleaned, cleaning = clean(mesh.with_vertices(mesh.vertices / unit))
    if cleaned.n_vertices < _FEWEST_VERTICES or not cleaned.n_faces:
        raise InvalidMesh(
            f"after cleaning {cleaned.n_vertices} vertices and {cleaned.n_faces} triangles with area remain",
            f"pass a surface of at least {_FEWEST_VERTICES} vertices, not a point cloud or a single triangle",
        )
    if cleaning.degenerate_faces > LARGEST_DEGENERATE_SHARE * mesh.n_faces:
        raise InvalidMesh(
            f"{cleaning.degenerate_faces} of {mesh.n_faces} triangles have no area",
            "look for stray vertices, or export it again",
        )
    centre = cleaned.vertices.mean(axis=0)
    centred = cleaned.with_vertices(cleaned.vertices - centre)
    work = make_manifold(centred)
    areas, of_face = component_areas(work)
    kept = areas >= SMALLEST_SHARE * areas.sum()
    kept[np.argmax(areas)] = True
    work = compact(work.vertices, work.faces[kept[of_face]])
    source_area = work.area * unit**2
    decimated = decimate(work, n_vertices)
    opened = make_manifold(clean(decimated)[0])
    lost = max(0.0, round(1 - work.area / centred.area * (opened.area / decimated.area), 6))
    if lost > LARGEST_LOSS:
        raise InvalidMesh(
            f"preparation would lose {lost:.0%} of the area: {int((~kept).sum())} of {len(areas)} components are small "
            "debris, or triangles overlap in edges",
            "join what belongs together, and remove what does not belong to the shape",
        )
    work, bridges = bridge_components(opened)
    if work.n_vertices < _FEWEST_VERTICES:
        raise InvalidMesh(
            f"only {work.n_vertices} vertices remain after preparation",
            f"pass a connected surface of at least {_FEWEST_VERTICES} vertices",
        )
    size = np.sqrt(work.area)
    result = in_spatial_order(work.with_vertices(work.vertices / size))
    report = {
        "vertices_before": cleaning.vertices_before,
        "faces_before": cleaning.faces_before,
        "merged": cleaning.merged,
        "degenerate_faces": cleaning.degenerate_faces,
        "duplicate_faces": cleaning.duplicate_faces,
        "unreferenced": cleaning.unreferenced,
        "boundary_edges": cleaning.boundary_edges,
        "non_manifold_edges": cleaning.non_manifold_edges,
        "non_manifold_vertices": cleaning.non_manifold_vertices,
        "components": cleaning.components,
        "dropped_components": int((~kept).sum()),
        "lost_area": lost,
        "bridges": bridges,
        "vertices": result.n_vertices,
        "faces": result.n_faces,
        "euler_characteristic": result.n_vertices - len(edges_of(result.faces).ends) + result.n_faces,
    }
    return Prepared(
        result, source_area, unit * centre, float(unit * size), {name: float(value) for name, value in report.items()}
    )


def decimate(mesh: Mesh, n_vertices: int) -> Mesh:
    """Collapse edges by least quadric error until about ``n_vertices`` remain; fewer are never made more.

    Topology is preserved; boundaries keep their course, but not all their vertices. The number of faces that belongs to
    a number of vertices depends on the length of the boundary after decimation, so the first face target assumes none
    and the surplus of vertices is taken away in a few small steps.

    Parameters
    ----------
    mesh
        Manifold mesh.
    n_vertices
        Vertices to reach.

    Returns
    -------
    Mesh
        The decimated mesh, or ``mesh`` itself if it is small enough.
    """
    if mesh.n_vertices <= n_vertices:
        return mesh
    boundary = len(edges_of(mesh.faces).boundary)
    target = mesh.n_faces + boundary - 2 * (mesh.n_vertices - n_vertices)
    for _ in range(_MOST_ROUNDS):
        mesh = _collapse(mesh, target)
        surplus = mesh.n_vertices - n_vertices
        if surplus <= _LARGEST_MISS * n_vertices / 4 or mesh.n_faces > target + 2:
            break
        target = mesh.n_faces - round(surplus * mesh.n_faces / mesh.n_vertices)
    return mesh


def filtered(mesh: Mesh, name: str, **parameters: object) -> Mesh:
    """Apply a filter of pymeshlab; name all its parameters, because pymeshlab keeps them from call to call."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    meshes.apply_filter(name, **parameters)
    result = meshes.current_mesh()
    return Mesh(result.vertex_matrix(), result.face_matrix())


def _collapse(mesh: Mesh, n_faces: int) -> Mesh:
    return filtered(
        mesh,
        "meshing_decimation_quadric_edge_collapse",
        targetfacenum=int(n_faces),
        targetperc=0.0,
        qualitythr=0.3,
        preserveboundary=False,
        boundaryweight=1.0,
        preservenormal=True,
        preservetopology=True,
        optimalplacement=True,
        planarquadric=True,
        planarweight=0.001,
        qualityweight=False,
        autoclean=True,
        selected=False,
    )


def isotropic_remesh(
    mesh: Mesh, edge: float, *, iterations: int, feature_degrees: float, max_deviation: float | None = None
) -> Mesh:
    """Re-mesh a surface with edges of one length.

    Parameters
    ----------
    mesh
        The surface.
    edge
        Wanted length of the edges, in units of the mesh.
    iterations
        Rounds of splitting, collapsing, flipping and smoothing.
    feature_degrees
        Edges sharper than this are kept.
    max_deviation
        Largest distance from the given surface in percent of the diagonal of its bounding box; None for no bound.

    References
    ----------
    Hoppe, DeRose, Duchamp, McDonald, Stuetzle, "Mesh optimization", 1993, as implemented in MeshLab.
    """
    import pymeshlab

    return filtered(
        mesh,
        "meshing_isotropic_explicit_remeshing",
        iterations=iterations,
        adaptive=False,
        selectedonly=False,
        targetlen=pymeshlab.PureValue(edge),
        featuredeg=feature_degrees,
        checksurfdist=max_deviation is not None,
        maxsurfdist=pymeshlab.PercentageValue(1.0 if max_deviation is None else max_deviation),
        splitflag=True,
        collapseflag=True,
        swapflag=True,
        smoothflag=True,
        reprojectflag=True,
    )
