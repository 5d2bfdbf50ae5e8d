"""Changes of a surface or a camera, as pure functions of an amount and a random generator.

Random draws do not depend on the amount. Lengths are fractions of the longest side of the bounding
box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import UnsupportedShape
from benchmark.geometry.camera import Camera
from benchmark.geometry.cleaning import compact, extent_of, largest_component
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh, halved

Random = np.random.Generator

#: Radius of a hole.
HOLE_RADIUS = 0.02
#: Minimum number of vertices of a changed shape.
FEWEST_VERTICES = 50
#: Re-meshing iterations.
ROUNDS = 5
#: Minimum distance along the edges between two triangles to be joined, and as a multiple of their
#: Euclidean distance.
FARTHEST, DETOUR = 0.3, 2.0
#: Number of candidate triangles for one end of a shortcut.
TRIED = 100
#: Pixels per side of the perspective camera, share of them that the bounding sphere fills, and
#: largest step in depth within a triangle of what it sees, as a fraction of the extent.
PIXELS, FILL, STEP = 500, 0.95, 0.025


def noise(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Add independent Gaussian noise to every vertex, with the given standard deviation per coordinate."""
    return mesh.with_vertices(
        mesh.vertices + amount * extent_of(mesh) * random.standard_normal((mesh.n_vertices, 3))
    )


