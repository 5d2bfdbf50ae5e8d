"""Forms as they are drawn, turned to each other, and how far they are apart."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import special_ortho_group

from benchmark.report import forms
from benchmark.report.figures import spread_rows
from benchmark.report.formats import hundredths
from benchmark.report.forms import Drawn, StoredForms, alignments, centred, spread_of_forms, turned
from benchmark.report.output import write_files
from benchmark.report.pages import report_files
from benchmark.report.tables import table_views
from tests.toy import rod


def body(bend=1.2):
    """A rod that is bent and twisted, so that it is not its mirror image."""
    mesh = rod(0.1, bend)
    return centred(mesh.with_vertices(mesh.vertices + np.outer(mesh.vertices[:, 0] ** 3, [0, 1, 0])))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seed", range(3))
def test_rotated_and_mirrored_copies_come_out_equal_and_the_mirrored_one_is_marked(sign, seed):
    mesh, turn = body(), sign * special_ortho_group(3, seed).rvs()
    copy = mesh.with_vertices(mesh.vertices @ turn)
    form = turned(Drawn(copy), Drawn(mesh))
    assert form.is_mirrored == (sign < 0)
    assert form.mesh.vertices == pytest.approx(mesh.vertices, abs=1e-9)


def test_a_form_that_hardly_differs_from_its_turned_self_is_turned_little():
    mesh = rod(0.2, 0.0)
    mesh = centred(mesh.with_vertices(mesh.vertices * [1, 0.5, 1]))  # half a turn about its axis hardly changes it
    other = mesh.with_vertices(
        mesh.vertices * [1, 1, -1] + np.random.default_rng(0).normal(scale=0.02, size=mesh.vertices.shape)
    )
    form = turned(Drawn(mesh), Drawn(other))
    assert form.mesh.vertices == pytest.approx(mesh.vertices, abs=0.1)


def test_distances_admit_rotations_but_no_mirror_image():
    points, turn = body().vertices, special_ortho_group(3, 0).rvs()
    distances, found = alignments(points @ turn, points)
    assert distances.min() < 1e-9
    assert found[distances.argmin()] == pytest.approx(turn.T)
    known = np.column_stack([points, 9 * np.arange(len(points))])  # each point has one that is nearest
    distances, found = alignments(known * [-1, -1, -1, 1], known)
    assert distances.min() > 0.02
    assert np.linalg.det(found) == pytest.approx(1)


def test_a_spread_is_the_floor_for_copies_and_a_mirror_image_counts_only_in_the_first_ratio(monkeypatch):
    monkeypatch.setattr(forms, "SAMPLES", 400)
    near, far = body(), body(0.1)
    turns = [special_ortho_group(3, seed).rvs() for seed in range(4)]
    copies = [
        mesh.with_vertices(3 * mesh.vertices @ turn + 1)
        for mesh, turn in zip((near, near, far, far), turns, strict=True)
    ]
    spread, mirrored, floor = forms._spread(dict(enumerate(copies)), "aabb", iter)
    assert spread == pytest.approx(mirrored, rel=0.1)
    assert spread == pytest.approx(floor, rel=0.1)
    copies[1] = copies[1].with_vertices(-copies[1].vertices)
    copies[3] = copies[3].with_vertices(-copies[3].vertices)
    other, mirrored, floor = forms._spread(dict(enumerate(copies)), "aabb", iter)
    assert mirrored == pytest.approx(floor, rel=0.1)
    assert other > 1.3 * floor


def test_forms_that_are_all_one_point_have_no_spread(monkeypatch):
    monkeypatch.setattr(forms, "SAMPLES", 20)
    points = {number: body().with_vertices(np.zeros_like(body().vertices)) for number in range(3)}
    assert np.isnan(forms._spread(points, "aab", iter)).all()


def test_a_spread_is_computed_on_demand_kept_and_shown(results, monkeypatch, tmp_path):
    record = next(record for record in results.records if record.method == "gps")
    assert spread_of_forms(results.folder, record) is None
    monkeypatch.setattr(forms, "SAMPLES", 100)
    found = spread_of_forms(results.folder, record, iter)
    monkeypatch.setattr(forms, "_spread", lambda *_: np.array([0.125, 0.25, 0.5]))
    assert spread_of_forms(results.folder, record, iter).tolist() == found.tolist()
    assert spread_of_forms(results.folder, next(r for r in results.records if r.method == "surface-area"), iter) is None
    view = table_views(results.records)[0]
    (_, row) = spread_rows(view, StoredForms(results.folder))
    assert row == ("GPS", *map(hundredths, found), "0")
    write_files(tmp_path, report_files(results.folder, [view], watch=iter))
    shown = (tmp_path / f"{view.stem}-forms.html").read_text()
    assert all(f">{cell}</td>" in shown for cell in (*row, ".13", ".25", ".50"))  # identity is computed now


def test_forms_of_a_subject_are_turned_to_that_of_its_first_pose(results):
    record = next(record for record in results.records if record.method == "identity")
    stored = StoredForms(results.folder)
    first, second = (stored.form(record, name).mesh.vertices for name in ("thin0", "thin1"))
    assert first == pytest.approx(stored.shape(record, "thin0").mesh.vertices)
    posed = stored.shape(record, "thin1").mesh.vertices
    assert np.linalg.norm(second, axis=1) == pytest.approx(np.linalg.norm(posed, axis=1))
    before, after = (cKDTree(first).query(points)[0].mean() for points in (posed, second))
    assert after < 0.5 * before
