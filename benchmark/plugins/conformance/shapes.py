"""Small shapes to try methods on: a figure with limbs in a few poses, and surfaces that are hard to treat."""

from __future__ import annotations

from functools import cache

import numpy as np

from benchmark.api.contracts import FloatArray, Mesh, Shape
from benchmark.geometry.camera import Camera
from benchmark.geometry.cleaning import compact
from benchmark.geometry.depth import back_project, fit_half_width, render_depth
from benchmark.geometry.preparation import prepare

#: Angles in radians by which the limbs of the figure bend in its poses.
BENDS = (0.7, 0.2, 1.1)

#: Vertices of the figure: enough for a hundred eigenfunctions, few enough for all pairs in a blink.
N_VERTICES = 500

_CELLS = 48
_BLEND = 0.04
_PIXEL_STRIDE = 9
_CAMERA = Camera((0.35, 1.0, -0.2))


@cache
def figure(bend: float = BENDS[0]) -> Mesh:
    """Closed surface of a body with a head, an arm, a leg and a tail, of unit area.

    No two limbs share length, thickness or direction, so the surface has no symmetry that would leave an axis or the
    order of two eigenvalues open.

    Parameters
    ----------
    bend
        Angle in radians by which the arm, the leg and the tail each turn at every joint.
    """
    import igl

    bones = _bones(bend)
    ends = np.concatenate([bones[:, :3], bones[:, 3:6]])
    margin = bones[:, 6].max() + 4 * _BLEND
    axes = [np.linspace(ends[:, k].min() - margin, ends[:, k].max() + margin, _CELLS) for k in range(3)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    grid = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    vertices, faces, _ = igl.marching_cubes(_blended_distance(grid, bones), grid, _CELLS, _CELLS, _CELLS, 0.0)
    return prepare(Mesh(vertices, faces), N_VERTICES).mesh


@cache
def view(bend: float = BENDS[0]) -> Shape:
    """The figure as one depth camera sees it: open, in pieces that are bridged, with its depth image."""
    mesh = figure(bend)
    half_width = fit_half_width([mesh], _CAMERA)
    depth = render_depth(mesh, _CAMERA, half_width)
    depth.flags.writeable = False
    surface, _ = back_project(depth, half_width, _PIXEL_STRIDE)
    area = surface.area
    return Shape(
        identifier=f"view of the figure bent by {bend}",
        mesh=surface.with_vertices(surface.vertices / np.sqrt(area)),
        depth=depth,
        source_area=area,
    )


def awkward() -> dict[str, Mesh]:
    """Valid meshes that a method may refuse as unsupported, but must not stumble over, by name."""
    corners = np.array([[0.0, 0.0, 0.0], [1.1, 0.1, 0.0], [0.3, 0.9, 0.1], [0.2, 0.4, 1.3]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    other = figure(BENDS[1])
    pair = Mesh(
        np.concatenate([figure().vertices, other.vertices + np.array([3.0, 0.0, 0.0])]),
        np.concatenate([figure().faces, other.faces + figure().n_vertices]),
    )
    return {
        "a triangle": Mesh(corners[:3], sides[:1]),
        "a tetrahedron": Mesh(corners, sides),
        "a flat sheet": _sheet(),
        "two pieces": pair,
        "an open surface": view().mesh,
    }


def _sheet(rows: int = 11, columns: int = 14) -> Mesh:
    u, v = np.meshgrid(np.arange(rows, dtype=float), np.arange(columns) * 0.9, indexing="ij")
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + columns, first + 1], axis=1),
            np.stack([first + 1, first + columns, first + columns + 1], axis=1),
        ]
    )
    return compact(np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1) / 10, faces)


def _bones(bend: float) -> FloatArray:
    """Bones as rows of start, end and radius, shape (b, 7)."""
    body = [[0.0, 0.0, 0.0, 0.0, 0.05, 0.62, 0.17]]
    head = [[0.0, 0.05, 0.62, 0.09, -0.05, 0.95, 0.13]]
    arm = _limb([0.1, 0.0, 0.52], [0.9, -0.3, 0.3], [0.0, 0.6, 0.8], bend, [0.30, 0.26], 0.075)
    leg = _limb([-0.05, 0.0, 0.0], [-0.45, 0.1, -0.9], [1.0, 0.2, -0.3], bend, [0.42, 0.38], 0.095)
    tail = _limb([0.05, 0.05, 0.0], [0.4, 0.8, -0.4], [0.2, -0.5, 0.9], bend, [0.34, 0.32, 0.28], 0.06)
    return np.array([*body, *head, *arm, *leg, *tail])


def _limb(
    start: list[float], direction: list[float], towards: list[float], bend: float, lengths: list[float], radius: float
) -> list[list[float]]:
    """Bones of a chain that turns by ``bend`` at every joint in the plane of two directions."""
    along = np.array(direction) / np.linalg.norm(direction)
    aside = np.array(towards) - np.array(towards) @ along * along
    aside /= np.linalg.norm(aside)
    joint, bones = np.array(start), []
    for number, length in enumerate(lengths):
        end = joint + length * (np.cos(number * bend) * along + np.sin(number * bend) * aside)
        bones.append([*joint, *end, radius])
        joint = end
    return bones


def _blended_distance(points: FloatArray, bones: FloatArray) -> FloatArray:
    """Signed distance to the union of capsules, blended where they meet, shape (n,)."""
    nearness = np.zeros(len(points))
    for bone in bones:
        start, axis, radius = bone[:3], bone[3:6] - bone[:3], bone[6]
        share = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
        distance = np.linalg.norm(points - start - share[:, None] * axis, axis=1) - radius
        nearness += np.exp(-np.maximum(distance, -1.0) / _BLEND)
    return -_BLEND * np.log(np.maximum(nearness, 1e-30))
