"""What a plan would take, worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmark.execution.estimates import Estimate, estimate


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


def test_what_never_finished_is_told_apart():
    found = estimate([job("a"), job("new")], store(record("a", canonicalise=1.0)))
    assert (found.seconds, found.unknown) == (pytest.approx(10), 1)
    assert found.lines(2, 1)[1] == "1 of them cannot be estimated: no job of their method has finished"


@pytest.mark.parametrize(
    ("seconds", "workers", "told"),
    [
        (30, 1, "at most about 30 s of work, judging by finished jobs"),
        (7200, 2, "at most about 2.0 h of work, 60 min with 2 jobs at a time, judging by finished jobs"),
    ],
)
def test_it_is_told_in_words(seconds, workers, told):
    lines = Estimate(seconds, 0, None).lines(3, workers)
    assert lines == [told, "disk: unknown before the first job"]
    assert Estimate(0, 0, None).lines(0, workers) == []
    assert Estimate(0, 2, None).lines(3, workers)[0].startswith("2 of them cannot be estimated")
    assert Estimate(seconds, 3, np.float64(12.3)).lines(3, workers)[-1] == "disk: about 12 MiB"
