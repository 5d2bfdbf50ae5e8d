"""The scan-like humans: one closed skin each, near to the body that was scanned, and no two alike."""

from __future__ import annotations

from dataclasses import astuple

import igl
import numpy as np
import pytest
import trimesh

from benchmark.datasets import humans, humans_scanlike
from benchmark.datasets.base import Dataset, check_retrievable
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import adults
from benchmark.datasets.humans_scanlike import POSE_NAMES, HumansScanlike
from benchmark.geometry.camera import FRONT
from benchmark.geometry.mesh import Mesh

pytestmark = pytest.mark.kernels


def solid(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


@pytest.fixture(scope="module")
def pair() -> tuple[Mesh, Mesh]:
    data = HumansScanlike()
    first, second = (entry for entry in data.entries if entry.identifier in ("man-3_waving", "woman-5_waving"))
    return data.load(first), data.load(second)


def test_is_a_data_set_of_forty_by_ten() -> None:
    data: Dataset = HumansScanlike()
    assert data.stand_in_for == "shrec14-real"
    assert len(data.entries) == len({entry.identifier for entry in data.entries}) == 400
    assert [entry.subject for entry in data.entries[::10]] == list(adults())
    assert len({data.recipe(entry) for entry in data.entries}) == 400
    assert POSE_NAMES[0] == humans.CANONICAL_POSE
    assert set(POSE_NAMES) < set(POSES)
    assert data.camera(data.entries[0]) == FRONT
    check_retrievable(data)


def test_adults_are_twenty_men_and_twenty_women_inside_the_model() -> None:
    values = np.array([astuple(subject) for subject in adults().values()])
    assert values[:, 0].tolist() == [0.0, 1.0] * 20
    assert values.min() >= 0
    assert values.max() <= 1
    assert values[:, 1].min() >= 0.6
    # A golden row: 0.5 plus the powers of 1 / 1.1347..., the root of x^6 = x + 1.
    golden = 1.1347241384015194
    share = (0.5 + golden ** -np.arange(1.0, 6)) % 1
    np.testing.assert_allclose(
        values[0, 1:], [0.6, 0.2, 0.15, 0.22, 0.15] + share * [0.38, 0.65, 0.75, 0.3, 0.7], atol=1e-3
    )


def test_a_scan_is_one_closed_skin_of_the_body(pair: tuple[Mesh, Mesh]) -> None:
    for mesh in pair:
        assert abs(mesh.n_vertices - 15_000) < 1000
        skin = solid(mesh)
        assert skin.is_watertight
        assert skin.is_winding_consistent
        assert skin.body_count == 1
        assert 0.03 < skin.volume < 0.15
        assert skin.euler_number >= -6  # a few handles where parts touch
        lengths = skin.edges_unique_length
        assert lengths.std() / lengths.mean() < 0.35  # isotropic


def test_a_scan_lies_on_the_body_but_for_cavities_and_fingers(pair: tuple[Mesh, Mesh]) -> None:
    entry = next(entry for entry in HumansScanlike().entries if entry.identifier == "man-3_waving")
    body = humans.human_mesh(adults()["man-3"], humans_scanlike._pose(entry))
    gap = np.sqrt(igl.point_mesh_squared_distance(pair[0].vertices, body.vertices, body.faces)[0])
    assert 0.001 < np.median(gap) < 0.005  # asymmetry, noise and sampling
    assert np.percentile(gap, 99) < 0.015
    assert pair[0].area < 0.98 * body.area
