"""Results in Python: frames, distances, forms and matches."""

import pytest

from benchmark.errors import ConfigurationError
from benchmark.report.results import open_results


def test_frames_say_what_ran(results):
    jobs = results.jobs
    assert set(jobs["method"]) == {"gps", "identity", "surface-area"}
    assert (jobs["status"] == "ok").all()
    key = results.job("gps", "rods")
    queries = results.queries.query("job == @key")
    assert queries["NN"].mean() == pytest.approx(jobs.loc[key, "NN"], abs=1e-6)
    assert {"shape", "class"} <= set(queries.columns)
    area = results.scores.query(
        "method == 'surface-area' and measure == 'NN'"
    )  # scores of forms are those of the default scorer
    assert area["value"].item() == pytest.approx(
        jobs.loc[results.job("surface-area", "rods"), "NN"], abs=1e-6
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: r.job("gps", "rods", "view"), "has no scores of gps on rods, view"),
        (
            lambda r: r.job("gps", "rods", fold="fold 0", quick=True, seed=3, scorer="bbox"),
            r"has no scores of gps on rods fold 0 \(quick\), mesh, seed 3, by bbox; run it",
        ),
        (lambda r: r.distances("nothing"), "has no job 'nothing'"),
        (lambda r: r.form(r.job("gps", "rods"), "rods9"), "unknown shape 'rods9'"),
        (lambda r: r.form(r.job("surface-area", "rods"), r.jobs.index[0]), "unknown shape"),
        (lambda r: r.matches(r.job("gps", "rods"), "rods9"), "unknown shape"),
    ],
)
def test_what_is_not_there_is_named(results, call, message):
    with pytest.raises(ConfigurationError, match=message):
        call(results)


def test_a_folder_is_needed(tmp_path):
    with pytest.raises(ConfigurationError, match="is no folder"):
        open_results(tmp_path / "nothing")
