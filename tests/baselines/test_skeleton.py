from itertools import permutations

import numpy as np
import pytest
from scipy.sparse import eye_array
from scipy.spatial.transform import Rotation

from baselines._kernels.arap import factorise_definite
from baselines._kernels.connectivity_surgery import collapse
from baselines._kernels.curve_skeleton import (
    CurveSkeleton,
    _bones,
    _mean_displacements,
    _merge_junctions,
)
from baselines.skeleton import Skeleton, bones_of_triangles, follow_rotations
from benchmark.api.contracts import Mesh
from benchmark.geometry.mesh import edges_of
from tests.baselines.deformable import (
    capsule,
    centre_line,
    implicit_surface,
    shape_of,
    sheet,
    straightness,
    tube,
)
from tests.baselines.embedding import limbed

TIPS = np.array([[-1.1, 0.0, 0.0], [0.9, 0.8, 0.0], [0.8, -0.9, 0.3]])


def test_it_agrees_with_the_simplices_of_sumner_and_popovic():
    """Dense least squares over vertices and one extra vertex per triangle (Yan et al. 2008)."""
    mesh = tube(1.0, rings=5, sides=5)
    rotations = Rotation.random(mesh.n_faces, rng=3).as_matrix()
    n, m = mesh.n_vertices, mesh.n_faces
    rows, right = [], []
    for f, (i, j, k) in enumerate(mesh.faces):
        a, b, c = mesh.vertices[[i, j, k]]
        normal = np.cross(b - a, c - a)
        fourth = (a + b + c) / 3 + normal / np.sqrt(np.linalg.norm(normal))
        inverse = np.linalg.inv(np.stack([b - a, c - a, fourth - a], axis=1))
        weight = np.sqrt(mesh.face_areas[f])
        for column in range(3):
            row = np.zeros(n + m)
            for vertex, coefficient in zip((j, k, n + f), inverse[:, column], strict=True):
                row[vertex] += coefficient
                row[i] -= coefficient
            rows.append(weight * row)
            right.append(weight * rotations[f][:, column])
    solution = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0][:n]
    moved = follow_rotations(mesh, shape_of(mesh).laplacian(), rotations)
    np.testing.assert_allclose(
        moved - moved.mean(axis=0), solution - solution.mean(axis=0), atol=1e-9
    )


def neighbours_of(pairs, count):
    found = [set() for _ in range(count)]
    for a, b in pairs:
        found[a].add(int(b))
        found[b].add(int(a))
    return found


def test_surgery_is_that_of_the_released_code_with_summed_quadrics():
    """Collapses one by one, by the cost of AuConnectivitySurgeryMex.cpp, over all half-edges that
    border a triangle.
    """
    mesh = limbed(40).mesh
    points, faces = mesh.vertices, {tuple(map(int, face)) for face in mesh.faces}
    around, quadrics = (
        neighbours_of(edges_of(mesh.faces).ends, len(points)),
        np.zeros((len(points), 4, 4)),
    )
    for i, j in np.concatenate([edges_of(mesh.faces).ends, edges_of(mesh.faces).ends[:, ::-1]]):
        x, y, z = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
        rows = np.column_stack(
            [[[0, -z, y], [z, 0, -x], [-y, x, 0]], -np.cross([x, y, z], points[i])]
        )
        quadrics[i] += rows.T @ rows
    owner = np.arange(len(points))

    def cost(i, j):
        length, place = np.linalg.norm(points[i] - points[j]), np.append(points[j], 1.0)
        others = sum(np.linalg.norm(points[i] - points[k]) for k in around[i]) - length
        return place @ (quadrics[i] + quadrics[j]) @ place + length * others

    while faces:
        i, j = min(
            ((i, j) for face in faces for i, j in permutations(face, 2)),
            key=lambda pair: cost(*pair),
        )
        quadrics[j] += quadrics[i]
        owner[owner == i] = j
        faces = {tuple(j if k == i else k for k in face) for face in faces if not {i, j} <= {*face}}
        for k in around[i]:
            around[k].discard(i)
        for k in around[i] - {j}:
            around[k].add(j)
            around[j].add(k)
        around[i] = set()
    np.testing.assert_array_equal(collapse(mesh), owner)


