"""Preparation of meshes (one component, unit area, about 2000 vertices), and re-meshing."""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmark.errors import ConfigurationError, InvalidMesh
from benchmark.geometry import cleaning
from benchmark.geometry.bridging import bridge_components
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh, Points, in_spatial_order

#: Largest fraction of the area in components that are dropped, smallest first; the others are parts
#: of the shape.
DEBRIS = 0.01

#: Largest fraction of triangles with zero area; beyond it, a stray vertex has dwarfed the rest of
#: the shape.
LARGEST_DEGENERATE_SHARE = 0.5

#: Decimals of coordinates, in units of the root of the area: what a file says beyond seven digits
#: is not the shape.
_DECIMALS = 6

#: Largest surplus of vertices after decimation, as a fraction of their number.
_LARGEST_MISS = 0.01

#: Most rounds of decimation.
_MOST_ROUNDS = 8
#: Fewest vertices of a prepared mesh: those of a tetrahedron.
_FEWEST_VERTICES = 4


@dataclass(frozen=True, eq=False)
class Prepared:
    """A mesh prepared for the methods.

    Parameters
    ----------
    mesh
        One component, unit area, at most about the requested number of vertices.
    surface
        The cleaned and oriented mesh before decimation and bridges, in the coordinates of ``mesh``.
    source_area
        Area of the kept components before decimation, in squared file units.
    centre, scale
        Transform to file coordinates, ``centre + scale * point``; shape (3,), and a factor.
    report
        Counts from preparation: ``vertices_before``, ``faces_before``, ``merged``,
        ``degenerate_faces``, ``duplicate_faces``, ``unreferenced``, ``boundary_edges``,
        ``non_manifold_edges`` and ``non_manifold_vertices`` of the cleaned mesh, ``components``,
        ``dropped_components``, ``lost_area`` (fraction of the area lost with them or with faces at
        non-manifold edges), ``bridges``, ``largest_gap`` (the longest bridge, in units of the root
        of the area), ``vertices`` and ``faces`` of the result, ``euler_characteristic``.
    """

    mesh: Mesh
    surface: Mesh
    source_area: float
    centre: Points
    scale: float
    report: dict[str, float]

    @property
    def notes(self) -> dict[str, float]:
        """What a user should know of joined pieces; empty if there are none.

        ``joined_pieces``, and the ``largest_gap`` between them in units of the file.
        """
        bridges = self.report["bridges"]
        if not bridges:
            return {}
        return {
            "joined_pieces": bridges + 1,
            "largest_gap": self.scale * self.report["largest_gap"],
        }

    def in_unit_area(self, mesh: Mesh) -> Points:
        """Return the vertices of the file in the coordinates of the prepared mesh."""
        return np.asarray((mesh.vertices - self.centre) / self.scale)

    def numbers_of(self, mesh: Mesh) -> IntArray | None:
        """Return the vertex of the prepared mesh at each vertex of the file, shape (n,).

        None if the mesh was decimated.
        """
        distances, nearest = cKDTree(self.mesh.vertices).query(self.in_unit_area(mesh))
        is_decimated = distances.max(initial=0.0) > cleaning.SEAM * cleaning.COPIES
        return None if is_decimated else nearest

    def vertex_map(self, mesh: Mesh) -> IntArray:
        """Return the nearest vertex of the file at each vertex of the prepared mesh, shape (n,)."""
        tree = cKDTree(self.in_unit_area(mesh), balanced_tree=False, compact_nodes=False)
        return np.asarray(tree.query(self.mesh.vertices)[1])


