"""What methods and scorers share reaches others unchanged, and as what they asked for."""

from __future__ import annotations

import pytest

from benchmark.pipeline.record_arrays import read_distances
from tests.registry.plugin import write_plugin
from tests.runs.toy import done, planned, run_toy

SHARING = """
def canonicalise(self, shape):
        scale = shape.compute_once({key}, lambda: [1.0, 1.0, 1.0 + self.time])
        return shape.form(shape.mesh.vertices ** 3 * scale)
"""


@pytest.mark.parametrize("key", ['"heat"', '("heat", 1)', "self", "type(self)"])
def test_variants_of_one_class_share_nothing_that_depends_on_a_parameter(rods, tmp_path, key):
    plugin = write_plugin(
        tmp_path / "smooth.py", fields="time: float = 2.0", methods=SHARING.strip().format(key=key)
    )
    together = run_toy(rods, tmp_path / "one", "smooth[time=1|9]", plugins=(plugin,))
    for name, record in together.items():
        (alone,) = run_toy(rods, tmp_path / name, name, plugins=(plugin,)).values()
        assert record.key == alone.key
        assert (
            read_distances(tmp_path / "one", record) == read_distances(tmp_path / name, alone)
        ).all()


WRITES = """
def canonicalise(self, shape):
        scale = 1 + shape.geodesics().max() * shape.laplacian().stiffness.diagonal().max()
        form = shape.compute_once(LeastSquaresMDS(), lambda: shape.form(shape.mesh.vertices ** 3))
        stiffness = shape.laplacian().stiffness
        arrays = [*vars(shape.mesh).values(), shape.geodesics(), form.vertices, form.faces]
        arrays += [stiffness.data, stiffness.indices, stiffness.indptr, shape.laplacian().mass]
        arrays += [getattr(array, "base", None) for array in arrays]
        for array in arrays if self.time == 1 else ():
            try:
                array.setflags(write=True)
                array[:] = 0
            except (ValueError, AttributeError):
                pass
        notes = dict(form.notes)
        form.notes["time"] = self.time
        return shape.form(form.vertices * [1, 1, scale], **notes)
"""


def test_no_variant_changes_an_array_of_the_shape_of_the_next_one(rods, tmp_path):
    plugin = write_plugin(
        tmp_path / "smooth.py",
        imports="from baselines.smacof import LeastSquaresMDS",
        fields="time: float = 2.0",
        methods=WRITES.strip(),
    )
    both = run_toy(rods, tmp_path / "one", "smooth[time=1|9]", plugins=(plugin,))
    (alone,) = run_toy(rods, tmp_path / "alone", "smooth[time=9]", plugins=(plugin,)).values()
    record = both["smooth[time=9.0]"]
    assert (record.status, record.notes) == ("ok", alone.notes)
    assert (
        (read_distances(tmp_path / "one", record) == read_distances(tmp_path / "alone", alone))
        .all()
        .all()
    )


SCORER = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api import ScorerInfo


@dataclass(frozen=True, kw_only=True)
class Harmful:
    """A scorer that tries to change what its next draw gets."""

    info: ClassVar[ScorerInfo] = ScorerInfo(name="harmful", title="Harmful", draws=2)

    def signature(self, form):
        return {"extent": np.ptp(form.vertices, axis=0)}

    def compare(self, signatures, draw):
        extents = np.array([of["extent"] for of in signatures])
        distances = np.linalg.norm(extents[:, None] - extents, axis=2)
        HARM
        return distances
'''


@pytest.mark.parametrize(
    "harm",
    [
        "",
        "signatures[0].clear()",
        'signatures[0]["extent"] = signatures[-1]["extent"]',
        'signatures[0].pop("extent")',
    ],
)
def test_a_draw_changes_nothing_that_the_next_one_gets(rods, tmp_path, harm):
    means = []
    for name, text in (("fine", "pass"), ("harmful", harm or "pass")):
        scorer = tmp_path / name / "harmful.py"
        scorer.parent.mkdir()
        scorer.write_text(SCORER.replace("HARM", text))
        results = tmp_path / name / "results"
        (record,) = done(
            planned(rods, results, "identity", scorer="harmful", plugins=(scorer,)), results
        ).values()
        assert record.status == "ok", record.reason
        means.append(read_distances(results, record))
    assert (means[0] == means[1]).all(axis=None)


@pytest.mark.parametrize("harm", ["signatures.sort()", "signatures.reverse()", "del signatures[0]"])
def test_a_scorer_gets_no_list_that_it_could_reorder(rods, tmp_path, harm):
    scorer = tmp_path / "harmful.py"
    scorer.write_text(SCORER.replace("HARM", harm))
    jobs = planned(rods, tmp_path / "results", "identity", scorer="harmful", plugins=(scorer,))
    (record,) = done(jobs, tmp_path / "results").values()
    assert record.status == "failed"
    assert "harmful.py" in record.reason
