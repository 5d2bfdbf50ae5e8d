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
_HOLE_RADIUS = 0.02
#: Fewest vertices of a changed shape.
_FEWEST_VERTICES = 50
#: Re-meshing iterations.
_REMESHING_ROUNDS = 5
#: Least distance along the edges between two triangles that a shortcut joins.
_LEAST_WAY = 0.3

#: The same as a multiple of their Euclidean distance.
_LEAST_DETOUR = 2.0
#: Number of candidate triangles for one end of a shortcut.
_CANDIDATES = 100
#: Pixels per side of the perspective camera.
_PIXELS = 500

#: Share of its image that the bounding sphere fills.
_FILL = 0.95

#: Largest step in depth within a triangle of what it sees.
_LARGEST_STEP = 0.025


def noise(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Add independent Gaussian noise of the given standard deviation to every coordinate."""
    shifts = random.standard_normal((mesh.n_vertices, 3))
    return mesh.with_vertices(mesh.vertices + amount * extent_of(mesh) * shifts)


def holes(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Cut the given number of round holes at random positions; keep the largest piece."""
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    running = np.cumsum(mesh.face_areas)
    # A draw below the whole area, however it is rounded.
    areas = running[-1] * random.uniform(size=int(amount)) * (1 - 1e-12)
    centres = middles[np.searchsorted(running, areas)]
    radius = _HOLE_RADIUS * extent_of(mesh)
    kept = np.ones(mesh.n_faces, dtype=bool)
    for centre in centres:
        kept &= np.linalg.norm(middles - centre, axis=1) >= radius
    return _largest_piece(mesh, kept)


def missing_parts(mesh: Mesh, amount: float, random: Random) -> Mesh:
    """Cut off a fraction of the area that lies outermost in a random direction.

    The largest piece is kept.
    """
    direction = random.standard_normal(3)
    along = mesh.vertices[mesh.faces].mean(axis=1) @ (direction / np.linalg.norm(direction))
    order = np.argsort(along, kind="stable")
    running = np.cumsum(mesh.face_areas[order])
    kept = np.zeros(mesh.n_faces, dtype=bool)
    kept[order[running <= (1 - amount) * running[-1]]] = True
    return _largest_piece(mesh, kept)


def resolution(mesh: Mesh, amount: float, _: Random) -> Mesh:
    """Change the number of vertices: halve all edges until there are enough, then collapse some."""
    from benchmark.geometry.preparation import decimate  # takes half a second, as others here

    while mesh.n_vertices < amount:
        mesh = halved(mesh)
    return decimate(mesh, int(amount))


def remeshing(mesh: Mesh, amount: float, _: Random) -> Mesh:
    """Re-mesh the surface isotropically with the given edge length."""
    from benchmark.geometry.preparation import isotropic_remesh

    length = amount * extent_of(mesh)
    return isotropic_remesh(mesh, length, iterations=_REMESHING_ROUNDS, feature_degrees=30.0)


def turned(camera: Camera, amount: float, random: Random) -> Camera:
    """Turn a camera about the vertical by up to +- the amount, in degrees."""
    return turned_by(camera, np.radians(amount) * random.uniform(-1, 1))


def turned_by(camera: Camera, angle: float) -> Camera:
    """Turn a camera about the vertical by an angle in radians."""
    from scipy.spatial.transform import Rotation

    direction = Rotation.from_rotvec(angle * np.asarray(camera.up)).apply(camera.direction)
    return Camera(tuple(direction.tolist()), camera.up)


def seen_from_near(mesh: Mesh, camera: Camera, amount: float) -> Mesh:
    """Return the surface that a perspective camera sees from a distance of a number of extents.

    The camera looks at the centre of the bounding box in the direction of the orthographic one. Its
    pixels become vertices in the coordinates of the mesh; triangles across steps in depth are left
    out.
    """
    from benchmark.geometry.rasterise import depth_buffer

    extent = extent_of(mesh)
    centre = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    points = (mesh.vertices - centre) @ camera.rotation.T
    depths = amount * extent - points[:, 2]
    radius = np.linalg.norm(points, axis=1).max()
    # The silhouette of a sphere lies at the tangent.
    focal = _FILL * _PIXELS / 2 * np.sqrt((amount * extent) ** 2 - radius**2) / radius
    across = _PIXELS / 2 + focal * points[:, :2] / depths[:, None]
    # Inverse depths, unlike depths, are linear in the image.
    image = -1 / depth_buffer(np.column_stack([across, -1 / depths]), mesh.faces, _PIXELS, np.inf)
    rows, columns = np.nonzero(image > 0)
    depth = image[rows, columns].astype(np.float64)
    x = (columns + 0.5 - _PIXELS / 2) * depth / focal
    y = (rows + 0.5 - _PIXELS / 2) * depth / focal
    seen = np.column_stack([x, y, amount * extent - depth]) @ camera.rotation + centre
    faces = _faces_of_image(image > 0)
    faces = faces[np.ptp(depth[faces], axis=1) < _LARGEST_STEP * extent]
    return compact(seen, faces)


def _faces_of_image(is_seen: NDArray[np.bool_]) -> IntArray:
    """Return two triangles for each square of four seen pixels, which are numbered by rows."""
    numbers = np.full(is_seen.shape, -1)
    numbers[is_seen] = np.arange(is_seen.sum())
    a = numbers[:-1, :-1]
    b = numbers[:-1, 1:]
    c = numbers[1:, 1:]
    d = numbers[1:, :-1]
    first = np.stack([a, b, c], axis=2).reshape(-1, 3)
    second = np.stack([a, c, d], axis=2).reshape(-1, 3)
    faces = np.concatenate([first, second])
    return faces[(faces >= 0).all(axis=1)]


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
    starts = random.permutation(mesh.n_faces)[:_CANDIDATES]
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    extent = extent_of(mesh)
    partners, gaps = _partners(mesh, middles, starts)
    used = np.zeros(mesh.n_vertices, dtype=bool)
    removed = np.zeros(mesh.n_faces, dtype=bool)
    tubes: list[IntArray] = []
    for number in np.argsort(gaps, kind="stable"):
        first = mesh.faces[starts[number]]
        second = mesh.faces[partners[number]]
        if len(tubes) == int(amount) or not np.isfinite(gaps[number]):
            break
        if used[first].any() or used[second].any():
            continue
        # Adjacent tubes would act as a single shortcut.
        distances = np.linalg.norm(mesh.vertices - middles[starts[number]], axis=1)
        used |= distances < _LEAST_WAY / 5 * extent
        used[first] = True
        used[second] = True
        removed[[starts[number], partners[number]]] = True
        tubes.append(_tube(mesh.vertices, first, second))
    if len(tubes) < int(amount):
        problem = f"the surface comes near itself at {len(tubes)} places, fewer than {int(amount)}"
        raise UnsupportedShape(problem, "choose a smaller strength")
    return Mesh(mesh.vertices, np.concatenate([mesh.faces[~removed], *tubes]))


def _partners(
    mesh: Mesh, middles: FloatArray, starts: NDArray[np.integer]
) -> tuple[IntArray, FloatArray]:
    """Return the nearest triangle that each start can be joined with, and its distance.

    The distance is infinite if there is none.

    Parameters
    ----------
    mesh
        The surface.
    middles
        Centres of its triangles.
    starts
        Numbers of some triangles.
    """
    from scipy.sparse.csgraph import dijkstra  # lazy

    normals = _outer_normals(mesh)
    offsets = np.einsum("ij,ij->i", middles, normals)
    graph = mesh.edge_graph()
    extent = extent_of(mesh)
    partners = np.zeros(len(starts), dtype=np.int64)
    gaps = np.full(len(starts), np.inf)
    for number, start in enumerate(starts):  # one at a time: all pairs would take gigabytes
        along = dijkstra(graph, indices=mesh.faces[start, 0])[mesh.faces[:, 0]]
        straight = np.linalg.norm(middles - middles[start], axis=1)
        distant = (along > _LEAST_WAY * extent) & (along > _LEAST_DETOUR * straight)
        # The outer sides must face each other, so that the tube lies outside.
        facing = (middles @ normals[start] > offsets[start]) & (normals @ middles[start] > offsets)
        straight[~(distant & facing)] = np.inf
        partners[number] = straight.argmin()
        gaps[number] = straight[partners[number]]
    return partners, gaps


def _outer_normals(mesh: Mesh) -> FloatArray:
    """Return the normals of the triangles, outwards also for a mesh that is inside out."""
    normals = mesh.face_normals
    volume_times_six = np.einsum("ij,ij", mesh.vertices[mesh.faces[:, 0]], normals)
    return -normals if volume_times_six < 0 else normals


def _tube(
    vertices: FloatArray, first: NDArray[np.integer], second: NDArray[np.integer]
) -> IntArray:
    """Return six triangles between two facing triangles: the shortest tube of three."""
    turns = [np.roll(second[::-1], k) for k in range(3)]
    lengths = [np.linalg.norm(vertices[first] - vertices[turn], axis=1).sum() for turn in turns]
    other = turns[int(np.argmin(lengths))]
    faces = []
    for k in range(3):
        a = first[k]
        b = first[(k + 1) % 3]
        c = other[k]
        d = other[(k + 1) % 3]
        faces += [(a, b, c), (b, d, c)]
    return np.array(faces, dtype=np.int64)


def _largest_piece(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
    """Return the largest piece of the kept triangles; raise ``UnsupportedShape`` if it is tiny."""
    piece = largest_component(compact(mesh.vertices, mesh.faces[kept]))
    if piece.n_vertices < _FEWEST_VERTICES:
        problem = f"the change leaves {piece.n_vertices} vertices of the shape"
        raise UnsupportedShape(problem, "choose a smaller strength")
    return piece
