"""What a plan would take, worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmark.jobs.estimates import Estimate, estimate


def record(method, gallery="g", input_="mesh", **seconds):
    return {"method": method, "gallery": gallery, "input": input_, "cost": {"seconds_per_shape": seconds}}


def job(method, shapes=10, gallery="g", input_="mesh", to_run=True):
    spec = SimpleNamespace(name=method, base_name=method.partition("[")[0])
    return SimpleNamespace(
        key=f"{method}{gallery}{input_}", gallery=gallery, facts={"data": {"name": gallery}},
        identifiers=tuple(map(str, range(shapes))), input=input_, method=spec, to_run=to_run,
    )  # fmt: skip


def store(*records, sizes=()):
    files = [SimpleNamespace(stat=lambda size=size: SimpleNamespace(st_size=size)) for size in sizes]
    found = [list(kept) for kept in (records, ())]
    return SimpleNamespace(published=found[0], records=found[1], artefact_files=lambda: iter(files))


def test_what_methods_share_counts_once():
    costs = [
        record("a", prepare=2.0, geodesics=3.0, canonicalise=1.0, features=0.5),
        record("b", prepare=2.0, geodesics=3.0, canonicalise=4.0),
    ]
    found = estimate([job("a"), job("b")], store(*costs))
    assert found.seconds == pytest.approx(10 * (2 + 3 + 1.5 + 4))
    assert found.unknown == 0


def test_other_inputs_and_finished_jobs_count_for_themselves():
    costs = [record("a", prepare=1.0), record("a", input_="view", prepare=5.0)]
    assert estimate([job("a"), job("a", input_="view")], store(*costs)).seconds == pytest.approx(60)
    assert estimate([job("a", to_run=False)], store(*costs)).seconds == 0


def test_the_same_gallery_tells_more_than_others_and_others_by_their_median():
    costs = [record("a", f"other {number}", canonicalise=value) for number, value in enumerate((1.0, 2.0, 9.0))]
    assert estimate([job("a")], store(*costs)).seconds == pytest.approx(20)
    assert estimate([job("a[x=1]")], store(*costs)).seconds == pytest.approx(20)
    assert estimate([job("a")], store(*costs, record("a", canonicalise=7.0))).seconds == pytest.approx(70)


def test_what_never_finished_is_told_apart():
    found = estimate([job("a"), job("new")], store(record("a", canonicalise=1.0)))
    assert (found.seconds, found.unknown) == (pytest.approx(10), 1)
    assert found.lines(2, 1)[1] == "1 of them cannot be estimated: no job of their method has finished"


def test_room_is_that_of_forms_and_prepared_shapes_of_the_size_of_others():
    costs = (record("a"), record("b"))
    found = estimate([job("a"), job("b")], store(*costs, sizes=[2**20, 3 * 2**20]))
    assert found.mebibytes == pytest.approx((20 + 10) * 2)
    assert estimate([job("a")], store(*costs)).mebibytes is None


@pytest.mark.parametrize(
    ("seconds", "workers", "told"),
    [
        (30, 1, "at most about 30 s of work, by the costs of finished jobs"),
        (7200, 2, "at most about 2.0 h of work, 60 min with 2 jobs at a time, by the costs of finished jobs"),
    ],
)
def test_it_is_told_in_words(seconds, workers, told):
    lines = Estimate(seconds, 0, None).lines(3, workers)
    assert lines == [told, "disk: unknown before the first job here"]
    assert Estimate(0, 0, None).lines(0, workers) == []
    assert Estimate(0, 2, None).lines(3, workers)[0].startswith("2 of them cannot be estimated")
    assert Estimate(seconds, 3, np.float64(12.3)).lines(3, workers)[-1] == "disk: about 12 MiB"
