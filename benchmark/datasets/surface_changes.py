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

#: Least distance between shortcuts.
_SPACING = _LEAST_WAY / 5

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
    """Cut round holes at random positions into a surface, and return its largest piece.

    Parameters
    ----------
    mesh
        The surface.
    amount
        Number of holes, a whole number.
    random
        Random generator of the positions, which are uniform over the area.
    """
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    running = np.cumsum(mesh.face_areas)
    # Draw triangles in proportion to their areas, by inverting the running sum of the areas. The
    # last factor keeps a draw below the whole area, however it is rounded.
    drawn_areas = running[-1] * random.uniform(size=int(amount)) * (1 - 1e-12)
    centres = middles[np.searchsorted(running, drawn_areas)]
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
    """Return the part of a surface that a perspective camera sees from near.

    The surface is rendered to a depth image. Its pixels become vertices in the coordinates of the
    mesh, and neighbouring pixels are joined by triangles, except across steps in depth.

    Parameters
    ----------
    mesh
        The surface.
    camera
        Gives the direction in which the perspective camera looks at the centre of the bounding box.
    amount
        Distance of the camera from the centre, as a multiple of the longest side of the bounding
        box.
    """
    from benchmark.geometry.rasterise import depth_buffer

    extent = extent_of(mesh)
    distance = amount * extent
    centre = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    points = (mesh.vertices - centre) @ camera.rotation.T
    depths = distance - points[:, 2]
    # Focal length in pixels with which the bounding sphere fills its share of the image. The
    # outermost rays are tangents of the sphere, at an angle with the sine radius / distance.
    radius = np.linalg.norm(points, axis=1).max()
    focal_length = _FILL * _PIXELS / 2 * np.sqrt(distance**2 - radius**2) / radius
    xy = _PIXELS / 2 + focal_length * points[:, :2] / depths[:, None]
    # Inverse depths, unlike depths, are linear in the image.
    pixels = np.column_stack([xy, -1 / depths])
    image = -1 / depth_buffer(pixels, mesh.faces, _PIXELS, np.inf)
    is_seen = image > 0

    # The seen pixels, from the image back into the coordinates of the mesh.
    rows, columns = np.nonzero(is_seen)
    depth = image[rows, columns].astype(np.float64)
    x = (columns + 0.5 - _PIXELS / 2) * depth / focal_length
    y = (rows + 0.5 - _PIXELS / 2) * depth / focal_length
    vertices = np.column_stack([x, y, distance - depth]) @ camera.rotation + centre
    faces = _faces_of_image(is_seen)
    steps = np.ptp(depth[faces], axis=1)
    return compact(vertices, faces[steps < _LARGEST_STEP * extent])


def _faces_of_image(is_seen: NDArray[np.bool_]) -> IntArray:
    """Return two triangles for each square of four neighbouring pixels that are all seen.

    Parameters
    ----------
    is_seen
        Which pixels of an image are seen, shape (h, w).

    Returns
    -------
    numpy.ndarray
        Triangles, shape (m, 3); seen pixels are numbered row by row.
    """
    # Pixels that are not seen have the number -1, by which their triangles are left out below.
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
    """Join parts of a surface that nearly touch, such as a hand and a hip, by tubes.

    Scanners and marching cubes fuse such parts. A tube connects two triangles that are near in
    space and far apart along the surface; it replaces them by six triangles, so the surface stays a
    manifold and its genus rises by one. Of random candidates, the nearest pairs are joined.

    Parameters
    ----------
    mesh
        A closed surface.
    amount
        Number of tubes, a whole number.
    random
        Random generator of the candidates.

    Raises
    ------
    UnsupportedShape
        If the surface has fewer pairs of such triangles.
    """
    n_tubes = int(amount)
    starts = random.permutation(mesh.n_faces)[:_CANDIDATES]
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    spacing = _SPACING * extent_of(mesh)
    partners, gaps = _partners(mesh, middles, starts)
    is_used = np.zeros(mesh.n_vertices, dtype=bool)
    is_removed = np.zeros(mesh.n_faces, dtype=bool)
    tubes: list[IntArray] = []
    for candidate in np.argsort(gaps, kind="stable"):
        has_no_partner = not np.isfinite(gaps[candidate])
        if len(tubes) == n_tubes or has_no_partner:
            break
        start = starts[candidate]
        partner = partners[candidate]
        first = mesh.faces[start]
        second = mesh.faces[partner]
        if is_used[first].any() or is_used[second].any():
            continue
        # Further tubes keep a distance: adjacent ones would act as a single shortcut.
        is_used |= np.linalg.norm(mesh.vertices - middles[start], axis=1) < spacing
        is_used[first] = True
        is_used[second] = True
        is_removed[[start, partner]] = True
        tubes.append(_tube(mesh.vertices, first, second))
    if len(tubes) < n_tubes:
        problem = f"the surface comes near itself at {len(tubes)} places, fewer than {n_tubes}"
        raise UnsupportedShape(problem, "choose a smaller strength")
    return Mesh(mesh.vertices, np.concatenate([mesh.faces[~is_removed], *tubes]))


