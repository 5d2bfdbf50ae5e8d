import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from baselines._kernels import contraction as contraction_module
from baselines._kernels.connectivity_surgery import collapse
from baselines._kernels.contraction import contract
from baselines._kernels.curve_skeleton import CurveSkeleton, contraction_skeleton, level_set_skeleton
from baselines._kernels.deformation_transfer import follow_rotations
from baselines.skeleton import (
    Skeleton,
    bones_of_triangles,
    geodesics_from_extremity,
)
from benchmark.api.contracts import Mesh
from benchmark.geometry.edges import edges_of
from tests.baselines.deformable import (
    capsule,
    centre_line,
    check_real_body,
    implicit_surface,
    shape_of,
    sheet,
    straightness,
    tube,
)

TIPS = np.array([[-1.1, 0.0, 0.0], [0.9, 0.8, 0.0], [0.8, -0.9, 0.3]])


@pytest.fixture(scope="module")
def y_shape() -> Mesh:
    """Three arms of different length that meet at the origin."""
    return implicit_surface(lambda p: np.min([capsule(p, [0, 0, 0], tip, 0.2) for tip in TIPS], axis=0))


class TestTransfer:
    def test_it_agrees_with_the_simplices_of_sumner_and_popovic(self):
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
        moved = follow_rotations(mesh, rotations)
        np.testing.assert_allclose(moved - moved.mean(axis=0), solution - solution.mean(axis=0), atol=1e-9)


class TestBones:
    def test_triangles_are_split_by_the_planes_of_bisection(self):
        """Three joints on a strip: the middle part divides between its two bones at the middle joint."""
        mesh = sheet(rows=31, columns=5)
        x = mesh.vertices[:, 0]
        owners = np.digitize(x, [x.max() / 3, 2 * x.max() / 3])
        joints = np.array([mesh.vertices[owners == j].mean(axis=0) for j in range(3)])
        skeleton = CurveSkeleton(joints, owners, np.array([[0, 1], [1, 2]]))
        centroids = mesh.vertices[mesh.faces].mean(axis=1)
        np.testing.assert_array_equal(bones_of_triangles(mesh, skeleton), centroids[:, 0] > joints[1, 0])


class TestContraction:
    def test_it_leaves_a_hundredth_of_the_area_inside_the_surface(self, y_shape):
        contracted = y_shape.with_vertices(contract(y_shape))
        assert contracted.area <= contraction_module.AREA_RATIO * y_shape.area
        depth = np.min([capsule(contracted.vertices, [0, 0, 0], tip, 0.2) for tip in scaled_tips(y_shape)[0]], axis=0)
        assert (depth < 0).mean() > 0.98

    @pytest.mark.kernels
    def test_surgery_leaves_no_triangle_and_connected_parts(self, y_shape):
        owners = collapse(y_shape.with_vertices(contract(y_shape)))
        np.testing.assert_array_equal(owners[owners], owners)
        assert max(len(set(face)) for face in owners[y_shape.faces].tolist()) == 2
        start, end = edges_of(y_shape.faces).ends.T
        inner = owners[start] == owners[end]
        graph = coo_array((np.ones(inner.sum()), (start[inner], end[inner])), shape=(y_shape.n_vertices,) * 2)
        assert connected_components(graph, directed=False, return_labels=False) == len(np.unique(owners))


def scaled_tips(mesh):
    """Tips of the Y in the coordinates of the prepared mesh, whose area is 1, and the factor between both."""
    reach = np.linalg.norm(TIPS, axis=1).max() + 0.2
    factor = np.linalg.norm(mesh.vertices, axis=1).max() / reach
    return TIPS * factor, factor


