"""Queries that are ranked in another gallery: views against complete surfaces, frames against meshes."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import benchmark
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.pipeline.records import read_distances
from benchmark.protocols.galleries import galleries, selected_galleries
from benchmark.registry import select
from benchmark.report.frames import tables_of
from benchmark.report.results import open_results
from benchmark.report.tables import table_views
from benchmark.runs.planning import plan, plan_selection
from benchmark.runs.runner import run
from tests.report.records import record as made_up
from tests.toy import SMALL_SCORER, rod, write_off, write_rods
from tests.verbs import call, refusal

FRAMES = Path(__file__).parents[2] / "examples" / "depth"
SMALL = ("--scorer", SMALL_SCORER)

#: Views from the side.
TURNED = ("animals[view-angle=3]", "animals[view-angle=5]")


def jobs(queries, gallery, results, method="identity", **options):
    chosen = {"datasets": [str(queries)], "gallery": str(gallery), "input": "mesh"} | options
    return plan_selection(results, methods=[method], scorer=SMALL_SCORER, **chosen)


def result(*arguments, **options):
    ((_, record),) = run(jobs(*arguments, **options), arguments[2], size=0)
    return record


def forms(results):
    return {path.name: path.stat().st_mtime_ns for path in (results / "runs").glob("[fps]*/*.npz")}


@pytest.fixture(scope="module")
def finished(rods, tmp_path_factory):
    """Rods that were run under both inputs."""
    results = tmp_path_factory.mktemp("results")
    assert [record.status for _, record in run(jobs(rods, "", results, input=None), results, size=0)] == ["ok"] * 2
    return results


def test_a_job_takes_the_forms_of_both_inputs_from_the_cache_and_its_ranking_is_that_of_its_distances(rods, finished):
    before, how = forms(finished), {"input": "view", "same_names": True}
    record = result(rods, rods, finished, **how)
    assert before == forms(finished)
    assert (record.gallery, record.input, record.against.input) == (
        "rods against rods without same names",
        "view",
        "mesh",
    )
    (again,), (other,) = jobs(rods, rods, finished, **how), jobs(rods, rods, finished, input="view")
    assert (again.state, again.record.key, other.state) == ("finished", record.key, "missing")
    found = open_results(finished).matches(record.key, "thin0", 9)
    assert sorted(found["shape"]) == ["thick0", "thick1", "thin1"], "its own shape is left out"
    assert found["distance"].tolist() == sorted(read_distances(finished, record)[2][[0, 1, 3]])


@pytest.mark.parametrize("method", ["identity", "shape-dna"])
def test_no_query_changes_the_ranking_of_another_one(method, rods, finished, tmp_path):
    shutil.copytree(rods, tmp_path / "some", ignore=shutil.ignore_patterns("thin1*", "thick0*"))
    every, some = (result(queries, rods, finished, method) for queries in (rods, tmp_path / "some"))
    rows = [every.shapes.index(name) for name in some.shapes]
    np.testing.assert_array_equal(read_distances(finished, some), read_distances(finished, every)[rows])
    assert (some.per_query["NN"], every.per_query["NN"]) == ([1, 1], [1] * 4), "the very shape is in the gallery"


def test_shapes_without_a_result_rank_last_or_find_nothing(rods, finished, tmp_path):
    queries, gallery = (shutil.copytree(rods, tmp_path / name) for name in ("queries", "gallery"))
    (queries / "thin1.off").write_text("OFF")
    (gallery / "thin0.off").write_text("OFF")
    write_off(queries / "alone0.off", rod(0.3, 0.0))
    record = result(queries, gallery, finished, same_names=True)
    assert [[name for name, _ in side.unsupported] for side in record.sides] == [["thin1"], ["thin0"]]
    measured = dict(zip(record.shapes, record.per_query["FT"], strict=True))
    assert (measured["alone0"], measured["thin1"], record.lone_queries) == (None, 0, 1)
    assert record.per_query["mAP"][record.shapes.index("thin0")] > 0, "thin1 has a form in the gallery"
    (view,) = table_views([record])
    assert view.caption.startswith("Retrieval on queries against gallery without same names (4 queries of 2 classes, ")
    assert ", 1 left out, among 4 shapes), scored by CM-BOF (image_size=64" in view.caption
    assert view.chance["mesh"]["NN"] == pytest.approx(1 / 3)
    kept = finished / "runs"
    for path in (kept / "records" / f"{record.key}.json", kept / "forms" / f"{record.against.keys[3]['forms']}.npz"):
        path.unlink()
    again = result(queries, gallery, finished, same_names=True)
    assert (again.per_query, again.against.unsupported) == (record.per_query, record.against.unsupported)
    write_off(gallery / "thin0.off", rod(0.06, 0.5))
    (stale,) = jobs(queries, gallery, finished, same_names=True)
    assert (stale.state, stale.before.key) == ("stale", record.key)
    (other,) = jobs(queries, shutil.copytree(rods, tmp_path / "elsewhere" / "gallery"), finished, same_names=True)
    assert (other.state, other.before) == ("missing", None), "another folder of this name replaces nothing"


def test_tables_of_views_against_surfaces_are_made_on_request_alone(tmp_path):
    assert not [one for one in galleries([], ["animals"]) if one.against]
    found = [one for one in galleries(["III-cross"]) if one.against]
    assert [one.name for one in found] == [f"{name} against complete surfaces" for name in ("animals", *TURNED)]
    assert {one.against.source for one in found} == {"animals"}
    assert [table.identifier for table in tables_of("animals", "against rods")] == ["animals against rods"]
    assert [view.table.identifier for view in table_views([made_up(dataset="animals", input_="view")])] == ["III-view"]
    planned = plan(galleries(["III-cross"], quick=True), ["view"], select(["gps", "sd-gdm", "learned"], ()), tmp_path)
    states = {(job.record.gallery, job.record.method): job.state for job in planned}
    assert "sd-gdm" not in {method for _, method in states}, "as in quick runs"
    assert {states[f"{place} (quick)", "gps"] for place in ("animals", *TURNED)} == {"missing"}
    assert states["animals against complete surfaces (quick)", "learned"] == "unsupported"


def test_galleries_that_fit_no_queries_are_refused(rods, tmp_path):
    with pytest.raises(ConfigurationError, match="--gallery needs queries, and no table"):
        selected_galleries(["III"], [str(rods)], gallery=str(rods))
    assert "--gallery needs queries" in refusal("plan", "-d", rods, "--same-names")
    other = write_rods(tmp_path / "other", (0.0,), radii={"a": 0.1, "b": 0.2})
    with pytest.raises(DatasetError, match="queries are of thick, thin, and shapes of other of a, b; name the classes"):
        jobs(rods, other, tmp_path)


def test_frames_are_ranked_among_meshes_and_find_them(rods, finished, tmp_path):
    frames, meshes, results = tmp_path / "frames", tmp_path / "meshes", ("--results", tmp_path / "results")
    for subject, radius in (("man-1", 0.1), ("woman-3", 0.2)):
        write_off(meshes / subject / "kneeling.off", rod(radius, 0.0))
        (frames / subject).mkdir(parents=True)
        for name in ("kneeling.png", "kneeling_mask.png"):
            shutil.copy(FRAMES / subject / name, frames / subject)
    shutil.copy(FRAMES / "camera.json", frames)
    words = ("run", "-d", frames, "--gallery", meshes, "-m", "identity", *SMALL, *results, "-j", "0")
    said = " ".join(call(*words).split())
    assert "frames against meshes: 2 queries have names of its shapes; --same-names leaves these out" in said
    assert "Retrieval on frames against meshes (2 queries of 2 classes, among 2 shapes)" in said
    assert "nothing can be retrieved" in refusal(*words, "--same-names")
    assert "forms of queries are others" in refusal(*words[:5], *results, "--forms", f"mine={meshes}")
    table = benchmark.run(frames, "identity", gallery=meshes, input="view", scorer=SMALL_SCORER, results=results[1])
    assert table[["dataset", "fold", "status"]].to_numpy().tolist() == [["frames", "against meshes", "ok"]]
    asked = ("retrieve", "-d", rods, *SMALL, "--results", finished, frames / "man-1" / "kneeling.png", "-m")
    views, surfaces = (call(*asked, "identity", *more).splitlines() for more in ((), ("--input", "mesh")))
    assert views[:-1] != surfaces[:-1]
    assert "needs views, and " in refusal(*asked, "learned-streamed", "--input", "mesh")
