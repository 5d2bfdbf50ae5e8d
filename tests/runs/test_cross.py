"""Queries that are ranked in another gallery: views against complete surfaces, frames against meshes."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import benchmark
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.pipeline.cache import Cache
from benchmark.pipeline.records import read_distances, read_records
from benchmark.protocols.galleries import galleries, selected_galleries
from benchmark.registry import select
from benchmark.report.results import open_results
from benchmark.report.tables import table_views
from benchmark.runs.planning import estimate, plan, plan_selection
from benchmark.runs.runner import run
from retrieval.measures import score_draws
from tests.toy import SMALL_SCORER, rod, write_off, write_rods
from tests.verbs import call, refusal

FRAMES = Path(__file__).parents[2] / "examples" / "depth"
#: Views from the side.
TURNED = ("animals[view-angle=3]", "animals[view-angle=5]")

SMALL = ("--scorer", SMALL_SCORER, "-j", "0")


def jobs(queries, gallery, results, method="identity", **options):
    chosen = {"datasets": [str(queries)], "gallery": str(gallery), "input": "view"} | options
    return plan_selection(results, methods=[method], scorer=SMALL_SCORER, **chosen)


def forms(results):
    return {path.name: path.stat().st_mtime_ns for path in (results / "runs").glob("[fps]*/*.npz")}


@pytest.fixture(scope="module")
def finished(rods, tmp_path_factory):
    """Views of rods against complete rods, after both were run for themselves: results, and files before and after."""
    results = tmp_path_factory.mktemp("results")
    for gallery in ("", str(rods)):
        before = forms(results)
        options = {"gallery": gallery, "same_names": bool(gallery)} | ({} if gallery else {"input": None})
        planned = jobs(rods, results=results, **options)
        for _, record in run(planned, results):
            assert record.status == "ok"
    return results, before, forms(results), record


def test_a_job_takes_the_forms_of_both_inputs_from_the_cache(rods, finished):
    results, before, after, record = finished
    assert before == after
    assert (record.gallery, record.input, record.against.input) == ("rods against rods", "view", "mesh")
    (again,) = jobs(rods, rods, results, same_names=True)
    assert (again.state, again.record.key) == ("finished", record.key)
    (other,) = jobs(rods, rods, results)  # with the same shapes, of the same names
    assert other.record.key != record.key
    assert estimate([other], read_records(results)).seconds > 0


def test_its_ranking_is_that_of_its_distances(rods, finished):
    results, *_, record = finished
    distances = read_distances(results, record)
    assert distances.shape == (4, 4)
    assert not np.allclose(distances, distances.T)
    assert record.per_query["FT"] == score_draws([distances], record.labels, None, record.targets)["per_query"]["FT"]
    found = open_results(results).matches(record.key, "thin0", 9)
    assert sorted(found["shape"]) == ["thick0", "thick1", "thin1"], "its own shape is left out"
    assert found["distance"].tolist() == sorted(distances[2][[0, 1, 3]])


def test_no_query_changes_the_ranking_of_another_one(rods, finished, tmp_path):
    results, *_ = finished
    for name in ("thin0", "thick1"):
        (tmp_path / "some").mkdir(exist_ok=True)
        shutil.copy(rods / f"{name}.off", tmp_path / "some")
    for method in ("identity", "shape-dna"):
        every, some = (
            next(iter(run(jobs(queries, rods, results, method, input="mesh"), results)))[1]
            for queries in (rods, tmp_path / "some")
        )
        rows = [every.shapes.index(name) for name in some.shapes]
        np.testing.assert_array_equal(read_distances(results, some), read_distances(results, every)[rows])
        assert (some.per_query["NN"], every.per_query["NN"]) == ([1, 1], [1] * 4), "the very shape is in the gallery"


def test_shapes_without_a_result_rank_last_or_find_nothing(rods, finished, tmp_path):
    results, queries, gallery = finished[0], tmp_path / "queries", tmp_path / "gallery"
    shutil.copytree(rods, queries)
    shutil.copytree(rods, gallery)
    (queries / "thin1.off").write_text("OFF")
    (gallery / "thin0.off").write_text("OFF")
    write_off(queries / "alone0.off", rod(0.3, 0.0))
    ((_, record),) = run(jobs(queries, gallery, results, same_names=True), results)
    assert [name for name, _ in record.unsupported] == ["thin1"]
    assert [name for name, _ in record.against.unsupported] == ["thin0"]
    measured = dict(zip(record.shapes, record.per_query["FT"], strict=True))
    assert (measured["alone0"], measured["thin1"], record.lone_queries) == (None, 0, 1)
    assert record.per_query["mAP"][record.shapes.index("thin0")] > 0, "thin1 has a form in the gallery"
    (view,) = table_views([record])
    assert view.caption == "Retrieval on queries against gallery (4 queries of 2 classes, 1 left out, 4 shapes)"
    assert view.chance["view"]["NN"] == pytest.approx(1 / 3)
    for path in [
        *(results / "runs" / "records").glob(f"{record.key}.*"),
        Cache(results)._path("signatures", record.against.keys[0]["signatures"]),
    ]:
        path.unlink()
    ((_, again),) = run(jobs(queries, gallery, results, same_names=True), results)
    assert (again.per_query, again.against.unsupported) == (record.per_query, record.against.unsupported)
    write_off(gallery / "thin0.off", rod(0.06, 0.5))
    (stale,) = jobs(queries, gallery, results, same_names=True)
    assert (stale.state, stale.before.key) == ("stale", record.key)


def test_tables_of_views_against_surfaces_are_made_on_request_alone(tmp_path):
    assert not [one for one in galleries([], ["animals"]) if one.against]
    found = [one for one in galleries(["III-cross"]) if one.against]
    assert [one.name for one in found] == [f"{name} against complete surfaces" for name in ("animals", *TURNED)]
    assert {one.against.source for one in found} == {"animals"}
    assert [one.name for one in galleries(["I-cross"])] == [
        "people[draw=0]",
        "people[draw=0] against complete surfaces",
    ]
    planned = plan(galleries(["III-cross"], quick=True), ["view"], select(["gps", "sd-gdm", "learned"], ()), tmp_path)
    named = {(job.record.gallery, job.record.method): (job.state, job.reason) for job in planned}
    for place in ("animals", *TURNED):
        assert named[f"{place} (quick)", "gps"][0] == "missing"
        assert (f"{place} (quick)", "sd-gdm") not in named
        assert named[f"{place} against complete surfaces (quick)", "learned"] == (
            "unsupported",
            "does not take the mesh input",
        )


@pytest.mark.parametrize(
    ("how", "problem"),
    [({"gallery": "GALLERY", "datasets": []}, "--gallery needs queries"),
     ({"gallery": "GALLERY", "tables": ["III"]}, "--gallery needs queries, and no table"),
     ({"gallery": "nowhere"}, "unknown data set 'nowhere'")],
)  # fmt: skip
def test_galleries_without_queries_are_refused(how, problem, rods, tmp_path):
    with pytest.raises(ConfigurationError, match=problem):
        selected_galleries(**{"datasets": [str(rods)]} | how)
    with pytest.raises(DatasetError, match="queries are of thick, thin, and shapes of other of a, b; name the classes"):
        jobs(rods, write_rods(tmp_path / "other", (0.0,), radii={"a": 0.1, "b": 0.2}), tmp_path)


def test_frames_are_ranked_among_meshes(rods, tmp_path):
    frames, meshes, results = tmp_path / "frames", tmp_path / "meshes", ("--results", tmp_path / "results")
    for subject, radius in (("man-1", 0.1), ("woman-3", 0.2)):
        write_off(meshes / subject / "kneeling.off", rod(radius, 0.0))
        (frames / subject).mkdir(parents=True)
        for ending in ("", "_mask"):
            shutil.copy(FRAMES / subject / f"kneeling{ending}.png", frames / subject)
    shutil.copy(FRAMES / "camera.json", frames)
    words = ("run", "-d", frames, "--gallery", meshes, "-m", "identity", *SMALL, *results)
    said = call(*words)
    assert "frames against meshes: 2 of 2 queries have the name of a shape of the gallery" in said
    assert "Retrieval on frames against meshes (2 queries of 2 classes, 0 left out, 2 shapes)" in " ".join(said.split())
    assert "nothing can be retrieved" in refusal(*words, "--same-names")
    table = benchmark.run(frames, "identity", gallery=meshes, input="view", scorer=SMALL_SCORER, results=results[1])
    assert table[["dataset", "fold", "status"]].to_numpy().tolist() == [["frames", "against meshes", "ok"]]
    assert "frames against meshes" in call("tables", *SMALL[:2], *results)


def test_a_frame_finds_meshes(rods, finished):
    asked = ("retrieve", "-d", rods, *SMALL[:2], "--results", finished[0], FRAMES / "man-1" / "kneeling.png")
    of_views = call(*asked, "-m", "identity")
    of_surfaces = call(*asked, "-m", "identity", "--input", "mesh", "-k", 2)
    assert len(of_views.splitlines()) == 6
    assert len(of_surfaces.splitlines()) == 4
    assert {line.split()[3] for line in of_views.splitlines()[1:3]} != {
        line.split()[3] for line in of_surfaces.splitlines()[1:3]
    }
    assert "needs views, and " in refusal(*asked, "-m", "learned-streamed", "--input", "mesh")
