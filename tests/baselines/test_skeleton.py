from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from baselines._kernels import curve_skeleton
from baselines._kernels.curve_skeleton import CurveSkeleton, contraction_skeleton
from baselines.skeleton import Skeleton, bones_of_triangles, follow_rotations
from benchmark.api.contracts import Mesh
from tests.baselines.deformable import capsule, centre_line, implicit_surface, shape_of, sheet, straightness, tube

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
    np.testing.assert_allclose(moved - moved.mean(axis=0), solution - solution.mean(axis=0), atol=1e-9)


def test_of_a_y_has_three_branches():
    """Three arms of different length that meet at the origin."""
    y_shape = implicit_surface(lambda p: np.min([capsule(p, [0, 0, 0], tip, 0.2) for tip in TIPS], axis=0))
    skeleton = contraction_skeleton(y_shape)
    assert sorted(skeleton.degrees[skeleton.degrees != 2].tolist()) == [1, 1, 1, 3]
    # The prepared mesh has area 1.
    factor = np.linalg.norm(y_shape.vertices, axis=1).max() / (np.linalg.norm(TIPS, axis=1).max() + 0.2)
    leaves = skeleton.joints[skeleton.degrees == 1]
    assert np.linalg.norm(leaves[:, None] - TIPS * factor, axis=2).min(axis=0).max() < 0.35 * factor
    junction = skeleton.joints[skeleton.degrees == 3][0]
    assert np.linalg.norm(junction) < 0.2 * factor


def test_the_bone_of_a_triangle_does_not_depend_on_the_numbers_of_the_joints():
    mesh = sheet(rows=12, columns=12)
    joints = mesh.vertices.mean(axis=0) + np.array([[0.3, 0.0, 0.1], [-0.2, 0.3, 0.0], [-0.1, -0.3, 0.0]])
    owners = np.linalg.norm(mesh.vertices[:, None] - joints, axis=2).argmin(axis=1)
    assert (np.diff(np.sort(owners[mesh.faces], axis=1), axis=1) > 0).all(axis=1).any()  # three parts meet in one
    found = []
    for order in permutations(range(3)):
        number = np.argsort(order)  # the new number of each joint
        skeleton = CurveSkeleton(joints[list(order)], number[owners], np.array([[0, 1], [0, 2], [1, 2]]))
        found.append(np.sort(np.array(order)[skeleton.bones[bones_of_triangles(mesh, skeleton)]], axis=1))
    np.testing.assert_array_equal(found, np.broadcast_to(found[0], np.shape(found)))


def test_an_open_surface_gets_a_level_set_skeleton():
    form = Skeleton().canonicalise(shape_of(sheet(bend=2.0)))
    assert form.notes["skeleton"] == "level-set"
    assert form.notes["skeleton_reason"] == "open surface"
    assert form.notes["bones"] == form.notes["joints"] - 1


def test_a_pinhole_does_not_make_a_surface_open():
    mesh = tube(1.0)
    form = Skeleton().canonicalise(shape_of(Mesh(mesh.vertices, np.delete(mesh.faces, 300, axis=0))))
    assert form.notes["skeleton"] == "contraction"


def test_a_failed_contraction_falls_back_and_says_so(monkeypatch):
    monkeypatch.setattr(curve_skeleton, "_contraction_step", lambda mesh, *_: mesh.vertices * np.nan)
    form = Skeleton().canonicalise(shape_of(tube(2.4)))
    assert form.notes["skeleton"] == "level-set"
    assert str(form.notes["skeleton_reason"]).startswith("contraction failed: 100%")
    assert straightness(centre_line(form.vertices)) > 0.93
