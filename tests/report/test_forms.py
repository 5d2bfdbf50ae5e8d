"""Forms as they are drawn, turned to each other, and how far they are apart then."""

from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from scipy.stats import special_ortho_group

from benchmark.datasets.folder import folder_set
from benchmark.geometry.camera import FRONT
from benchmark.report import forms
from benchmark.report.forms import Drawn, StoredForms, alignments, centred, turned_to
from tests.report.records import record
from tests.toy import rod, write_rods


def body(bend=1.2):
    """A rod that is bent and twisted, so that it is not its mirror image."""
    mesh = rod(0.1, bend)
    return centred(
        mesh.with_vertices(mesh.vertices + np.outer(mesh.vertices[:, 0] ** 3, [0, 1, 0]))
    )


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seed", range(3))
def test_rotated_and_mirrored_copies_come_out_equal_and_the_mirrored_one_is_marked(sign, seed):
    mesh, turn = body(), sign * special_ortho_group(3, seed).rvs()
    copy = mesh.with_vertices(mesh.vertices @ turn)
    form = turned_to(Drawn(copy), Drawn(mesh))
    assert form.is_mirrored == (sign < 0)
    assert form.mesh.vertices == pytest.approx(mesh.vertices, abs=1e-9)


def test_a_form_that_hardly_differs_from_its_turned_self_is_turned_little():
    mesh = rod(0.2, 0.0)
    mesh = centred(
        mesh.with_vertices(mesh.vertices * [1, 0.5, 1])
    )  # half a turn about its axis hardly changes it
    other = mesh.with_vertices(
        mesh.vertices * [1, 1, -1]
        + np.random.default_rng(0).normal(scale=0.02, size=mesh.vertices.shape)
    )
    form = turned_to(Drawn(mesh), Drawn(other))
    assert form.mesh.vertices == pytest.approx(mesh.vertices, abs=0.1)


def test_distances_admit_rotations_but_no_mirror_image():
    points, turn = body().vertices, special_ortho_group(3, 0).rvs()
    distances, found = alignments(points @ turn, points)
    assert distances.min() < 1e-9
    assert found[distances.argmin()] == pytest.approx(turn.T)
    known = np.column_stack(
        [points, 9 * np.arange(len(points))]
    )  # each point has one that is nearest
    distances, found = alignments(known * [-1, -1, -1, 1], known)
    assert distances.min() > 0.02
    assert np.linalg.det(found) == pytest.approx(1)


def test_forms_say_how_far_they_are_from_that_of_the_first_pose_in_any_turn_and_mirrored():
    mesh, turn = body(), special_ortho_group(3, 0).rvs()
    same, other, near = (
        Drawn(each.with_vertices(sign * each.vertices @ turn))
        for each, sign in ((mesh, -1), (body(0.1), 1), (body(1.1), 1))
    )
    assert turned_to(same, Drawn(mesh)).apart < 1e-9
    assert 0.01 < turned_to(near, Drawn(mesh)).apart < 0.5 * turned_to(other, Drawn(mesh)).apart


def test_forms_of_a_subject_are_turned_to_that_of_its_first_pose(results):
    record = next(record for record in results.records if record.method == "identity")
    stored = StoredForms(results.folder)
    first, second = (stored.form(record, name).mesh.vertices for name in ("thin0", "thin1"))
    assert first == pytest.approx(stored.shape(record, "thin0").mesh.vertices)
    posed = stored.shape(record, "thin1").mesh.vertices
    assert np.linalg.norm(second, axis=1) == pytest.approx(np.linalg.norm(posed, axis=1))
    before, after = (cKDTree(first).query(points)[0].mean() for points in (posed, second))
    assert after < 0.5 * before


def test_only_near_results_that_differ_are_refined():
    angles = np.array([0.0, 0.01, 1.0, 1.5, 2.0, 2.5])
    rotations = Rotation.from_euler("z", angles[:, None]).as_matrix()
    near = np.array([0.11, 0.1, 0.12, 0.13, 0.14, 0.145])
    assert forms._promising(near, rotations) == [1, 2, 3]  # four at most, of which two are alike
    far = np.array([0.11, 0.1, 0.12, 0.16, 0.17, 0.18])
    assert forms._promising(far, rotations) == [1, 2]


def test_only_mirror_images_that_come_nearer_than_all_rotations_are_refined():
    rotations = Rotation.from_euler("z", [[0.0], [1.0], [2.0], [3.0]]).as_matrix()
    rotations[2:] *= -1
    assert forms._promising(np.array([0.11, 0.1, 0.09, 0.101]), rotations) == [1, 0, 2]
    assert forms._promising(np.array([0.11, 0.1, 0.12, 0.101]), rotations) == [1, 0]


def test_matches_are_the_nearest_points_of_both_surfaces_after_the_rotation():
    random = np.random.default_rng(0)
    points = random.standard_normal((60, 4))
    target = random.standard_normal((50, 4))
    rotations = special_ortho_group(3, 0).rvs(2) * np.array([1, -1])[:, None, None]
    in_target, in_points = forms._matches(points, target, rotations)
    for number, rotation in enumerate(rotations):
        turned = np.column_stack([points[:, :3] @ rotation, points[:, 3]])
        assert in_target[number].tolist() == cKDTree(target).query(turned)[1].tolist()
        assert in_points[number].tolist() == cKDTree(turned).query(target)[1].tolist()


def test_mirror_images_are_found_where_they_are_allowed_and_stay_such():
    points = body().vertices
    mirrored = points * [1, 1, -1]
    distances, found = alignments(mirrored, points, with_mirror_images=True)
    nearest = found[distances.argmin()]
    assert distances.min() < 1e-9
    assert np.linalg.det(nearest) == pytest.approx(-1)
    assert mirrored @ nearest == pytest.approx(points)


def test_an_iteration_that_changes_nothing_is_the_last():
    points = np.random.default_rng(0).standard_normal((50, 3)) * [3.0, 2.0, 1.0]
    starts = Rotation.from_euler("xyz", [[0.0, 0.0, 0.0], [0.1, 0.0, 0.2]]).as_matrix()
    few = forms._iterate_closest_points(points, points, starts, 12)
    with patch.object(forms, "_best_rotations", wraps=forms._best_rotations) as counted:
        many = forms._iterate_closest_points(points, points, starts, 100)
    assert counted.call_count < 12
    assert np.array_equal(few, many)
    assert many == pytest.approx(np.broadcast_to(np.eye(3), (2, 3, 3)), abs=1e-12)


def test_the_camera_of_a_shape_is_that_of_its_own_folder(tmp_path, monkeypatch):
    """Where the report is written, another folder may have its name."""
    write_rods(tmp_path / "here" / "rods", bends=(0.0,))
    folder = write_rods(tmp_path / "there" / "rods", bends=(0.0,))
    (folder / "dataset.toml").write_text('camera = "back"')
    monkeypatch.chdir(tmp_path / "here")
    data = {"name": "rods", "title": "rods", "source": "rods", "path": str(folder)}
    camera = StoredForms(tmp_path)._camera(record(data=data), "thin0")
    assert camera == folder_set(folder).camera(folder_set(folder).shapes[0]) != FRONT