class TestCurveSkeleton:
    def test_of_a_straight_tube_is_its_axis(self):
        mesh = tube(0.0)
        skeleton = contraction_skeleton(mesh, contract(mesh))
        assert (skeleton.degrees == 1).sum() == 2
        assert skeleton.degrees.max() == 2
        assert np.abs(skeleton.joints[:, 1:]).max() < 0.02
        assert skeleton.joints[:, 0].min() < 0.15
        assert skeleton.joints[:, 0].max() > 1.85
        inner = skeleton.joints[skeleton.degrees == 2]
        assert np.abs(inner[:, 1:]).max() < 0.01

    def test_of_a_bent_tube_follows_the_arc(self):
        mesh = tube(2.4)
        skeleton = contraction_skeleton(mesh, contract(mesh))
        radius = 2 / 2.4
        distance = np.hypot(skeleton.joints[:, 0], skeleton.joints[:, 2] - radius)
        assert np.abs(distance - radius)[skeleton.degrees > 1].max() < 0.05
        assert np.abs(skeleton.joints[:, 1]).max() < 0.04

    def test_of_a_y_has_three_branches(self, y_shape):
        skeleton = contraction_skeleton(y_shape, contract(y_shape))
        assert sorted(skeleton.degrees[skeleton.degrees != 2].tolist()) == [1, 1, 1, 3]
        tips, factor = scaled_tips(y_shape)
        leaves = skeleton.joints[skeleton.degrees == 1]
        assert np.linalg.norm(leaves[:, None] - tips, axis=2).min(axis=0).max() < 0.35 * factor
        junction = skeleton.joints[skeleton.degrees == 3][0]
        assert np.linalg.norm(junction) < 0.15 * factor

    def test_level_sets_of_a_y_have_three_branches(self, y_shape):
        skeleton = level_set_skeleton(y_shape, geodesics_from_extremity(shape_of(y_shape)), 24)
        assert sorted(skeleton.degrees[skeleton.degrees != 2].tolist()) == [1, 1, 1, 3]

    def test_a_pocket_is_no_limb(self):
        def pocketed(points):
            body = capsule(points, [-0.7, 0, 0], [0.7, 0, 0], 0.45)
            return np.maximum(body, -capsule(points, [0.35, 0, 0], [1.4, 0, 0], 0.2))

        mesh = implicit_surface(pocketed)
        skeleton = contraction_skeleton(mesh, contract(mesh))
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        part = np.sort(skeleton.owners[mesh.faces], axis=1)[:, 1]
        outward = np.einsum("fi,fi->f", np.cross(b - a, c - a), (a + b + c) / 3 - skeleton.joints[part])
        flux = np.bincount(part, weights=outward)
        assert (flux[skeleton.degrees == 1] > 0).all()


class TestForm:
    def test_a_bent_tube_becomes_straight(self, bend=2.4):
        mesh = tube(bend)
        form = Skeleton().canonicalise(shape_of(mesh))
        assert form.notes["skeleton"] == "contraction"
        assert straightness(centre_line(form.vertices)) > 0.95 > straightness(centre_line(mesh.vertices))

    def test_an_open_surface_gets_a_level_set_skeleton(self):
        form = Skeleton().canonicalise(shape_of(sheet(bend=2.0)))
        assert form.notes["skeleton"] == "level-set"
        assert form.notes["skeleton_reason"] == "open surface"
        assert form.notes["leaves"] == 2

    def test_a_pinhole_does_not_make_a_surface_open(self):
        mesh = tube(1.0)
        form = Skeleton().canonicalise(shape_of(Mesh(mesh.vertices, np.delete(mesh.faces, 300, axis=0))))
        assert form.notes["skeleton"] == "contraction"

    def test_a_failed_contraction_falls_back_and_says_so(self, monkeypatch):
        monkeypatch.setattr(contraction_module, "_contraction_step", lambda mesh, *_: mesh.vertices * np.nan)
        form = Skeleton().canonicalise(shape_of(tube(2.4)))
        assert form.notes["skeleton"] == "level-set"
        assert str(form.notes["skeleton_reason"]).startswith("contraction failed: 100%")
        assert straightness(centre_line(form.vertices)) > 0.93

    def test_the_numbering_of_the_vertices_changes_no_bit(self, y_shape):
        order = np.random.default_rng(0).permutation(y_shape.n_vertices)
        renumbered = Mesh(y_shape.vertices[order], np.argsort(order)[y_shape.faces][::-1])
        first = Skeleton().canonicalise(shape_of(y_shape)).vertices
        np.testing.assert_array_equal(Skeleton().canonicalise(shape_of(renumbered)).vertices, first[order])


@pytest.mark.data
@pytest.mark.parametrize(("name", "branches"), [("cat8", 6), ("michael6", 5)])
def test_real_bodies_have_their_limbs(data_root, name, branches):
    form = check_real_body(Skeleton(), data_root / "tosca" / f"{name}.off")
    assert form.notes["skeleton"] == "contraction"
    assert branches <= form.notes["leaves"] <= 20
    assert form.notes["mean_edge_strain"] < 0.15