def holes(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Cut the given number of round holes at random positions; keep the largest piece."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    running = np.cumsum(mesh.face_areas)
    centres = middles[
        np.searchsorted(running, running[-1] * random.uniform(size=int(amount)) * (1 - 1e-12))
    ]
    radius, kept = HOLE_RADIUS * extent_of(mesh), np.ones(mesh.n_faces, dtype=bool)
    for centre in centres:
        kept &= np.linalg.norm(middles - centre, axis=1) >= radius
    return _rest(mesh, kept)


def missing_parts(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Cut off the outermost fraction of the area in a random direction; keep the largest piece."""
    direction = random.standard_normal(3)
    along = mesh.vertices[mesh.faces].mean(axis=1) @ (direction / np.linalg.norm(direction))
    order = np.argsort(along, kind="stable")
    running = np.cumsum(mesh.face_areas[order])
    kept = np.zeros(mesh.n_faces, dtype=bool)
    kept[order[running <= (1 - amount) * running[-1]]] = True
    return _rest(mesh, kept)


def resolution(mesh: Mesh, amount: float, _: Random) -> Mesh:
    """Change the number of vertices: halve all edges until there are enough, then collapse edges."""
    while mesh.n_vertices < amount:
        mesh = halved(mesh)
    from benchmark.geometry.preparation import (
        decimate,
    )  # which, as others here, takes half a second

    return decimate(mesh, int(amount))


def remeshing(mesh: Mesh, amount: float, _: Random) -> Mesh:
    """Re-mesh the surface isotropically with the given edge length."""
    from benchmark.geometry.preparation import isotropic_remesh

    return isotropic_remesh(mesh, amount * extent_of(mesh), iterations=ROUNDS, feature_degrees=30.0)


def turned(camera: Camera, amount: float, random: Random) -> Camera:
    """Turn a camera about the vertical by up to +- the amount, in degrees."""
    return turned_by(camera, np.radians(amount) * random.uniform(-1, 1))


def turned_by(camera: Camera, angle: float) -> Camera:
    """Turn a camera about the vertical by an angle in radians."""
    from scipy.spatial.transform import Rotation

    direction = Rotation.from_rotvec(angle * np.asarray(camera.up)).apply(camera.direction)
    return Camera(tuple(direction.tolist()), camera.up)


def seen_from_near(mesh: Mesh, camera: Camera, amount: float) -> Mesh:
    """Return the surface that a perspective camera sees from a distance of the given number of extents.

    The camera looks at the centre of the bounding box in the direction of the orthographic one. Its
    pixels become vertices in the coordinates of the mesh; triangles across steps in depth are left
    out.
    """
    from benchmark.geometry.rasterise import depth_buffer

    extent = extent_of(mesh)
    centre = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    points = (mesh.vertices - centre) @ camera.rotation.T
    depths = amount * extent - points[:, 2]
    reach = np.linalg.norm(points, axis=1).max()
    # The silhouette of a sphere lies at the tangent.
    focal = FILL * PIXELS / 2 * np.sqrt((amount * extent) ** 2 - reach**2) / reach
    across = PIXELS / 2 + focal * points[:, :2] / depths[:, None]
    # Inverse depths, unlike depths, are linear in the image.
    image = -1 / depth_buffer(np.column_stack([across, -1 / depths]), mesh.faces, PIXELS, np.inf)
    rows, columns = np.nonzero(image > 0)
    numbers = np.full(image.shape, -1)
    numbers[rows, columns] = np.arange(len(rows))
    depth = image[rows, columns].astype(np.float64)
    x, y = ((pixels + 0.5 - PIXELS / 2) * depth / focal for pixels in (columns, rows))
    seen = np.column_stack([x, y, amount * extent - depth]) @ camera.rotation + centre
    a, b, c, d = numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]
    faces = np.concatenate(
        [np.stack(corners, axis=2).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    )
    faces = faces[(faces >= 0).all(axis=1)]
    faces = faces[np.ptp(depth[faces], axis=1) < STEP * extent]
    return compact(seen, faces)


def shortcuts(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Join the given number of triangle pairs, near in space and far along the surface, by tubes.

    Nearby parts are fused as scanners and marching cubes fuse a hand and a hip. Among the
    candidates, the nearest pairs are joined first. A tube replaces its two triangles by six, so the
    surface stays a manifold and its genus increases by one.

    Raises
    ------
    UnsupportedShape
        If there are fewer such pairs.
    """
    starts = random.permutation(mesh.n_faces)[:TRIED]
    middles, extent = mesh.vertices[mesh.faces].mean(axis=1), extent_of(mesh)
    partners, gaps = _partners(mesh, middles, starts)
    used = np.zeros(mesh.n_vertices, dtype=bool)
    removed = np.zeros(mesh.n_faces, dtype=bool)
    tubes: list[IntArray] = []
    for number in np.argsort(gaps, kind="stable"):
        first, second = mesh.faces[starts[number]], mesh.faces[partners[number]]
        if len(tubes) == int(amount) or not np.isfinite(gaps[number]):
            break
        if used[first].any() or used[second].any():
            continue
        # Adjacent tubes would act as a single shortcut.
        used |= (
            np.linalg.norm(mesh.vertices - middles[starts[number]], axis=1) < FARTHEST / 5 * extent
        )
        used[first], used[second] = True, True
        removed[[starts[number], partners[number]]] = True
        tubes.append(_tube(mesh.vertices, first, second))
    if len(tubes) < int(amount):
        problem = f"the surface comes near itself at {len(tubes)} places, fewer than {int(amount)}"
        raise UnsupportedShape(problem, "choose a smaller strength")
    return Mesh(mesh.vertices, np.concatenate([mesh.faces[~removed], *tubes]))


def _partners(
    mesh: Mesh, middles: FloatArray, starts: NDArray[np.integer]
) -> tuple[IntArray, FloatArray]:
    """Return the nearest triangle that each start can be joined with, and its distance; infinite if there is none."""
    from scipy.sparse.csgraph import dijkstra  # lazy

    normals = mesh.face_normals
    if (
        np.einsum("ij,ij", mesh.vertices[mesh.faces[:, 0]], normals) < 0
    ):  # six times the volume of a mesh inside out
        normals = -normals
    own, graph, extent = np.einsum("ij,ij->i", middles, normals), mesh.edge_graph(), extent_of(mesh)
    partners, gaps = np.zeros(len(starts), dtype=np.int64), np.full(len(starts), np.inf)
    for number, start in enumerate(starts):  # one at a time: all pairs would take gigabytes
        along = dijkstra(graph, indices=mesh.faces[start, 0])[mesh.faces[:, 0]]
        straight = np.linalg.norm(middles - middles[start], axis=1)
        distant = (along > FARTHEST * extent) & (along > DETOUR * straight)
        # The outer sides must face each other, so that the tube lies outside.
        facing = (middles @ normals[start] > own[start]) & (normals @ middles[start] > own)
        straight[~(distant & facing)] = np.inf
        partners[number] = straight.argmin()
        gaps[number] = straight[partners[number]]
    return partners, gaps


def _tube(
    vertices: FloatArray, first: NDArray[np.integer], second: NDArray[np.integer]
) -> IntArray:
    """Return six triangles between two facing triangles, with the rotation that gives the shortest tube."""
    turns = [np.roll(second[::-1], k) for k in range(3)]
    lengths = [np.linalg.norm(vertices[first] - vertices[turn], axis=1).sum() for turn in turns]
    other = turns[int(np.argmin(lengths))]
    faces = []
    for k in range(3):
        a, b, c, d = first[k], first[(k + 1) % 3], other[k], other[(k + 1) % 3]
        faces += [(a, b, c), (b, d, c)]
    return np.array(faces, dtype=np.int64)


def _rest(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
    """Return the largest piece of the kept triangles."""
    rest = largest_component(compact(mesh.vertices, mesh.faces[kept]))
    if rest.n_vertices < FEWEST_VERTICES:
        problem = f"the change leaves {rest.n_vertices} vertices of the shape"
        raise UnsupportedShape(problem, "choose a smaller strength")
    return rest
