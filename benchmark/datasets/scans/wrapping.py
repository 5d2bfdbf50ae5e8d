"""A skin around a body that reaches into no gap narrower than a ball: one closed surface of other triangles."""

from __future__ import annotations

import igl
import numpy as np
import pymeshlab

from benchmark.geometry.mesh import Mesh

SETTLED = 3.0
"""Multiple of the offset up to which the skin falls back onto the body; farther away it spans a gap."""


def wrapped(mesh: Mesh, ball: float, offset: float) -> Mesh:
    """Wrap a surface in a skin that settles on it [Portaneri et al. 2022, "Alpha wrapping with an offset"].

    Parameters
    ----------
    mesh
        A surface.
    ball
        Radius of the ball that must fit into what the skin enters, as a share of the diagonal of the bounding box.
    offset
        Distance at which the skin is made, as a share of the same.
    """
    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.generate_alpha_wrap(
        alpha=pymeshlab.PercentageValue(100 * ball), offset=pymeshlab.PercentageValue(100 * offset)
    )
    skin = Mesh(work.current_mesh().vertex_matrix(), work.current_mesh().face_matrix())
    squares, _, feet = igl.point_mesh_squared_distance(skin.vertices, mesh.vertices, mesh.faces.astype(np.int64))
    near = squares < (SETTLED * offset * np.linalg.norm(np.ptp(mesh.vertices, axis=0))) ** 2
    return skin.with_vertices(np.where(near[:, None], feet, skin.vertices))