def prepare(mesh: Mesh, n_vertices: int = 2000) -> Prepared:
    """Clean, decimate and scale a mesh.

    The result depends on the shape alone, not on unit, place or order of the file. The steps are:
    remove duplicates; centre, scale to unit area and round; sort by position; open non-manifold
    edges and vertices; drop the smallest components, up to one per cent of the area in all;
    decimate to ``n_vertices`` by quadric edge collapse [Garland and Heckbert 1997] (smaller meshes
    keep all vertices); bridge the other components; scale to unit area and sort again.

    Parameters
    ----------
    mesh
        Any triangle mesh.
    n_vertices
        Target number of vertices, reached within one per cent if the topology allows it.

    Returns
    -------
    Prepared
        The mesh, its original area and position, and the counts.

    Raises
    ------
    InvalidMesh
        If the mesh has no area, most of its triangles have no area, fewer than four vertices
        remain, or the area loss exceeds ``LARGEST_AREA_LOSS``.
    """
    # Prevents underflow of areas in any file unit; a power of two keeps all digits, so duplicates
    # stay equal.
    unit = 2.0 ** np.floor(np.log2(cleaning.extent_of(cleaning.compact(mesh.vertices, mesh.faces))))
    cleaned, removed = cleaning.clean(mesh.with_vertices(mesh.vertices / unit))
    if not cleaned.n_faces or removed["degenerate_faces"] > LARGEST_DEGENERATE_SHARE * mesh.n_faces:
        problem = f"{removed['degenerate_faces']} of {mesh.n_faces} triangles have no area"
        raise InvalidMesh(problem, "pass a surface, look for stray vertices, or export it again")
    centre = cleaned.vertices.mean(axis=0)
    size = np.sqrt(cleaned.area)
    scaled = cleaned.with_vertices((cleaned.vertices - centre) / size)
    whole = in_spatial_order(scaled.with_vertices(np.round(scaled.vertices, _DECIMALS)))
    counts = cleaning.topology(whole)

    is_manifold = counts["non_manifold_edges"] == counts["non_manifold_vertices"] == 0
    manifold = whole if is_manifold else cleaning.make_manifold(whole)
    areas, piece = cleaning.component_areas(manifold)
    oriented, turned, one_sided = cleaning.orient(manifold, areas, piece)
    parts, dropped = _without_debris(oriented, areas, piece)
    if turned:
        parts = in_spatial_order(parts)
    opened, lost = _decimated(parts, n_vertices, whole.area)
    joined, gaps = _joined(opened)
    if joined.n_vertices < _FEWEST_VERTICES:
        problem = f"{joined.n_vertices} vertices remain after preparation"
        raise InvalidMesh(problem, f"pass a surface of at least {_FEWEST_VERTICES} vertices")

    growth = np.sqrt(joined.area)
    result = in_spatial_order(joined.with_vertices(joined.vertices / growth))
    report: dict[str, float] = {
        **removed,
        **counts,
        "opened_edges": max(0, len(manifold.edges.boundary) - counts["boundary_edges"]),
        "turned_faces": turned,
        "one_sided_components": one_sided,
        "dropped_components": dropped,
        "lost_area": lost,
        "bridges": len(gaps),
        "largest_gap": max(gaps, default=0.0) / growth,
        "vertices": result.n_vertices,
        "faces": result.n_faces,
        "euler_characteristic": result.n_vertices - len(result.edges.ends) + result.n_faces,
    }
    return Prepared(
        mesh=result,
        surface=parts.with_vertices(parts.vertices / growth),
        source_area=parts.area * (unit * size) ** 2,
        centre=unit * centre,
        scale=float(unit * size * growth),
        report={name: float(value) for name, value in report.items()},
    )


def _decimated(parts: Mesh, n_vertices: int, whole_area: float) -> tuple[Mesh, float]:
    """Decimate a mesh, make it manifold again, and measure the area that preparation loses.

    Parameters
    ----------
    parts
        A manifold mesh, from which small components have been dropped.
    n_vertices
        Target number of vertices.
    whole_area
        Area of the mesh before any component was dropped.

    Returns
    -------
    opened : Mesh
        The decimated manifold mesh.
    lost : float
        Fraction of the whole area that is lost, rounded to 6 decimals.

    Raises
    ------
    InvalidMesh
        If that is more than ``LARGEST_AREA_LOSS``.
    """
    reduced = decimate(parts, n_vertices)
    opened = reduced
    if reduced is not parts:
        cleaned, _ = cleaning.clean(reduced)
        opened = cleaning.make_manifold(cleaned)
    # Only area that is dropped before and after decimation counts as lost. Decimation itself makes
    # the surface smoother and its area smaller, too, which is no loss.
    kept = parts.area / whole_area * (opened.area / reduced.area)
    lost = max(0.0, round(1 - kept, 6))
    if lost > cleaning.LARGEST_AREA_LOSS:
        problem = f"preparation would lose {lost:.0%} of the area: triangles overlap in edges"
        hint = "join what belongs together, and remove what does not belong to the shape"
        raise InvalidMesh(problem, hint)
    return opened, lost


def _joined(mesh: Mesh) -> tuple[Mesh, list[float]]:
    """Return a mesh whose components are joined by bridges, and the lengths of these."""
    joined, gaps = bridge_components(mesh)
    if not gaps:
        return joined, gaps
    # Bridges may bring copies and triangles without area; cleaning may divide the mesh again.
    cleaned = cleaning.make_manifold(cleaning.clean(joined)[0])
    if cleaning.connected_components(cleaned).any():
        return joined, gaps
    return cleaned, gaps