def test_joints_are_centred_and_merged_as_in_the_released_code():
    """AuEmbeddingRefinementMex.cpp for displacements, and AuMergeJunctionsMex.cpp, loop by loop."""
    mesh = implicit_surface(
        lambda p: np.min([capsule(p, [0, 0, 0], tip, 0.2) for tip in TIPS], axis=0)
    )
    k = 11
    points, around = mesh.vertices, neighbours_of(edges_of(mesh.faces).ends, mesh.n_vertices)
    steps = np.array([[0.0, 0.1, 0.35, 0.9], [0.2, 0.5, 0.8, 1.1], [0.3, 0.6, 1.0, 1.05]])
    joints = 0.4 * (steps[:, :, None] * TIPS[:, None]).reshape(-1, 3)[:k]
    owners = np.linalg.norm(points[:, None] - joints, axis=2).argmin(axis=1)
    bones = neighbours_of(_bones(mesh, owners), k)
    assert {len(ends) for ends in bones} >= {1, 2, 3}
    displacements, centred = np.sin(5 * points[:, ::-1]), np.zeros((k, 3))
    for i in range(k):
        for j in bones[i]:
            loop = [
                v for v in np.flatnonzero(owners == i) if any(owners[u] == j for u in around[v])
            ]
            weights = [
                sum(np.linalg.norm(points[v] - points[u]) for u in around[v] if u in loop)
                for v in loop
            ]
            centred[i] += weights @ displacements[loop] / sum(weights) / len(bones[i])
        if len(bones[i]) == 1:
            centred[i] = displacements[owners == i].mean(axis=0)
    np.testing.assert_allclose(
        _mean_displacements(mesh, displacements, owners), centred, atol=1e-12
    )

    def spread(joint, *parts):
        return np.linalg.norm(points[np.isin(owners, parts)] - joints[joint], axis=1).std()

    expected, pending = owners.copy(), [i for i in range(k) if len(bones[i]) > 2]
    kept, merged = _merge_junctions(mesh, joints, owners)
    while pending:
        i = pending.pop(0)
        best = min(bones[i], key=lambda j: spread(j, i, j), default=i)
        if spread(best, i, best) < 0.9 * spread(i, i) and best != i:
            owners = np.where(owners == i, best, owners)
            bones = neighbours_of(_bones(mesh, owners), k)
            pending = [best, *(j for j in pending if j != best)]
            pending = pending or [j for j in range(k) if len(bones[j]) > 2]
    assert (owners != expected).any()
    np.testing.assert_array_equal(joints[np.unique(owners)], kept)
    np.testing.assert_array_equal(np.unique(owners, return_inverse=True)[1], merged)


def test_the_bone_of_a_triangle_does_not_depend_on_the_numbers_of_the_joints():
    mesh = sheet(rows=12, columns=12)
    joints = mesh.vertices.mean(axis=0) + np.array(
        [[0.3, 0.0, 0.1], [-0.2, 0.3, 0.0], [-0.1, -0.3, 0.0]]
    )
    owners = np.linalg.norm(mesh.vertices[:, None] - joints, axis=2).argmin(axis=1)
    assert (
        (np.diff(np.sort(owners[mesh.faces], axis=1), axis=1) > 0).all(axis=1).any()
    )  # three parts meet in one
    found = []
    for order in permutations(range(3)):
        number = np.argsort(order)  # the new number of each joint
        skeleton = CurveSkeleton(
            joints[list(order)], number[owners], np.array([[0, 1], [0, 2], [1, 2]])
        )
        found.append(
            np.sort(np.array(order)[skeleton.bones[bones_of_triangles(mesh, skeleton)]], axis=1)
        )
    np.testing.assert_array_equal(found, np.broadcast_to(found[0], np.shape(found)))


def test_a_pinhole_does_not_make_a_surface_open():
    mesh = tube(1.0)
    form = Skeleton().canonicalise(
        shape_of(Mesh(mesh.vertices, np.delete(mesh.faces, 300, axis=0)))
    )
    assert form.notes["skeleton"] == "contraction"


@pytest.mark.parametrize(
    "step",
    [
        lambda mesh, *_: mesh.vertices * np.nan,
        lambda mesh, *_: 0.5 * mesh.vertices + 2000,  # smaller, but far from where it was
        lambda mesh, *_: factorise_definite(-eye_array(mesh.n_vertices).tocsr())(mesh.vertices),
    ],
)
def test_a_failed_contraction_falls_back_and_says_so(step, monkeypatch):
    monkeypatch.setattr("baselines._kernels.curve_skeleton._contraction_step", step)
    form = Skeleton().canonicalise(shape_of(tube(2.4)))
    assert form.notes["skeleton"] == "level-set"
    assert str(form.notes["skeleton_reason"]).startswith("contraction failed: 100%")
    assert straightness(centre_line(form.vertices)) > 0.93
