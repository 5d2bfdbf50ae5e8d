"""Other triangulations of a surface, coarser and finer."""

from __future__ import annotations

import igl
import numpy as np
import pymeshlab

from benchmark.geometry.mesh import Mesh

SIDE = 2.2
"""Edges of the grid of clusters, in roots of the mean area of a vertex, that leave about as many as asked for."""


def subdivided(mesh: Mesh, times: int) -> Mesh:
    """Surface with each triangle cut into four, several times."""
    vertices, faces = igl.upsample(mesh.vertices, mesh.faces.astype(np.int64), times)
    return Mesh(vertices, faces.astype(np.int32))


def clustered(mesh: Mesh, n_vertices: int) -> Mesh:
    """Surface whose vertices are the means of what falls into the cells of a grid [Rossignac and Borrel 1993].

    Parameters
    ----------
    mesh
        A surface.
    n_vertices
        Vertices to come near to.
    """
    cell = SIDE / 2 * (mesh.area / n_vertices) ** 0.5
    made = _changed(mesh, "meshing_decimation_clustering", threshold=pymeshlab.PureValue(cell))
    # The filter gives the triangles in an order that hangs on where they lay in memory.
    first = made.faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(made.faces, (first + np.arange(3)) % 3, axis=1)
    return Mesh(made.vertices, faces[np.lexsort(faces.T[::-1])])


def collapsed(mesh: Mesh, n_vertices: int) -> Mesh:
    """Surface with its shortest edges collapsed onto vertices that it had, until so many are left."""
    return _changed(
        mesh,
        "meshing_decimation_quadric_edge_collapse",
        targetfacenum=2 * n_vertices,
        targetperc=0.0,
        qualitythr=0.5,
        preserveboundary=True,
        boundaryweight=1.0,
        preservenormal=True,
        preservetopology=False,
        optimalplacement=False,
        planarquadric=False,
        planarweight=0.001,
        qualityweight=False,
        autoclean=True,
        selected=False,
    )


def _changed(mesh: Mesh, change: str, **how: object) -> Mesh:
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.apply_filter(change, **how)
    return Mesh(work.current_mesh().vertex_matrix(), work.current_mesh().face_matrix())