def _without_debris(mesh: Mesh, areas: FloatArray, piece: IntArray) -> tuple[Mesh, int]:
    """Return the mesh without its smallest components, and their number.

    They have at most :data:`DEBRIS` of the area.
    """
    order = np.argsort(areas, kind="stable")
    debris = order[np.cumsum(areas[order]) <= DEBRIS * areas.sum()]
    if not len(debris):
        return mesh, 0
    kept = ~np.isin(piece, debris)
    return cleaning.compact(mesh.vertices, mesh.faces[kept]), len(debris)


def decimate(mesh: Mesh, n_vertices: int) -> Mesh:
    """Collapse edges by least quadric error until about ``n_vertices`` vertices remain.

    Topology is preserved; boundaries keep their shape, but not all their vertices.

    Parameters
    ----------
    mesh
        Manifold mesh.
    n_vertices
        Target number of vertices.

    Returns
    -------
    Mesh
        The decimated mesh, or ``mesh`` itself if it is small enough.
    """
    if mesh.n_vertices <= n_vertices:
        return mesh
    # MeshLab takes a target number of faces. That of a given number of vertices depends on how many
    # edges remain at the boundary: the first target assumes none, and further rounds remove the
    # surplus vertices.
    boundary = len(mesh.edges.boundary)
    target = mesh.n_faces + boundary - 2 * (mesh.n_vertices - n_vertices)
    # A quarter of the largest miss that is allowed ends the rounds.
    largest_surplus = _LARGEST_MISS * n_vertices / 4
    for _ in range(_MOST_ROUNDS):
        mesh = _collapse(mesh, target)
        surplus = mesh.n_vertices - n_vertices
        # A collapse removes two faces. If more are left over, topology allows no further collapse.
        is_stuck = mesh.n_faces > target + 2
        if surplus <= largest_surplus or is_stuck:
            break
        target = mesh.n_faces - round(surplus * mesh.n_faces / mesh.n_vertices)
    return mesh


def filtered(mesh: Mesh, name: str, **parameters: object) -> Mesh:
    """Apply a pymeshlab filter with all its parameters, which pymeshlab keeps between calls."""
    pymeshlab = import_pymeshlab()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    meshes.apply_filter(name, **parameters)
    result = meshes.current_mesh()
    return Mesh(result.vertex_matrix(), result.face_matrix())


def import_pymeshlab() -> Any:
    """Import the package pymeshlab, and return it.

    Its first import must happen in the main thread: in any other, it corrupts memory.

    Raises
    ------
    ConfigurationError
        If it was not imported before and this is another thread, or if it cannot be imported.
    """
    if "pymeshlab" not in sys.modules and threading.current_thread() is not threading.main_thread():
        problem = (
            "pymeshlab corrupts the memory of a process that loads it first "
            "in another thread than the main one"
        )
        raise ConfigurationError(problem, "write 'import pymeshlab' in the main thread before")
    try:
        import pymeshlab
    except ImportError as error:
        hint = "on Debian and Ubuntu: apt-get install libgl1 libopengl0 libfontconfig1 libcom-err2"
        raise ConfigurationError(f"pymeshlab cannot be imported: {error}", hint) from error
    return pymeshlab


def _collapse(mesh: Mesh, n_faces: int) -> Mesh:
    """Collapse edges by least quadric error, down to a number of faces if the topology allows it.

    All parameters of MeshLab's filter are given, as their defaults differ between releases.

    Parameters
    ----------
    mesh
        A manifold mesh.
    n_faces
        Number of faces to reach.
    """
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


def isotropic_remesh(mesh: Mesh, edge: float, *, iterations: int, feature_degrees: float) -> Mesh:
    """Return a surface re-meshed with triangles of nearly equal edges.

    All parameters of MeshLab's filter are given, as their defaults differ between releases.

    Parameters
    ----------
    mesh
        The surface.
    edge
        Target edge length, in units of the mesh.
    iterations
        Rounds of splitting, collapsing, flipping and smoothing.
    feature_degrees
        Angle above which sharp edges are preserved, in degrees.

    References
    ----------
    Hoppe, DeRose, Duchamp, McDonald, Stuetzle, "Mesh optimization", 1993, as implemented in
    MeshLab.
    """
    pymeshlab = import_pymeshlab()
    return filtered(
        mesh,
        "meshing_isotropic_explicit_remeshing",
        iterations=iterations,
        adaptive=False,
        selectedonly=False,
        targetlen=pymeshlab.PureValue(edge),
        featuredeg=feature_degrees,
        checksurfdist=False,
        maxsurfdist=pymeshlab.PercentageValue(1.0),
        splitflag=True,
        collapseflag=True,
        swapflag=True,
        smoothflag=True,
        reprojectflag=True,
    )