def _partners(
    mesh: Mesh, middles: FloatArray, starts: NDArray[np.integer]
) -> tuple[IntArray, FloatArray]:
    """Find for each of some triangles the nearest triangle to which a tube can lead.

    A tube leads to a triangle that is far along the surface, and faces the first one with its outer
    side.

    Parameters
    ----------
    mesh
        The surface.
    middles
        Centres of all triangles, shape (m, 3).
    starts
        Indices of the triangles to find partners for, shape (k,).

    Returns
    -------
    partners : numpy.ndarray
        Index of the partner of each triangle, shape (k,).
    gaps : numpy.ndarray
        Distance between the centres of both, shape (k,); infinite if there is no partner.
    """
    from scipy.sparse.csgraph import dijkstra  # lazy

    normals = _outer_normals(mesh)
    offsets = np.einsum("ij,ij->i", middles, normals)
    graph = mesh.edge_graph()
    extent = extent_of(mesh)
    partners = np.zeros(len(starts), dtype=np.int64)
    gaps = np.full(len(starts), np.inf)
    for number, start in enumerate(starts):  # one at a time: all pairs would take gigabytes
        ways = dijkstra(graph, indices=mesh.faces[start, 0])[mesh.faces[:, 0]]
        distances = np.linalg.norm(middles - middles[start], axis=1)
        is_far_along = (ways > _LEAST_WAY * extent) & (ways > _LEAST_DETOUR * distances)
        # Each lies on the outer side of the other, so that the tube is outside the body.
        is_before_start = middles @ normals[start] > offsets[start]
        has_start_before = normals @ middles[start] > offsets
        distances[~(is_far_along & is_before_start & has_start_before)] = np.inf
        partners[number] = distances.argmin()
        gaps[number] = distances[partners[number]]
    return partners, gaps


def _outer_normals(mesh: Mesh) -> FloatArray:
    """Return the normals of the triangles, outwards also for a mesh that is inside out."""
    normals = mesh.face_normals
    volume_times_six = np.einsum("ij,ij", mesh.vertices[mesh.faces[:, 0]], normals)
    return -normals if volume_times_six < 0 else normals


def _tube(
    vertices: FloatArray, first: NDArray[np.integer], second: NDArray[np.integer]
) -> IntArray:
    """Return the six triangles of a tube between two triangles that face each other.

    Of the three ways to connect their corners, the one with the shortest sides is taken.

    Parameters
    ----------
    vertices
        Positions, shape (n, 3).
    first, second
        Vertex indices of both triangles, shape (3,).

    Returns
    -------
    numpy.ndarray
        Vertex indices, shape (6, 3).
    """
    # The triangles face each other, so their corners run in opposite directions.
    orders = [np.roll(second[::-1], k) for k in range(3)]
    lengths = [np.linalg.norm(vertices[first] - vertices[order], axis=1).sum() for order in orders]
    opposite = orders[int(np.argmin(lengths))]
    faces = []
    for k in range(3):
        following = (k + 1) % 3
        a = first[k]
        b = first[following]
        c = opposite[k]
        d = opposite[following]
        faces += [(a, b, c), (b, d, c)]
    return np.array(faces, dtype=np.int64)


def _largest_piece(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
    """Return the largest piece of the kept triangles; raise ``UnsupportedShape`` if it is tiny."""
    piece = largest_component(compact(mesh.vertices, mesh.faces[kept]))
    if piece.n_vertices < _FEWEST_VERTICES:
        problem = f"the change leaves {piece.n_vertices} vertices of the shape"
        raise UnsupportedShape(problem, "choose a smaller strength")
    return piece
