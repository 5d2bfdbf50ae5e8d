"""Each fault of a scan does what it says, on shapes whose answer is known; a scan tells where its vertices belong."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.datasets.scans import sampler
from benchmark.datasets.scans.sampler import ScanSampler, scan
from benchmark.datasets.varied.wide import WideSampler
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh
from benchmark.protocols.pairs import synthetic
from benchmark.protocols.pairs.synthetic import varied_data
from benchmark.protocols.trainings import TRAININGS
from tests.geometry.surfaces import limbed_body


def random() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def body() -> Mesh:
    return limbed_body(4)


def test_a_scan_tells_where_its_vertices_belong(body: Mesh) -> None:
    height = float(np.ptp(body.vertices[:, 2]))
    for seed in range(6):
        made = scan(body, height, np.random.default_rng(seed))
        again = scan(body, height, np.random.default_rng(seed))
        assert made.mesh.vertices.tobytes() == again.mesh.vertices.tobytes()
        assert made.mesh.n_vertices <= sampler.SMALL
        assert made.weights.sum(axis=1) == pytest.approx(1)
        places = np.einsum("nc,nck->nk", made.weights, body.vertices[made.corners])
        distances = np.linalg.norm(places - made.mesh.vertices, axis=1)
        assert np.quantile(distances, 0.9) < 0.02 * height
        normals = vertex_normals(body)[made.corners].sum(axis=1)
        agree = np.einsum("nk,nk->n", normals, vertex_normals(made.mesh)) > 0
        assert agree.mean() > 0.9


# None of it is what methods are tested on -------------------------------------------------------------------------


def test_the_stream_of_scans_is_that_of_this_sampler_and_known_by_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    training = TRAININGS["humans-varied"]
    data = varied_data(training, iter)
    assert data.scanned.scans == ScanSampler(seed=0)
    assert data.scanned.validation == ScanSampler(seed=1)
    assert len({data.digest, data.wide.digest, data.scanned.digest}) == 3
    monkeypatch.setattr(synthetic, "versions_of", lambda _: {"sampler/scans": "other"})
    assert varied_data(training, iter).scanned.digest != data.scanned.digest


@pytest.mark.exhaustive
def test_no_subject_of_a_set_and_no_body_of_another_stream_is_scanned(monkeypatch: pytest.MonkeyPatch) -> None:
    from benchmark.datasets.human_subjects import CLEARANCE, clearance
    from benchmark.datasets.varied import sampler as bodies
    from benchmark.datasets.varied.bodies import AWAY_FROM, varied_body

    drawn = []

    def noted(source: np.random.Generator):
        drawn.append(varied_body(source))
        return drawn[-1]

    monkeypatch.setattr(bodies, "varied_body", noted)
    made = ScanSampler(seed=0)(5, 4)
    assert min(clearance(each.subject, AWAY_FROM) for each in drawn) >= CLEARANCE
    ours = set(drawn)
    drawn.clear()
    WideSampler(seed=0)(5, 4, 32)
    ScanSampler(seed=1)(5, 4)
    assert not ours & set(drawn)
    again = ScanSampler(seed=0)(5, 4)
    assert [each.mesh.vertices.tobytes() for of in made.scans for each in of] == [
        each.mesh.vertices.tobytes() for of in again.scans for each in of
    ]
    for of_body in made.scans:
        for each in of_body:
            assert 600 < each.mesh.n_vertices <= sampler.SMALL
