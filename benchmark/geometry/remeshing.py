"""Isotropic re-meshing: triangles of one size."""

from __future__ import annotations

from benchmark.geometry.mesh import Mesh


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

    layers = pymeshlab.MeshSet(verbose=False)
    layers.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    # pymeshlab remembers parameters from call to call, so every one is named.
    layers.meshing_isotropic_explicit_remeshing(
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
    result = layers.current_mesh()
    return Mesh(result.vertex_matrix(), result.face_matrix())
