"""Queries that are ranked in another gallery: views against complete surfaces, frames against
meshes.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

import benchmark
from benchmark.api.contracts import CanonicalForm, MethodInfo
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import ConfigurationError, DatasetError, UnsupportedShape
from benchmark.geometry.camera import Camera
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.prepared import frame_of
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.views import prepare_view
from benchmark.protocols.galleries import galleries
from benchmark.protocols.tables import ROUND
from benchmark.registry import select, select_one
from benchmark.report.formats import markdown
from benchmark.report.notes import table_notes
from benchmark.report.page_builder import heading_of_table, label_of_table
from benchmark.report.record_facts import tables_of
from benchmark.report.results import open_results
from benchmark.report.tables import table_views
from benchmark.runs.planning import plan_selection
from benchmark.runs.runner import run_jobs
from benchmark.runs.tasks import Work
from tests.registry.plugin import write_plugin
from tests.report.records import record as made_up
from tests.runs.toy import ThisProcess, done
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
    (record,) = done(jobs(*arguments, **options), arguments[2]).values()
    return record


def forms(results):
    return {path.name: path.stat().st_mtime_ns for path in (results / "runs").glob("[fps]*/*.npz")}


@pytest.fixture(scope="module")
def finished(rods, tmp_path_factory):
    """Rods that were run under both inputs."""
    results = tmp_path_factory.mktemp("results")
    of_both = run_jobs(jobs(rods, "", results, input=None), results, workers=ThisProcess())
    assert [record.status for record in of_both] == ["ok"] * 2
    return results


def test_a_job_takes_the_forms_of_both_inputs_from_the_cache_and_ranks_by_its_distances(
    rods, finished
):
    before, how = forms(finished), {"input": "view", "same_names": True}
    record = result(rods, rods, finished, **how)
    assert before == forms(finished)
    assert (record.gallery, record.input, record.gallery_of_queries.input) == (
        "rods against rods without same names",
        "view",
        "mesh",
    )
    (again,), (other,) = jobs(rods, rods, finished, **how), jobs(rods, rods, finished, input="view")
    assert (again.state, again.record.key, other.state) == ("finished", record.key, "missing")
    found = open_results(finished).matches(record.key, "thin0", 2)
    assert found["rank"].tolist() == [1, 2]
    assert "thin0" not in found["shape"].tolist(), "its own shape is left out"
    assert found["distance"].tolist() == sorted(read_distances(finished, record)[2][[0, 1, 3]])[:2]


@pytest.mark.parametrize("method", ["identity", "shape-dna"])
def test_no_query_changes_the_ranking_of_another_one(method, rods, finished, tmp_path):
    shutil.copytree(rods, tmp_path / "some", ignore=shutil.ignore_patterns("thin1*", "thick0*"))
    every, some = (result(queries, rods, finished, method) for queries in (rods, tmp_path / "some"))
    rows = [every.shapes.index(name) for name in some.shapes]
    np.testing.assert_array_equal(
        read_distances(finished, some), read_distances(finished, every)[rows]
    )
    assert (some.per_query["NN"], every.per_query["NN"]) == ([1, 1], [1] * 4), (
        "the very shape is in the gallery"
    )


@pytest.fixture(scope="module")
def damaged(rods, tmp_path_factory):
    """A folder of queries and one of a gallery, each with a shape that cannot be read."""
    folder = tmp_path_factory.mktemp("damaged")
    queries = shutil.copytree(rods, folder / "queries")
    gallery = shutil.copytree(rods, folder / "gallery")
    (queries / "thin1.off").write_text("OFF")
    (gallery / "thin0.off").write_text("OFF")
    write_off(queries / "alone0.off", rod(0.3, 0.0))
    return queries, gallery


@pytest.fixture(scope="module")
def damaged_record(damaged, finished):
    """The record of these queries among the shapes of the gallery that have another name."""
    return result(*damaged, finished, same_names=True)


def test_shapes_without_a_result_are_named_on_their_side(damaged_record):
    refused = [[name for name, _ in side.unsupported] for side in damaged_record.sides]
    assert refused == [["thin1"], ["thin0"]]


def test_shapes_without_a_result_rank_last_or_find_nothing(damaged_record):
    first_tiers = dict(zip(damaged_record.shapes, damaged_record.per_query["FT"], strict=True))
    assert (first_tiers["alone0"], first_tiers["thin1"]) == (None, 0)
    assert damaged_record.lone_queries == 1
    precision = damaged_record.per_query["mAP"][damaged_record.shapes.index("thin0")]
    assert precision > 0, "thin1 has a form in the gallery"


def test_a_caption_counts_queries_and_shapes_of_the_gallery(damaged_record):
    (view,) = table_views([damaged_record])
    assert view.caption.startswith(
        "Retrieval on queries against gallery without same names (4 queries of 2 classes, "
    )
    assert ", 1 left out, among 4 shapes), scored by CM-BOF (image_size=64" in view.caption
    assert view.chance["mesh"]["NN"] == pytest.approx(1 / 3)


def test_a_table_of_queries_and_gallery_is_called_by_both(damaged_record):
    (view,) = table_views([damaged_record])
    name = "queries against gallery without same names"
    assert view.table.identifier == name
    assert view.stem.startswith("table-queries-against-gallery-without-same-names-by-")
    assert markdown(view).startswith(f"**Retrieval on {name}** (4 queries of 2 classes, ")
    assert heading_of_table(view) == view.caption
    assert label_of_table(view) == name


def test_a_lost_form_of_the_gallery_is_made_again(damaged, damaged_record, finished):
    gallery = damaged_record.gallery_of_queries
    runs = finished / "runs"
    (runs / "records" / f"{damaged_record.key}.json").unlink()
    (runs / "forms" / f"{gallery.views_of_shapes[3].keys['forms']}.npz").unlink()
    again = result(*damaged, finished, same_names=True)
    assert again.per_query == damaged_record.per_query
    assert again.gallery_of_queries.unsupported == gallery.unsupported


def test_a_changed_gallery_makes_its_row_stale_and_another_folder_none(
    damaged, damaged_record, rods, finished, tmp_path
):
    queries, gallery = damaged
    before = (gallery / "thin0.off").read_bytes()
    write_off(gallery / "thin0.off", rod(0.06, 0.5))
    (stale,) = jobs(queries, gallery, finished, same_names=True)
    (gallery / "thin0.off").write_bytes(before)
    assert (stale.state, stale.before.key) == ("stale", damaged_record.key)
    elsewhere = shutil.copytree(rods, tmp_path / "gallery")
    (other,) = jobs(queries, elsewhere, finished, same_names=True)
    assert (other.state, other.before) == ("missing", None)


def test_no_table_of_views_against_surfaces_is_made_without_request():
    assert not [each for each in galleries([], ["animals"]) if each.gallery_of_queries]


def test_views_from_the_front_and_side_are_ranked_against_surfaces():
    cross = [each for each in galleries(["III-cross"]) if each.gallery_of_queries]
    assert [each.name for each in cross] == [
        f"{name} against complete surfaces" for name in ("animals", *TURNED)
    ]
    assert {each.gallery_of_queries.source for each in cross} == {"animals"}


def test_a_gallery_of_queries_is_in_a_table_of_its_own():
    assert [table.identifier for table in tables_of("animals", "against rods")] == [
        "animals against rods"
    ]
    views = table_views([made_up(dataset="animals", input_="view")])
    assert [view.table.identifier for view in views] == ["III-view"]


def test_a_quick_plan_of_views_against_surfaces_has_the_methods_of_quick_runs(tmp_path):
    planned = plan_selection(tmp_path, tables=["III-cross"], quick=True, input="view")
    states = {(job.record.gallery, job.record.method): job.state for job in planned}
    assert "sd-gdm" not in {method for _, method in states}
    assert {states[f"{place} (quick)", "gps"] for place in ("animals", *TURNED)} == {"missing"}
    assert states["animals against complete surfaces (quick)", "learned"] == "unsupported"


def test_galleries_that_fit_no_queries_are_refused(rods, tmp_path):
    with pytest.raises(ConfigurationError, match="--gallery needs queries, and no table"):
        galleries(["III"], [str(rods)], gallery=str(rods))
    assert "--gallery needs queries" in refusal("plan", "-d", rods, "--same-names")
    other = write_rods(tmp_path / "other", (0.0,), radii={"a": 0.1, "b": 0.2})
    with pytest.raises(
        DatasetError,
        match="queries are of thick, thin, and shapes of other of a, b; name the classes",
    ):
        jobs(rods, other, tmp_path)


def test_frames_are_ranked_among_meshes_and_find_them(rods, finished, tmp_path, in_this_process):
    frames, meshes, results = (
        tmp_path / "frames",
        tmp_path / "meshes",
        ("--results", tmp_path / "results"),
    )
    for subject, radius in (("man-1", 0.1), ("woman-3", 0.2)):
        write_off(meshes / subject / "kneeling.off", rod(radius, 0.0))
        (frames / subject).mkdir(parents=True)
        for name in ("kneeling.png", "kneeling_mask.png"):
            shutil.copy(FRAMES / subject / name, frames / subject)
    shutil.copy(FRAMES / "camera.json", frames)
    words = (
        "run",
        "-d",
        frames,
        "--gallery",
        meshes,
        "-m",
        "identity",
        *SMALL,
        *results,
        "-j",
        "0",
    )
    said = " ".join(call(*words).split())
    assert (
        "frames against meshes: 2 queries have names of its shapes; --same-names leaves these out"
        in said
    )
    assert "**Retrieval on frames against meshes** (2 queries of 2 classes, among 2 shapes)" in said
    assert "nothing can be retrieved" in refusal(*words, "--same-names")
    assert "forms of queries are others" in refusal(
        *words[:5], *results, "--forms", f"mine={meshes}"
    )
    table = benchmark.run(
        frames, "identity", gallery=meshes, input="view", scorer=SMALL_SCORER, results=results[1]
    )
    assert table[["dataset", "fold", "status"]].to_numpy().tolist() == [
        ["frames", "against meshes", "ok"]
    ]
    asked = (
        "retrieve",
        "-d",
        rods,
        *SMALL,
        "--results",
        finished,
        frames / "man-1" / "kneeling.png",
        "-m",
    )
    views, surfaces = (
        call(*asked, "identity", *more).splitlines() for more in ((), ("--input", "mesh"))
    )
    assert views[:-1] != surfaces[:-1]
    assert "needs views, and " in refusal(*asked, "learned-streamed", "--input", "mesh")


def seen_from_around(queries, results, method, **options):
    return result(queries, "", results, method, input="view", gallery_views=4, **options)


def test_a_gallery_that_four_cameras_see_is_as_near_as_its_nearest_view(rods, tmp_path):
    record = seen_from_around(rods, tmp_path, "surface-area")
    shapes, area = open_dataset(str(rods), None), select_one("surface-area").create()
    width = frame_of(shapes)

    def described(entry, angle):
        x, y, z = shapes.camera(entry).direction
        turned = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z
        view = prepare_view(shapes.load(entry), Camera(turned, shapes.camera(entry).up), width)
        return area.describe(shape_of(view, entry.identifier))

    views = [
        [described(entry, np.radians(angle)) for angle in range(45, 360, 90)]
        for entry in shapes.shapes
    ]
    expected = [
        [min(area.distances([described(entry, 0), each])[0, 1] for each in of) for of in views]
        for entry in shapes.shapes
    ]
    np.testing.assert_allclose(read_distances(tmp_path, record), expected, atol=1e-9)
    assert (record.gallery, len(record.gallery_of_queries.shapes)) == ("rods against 4 cameras", 4)
    found = open_results(tmp_path).matches(record.key, "thin0", 9)
    assert sorted(found["shape"]) == ["thick0", "thick1", "thin1"], "its own shape is left out"
    others = [
        jobs(rods, *how, tmp_path, "surface-area", input="view", gallery_views=n)[0].record
        for how, n in ((("",), 6), ((rods,), 4))
    ]
    assert {record.key} & {other.key for other in others} == set()
    assert others[1].gallery == "rods against 4 cameras around rods"


def test_the_views_of_a_shape_are_prepared_together(rods, tmp_path, monkeypatch):
    tasks = []
    monkeypatch.setattr(
        "tests.runs.toy.Work", lambda task, context: tasks.append(task) or Work(task, context)
    )
    seen_from_around(rods, tmp_path, "identity")
    around = {
        shape: [f"{shape}@{k}" for k in range(4)]
        for shape in ("thick0", "thick1", "thin0", "thin1")
    }
    prepared = [
        [step.view for step in task.steps] for task in tasks if task.steps[0].stage == "prepared"
    ]
    assert sorted(prepared) == sorted([[""], *([shape] for shape in around), *around.values()])


def test_shapes_that_are_named_like_views_are_prepared_alone(rods, tmp_path, monkeypatch):
    tasks, names = [], ["a@0", "a@1", "b@0", "b@1"]
    for path, name in zip(sorted(rods.glob("*.off")), names, strict=True):
        (tmp_path / "rods").mkdir(exist_ok=True)
        shutil.copy(path, tmp_path / "rods" / f"{name}.off")
    monkeypatch.setattr(
        "tests.runs.toy.Work", lambda task, context: tasks.append(task) or Work(task, context)
    )
    (record,) = done(jobs(tmp_path / "rods", "", tmp_path, input="mesh"), tmp_path).values()
    prepared = [
        [step.view for step in task.steps] for task in tasks if task.steps[0].stage == "prepared"
    ]
    assert (record.status, sorted(prepared)) == ("ok", [[name] for name in names])


@pytest.mark.parametrize("input_", ["mesh", "view"])
def test_networks_have_forms_of_views_alone(input_):
    queries = made_up()
    there = {
        "gallery": "rods",
        "gallery_digest": "2",
        "input": input_,
        "shapes": queries.shapes,
        "labels": queries.labels,
        "data": {"name": "rods", "title": "rods", "source": "rods"},
    }
    (view,) = table_views(
        [made_up("learned", fold="against 2 cameras", input_="view", against=there)]
    )
    assert any("no form of a complete surface" in note for note in table_notes(view)) == (
        input_ == "mesh"
    )


class Constant:
    """One form for every shape but those that it refuses."""

    info = MethodInfo(name="constant", title="Constant", inputs=("view",))
    form = rod(0.1, 1.0)

    def __init__(self, *refuses):
        self.refuses = refuses

    def canonicalise(self, shape):
        if shape.identifier.startswith(self.refuses):
            raise UnsupportedShape("no", "yes")
        return CanonicalForm(self.form.vertices, self.form.faces)


def test_one_constant_form_scores_chance_whatever_views_are_refused(rods, tmp_path):
    for refuses in ((), ("thin0@0", "thick1@0", "thick1@3")):
        record = seen_from_around(rods, tmp_path, Constant(*refuses))
        (view,) = table_views([record])
        assert record.gallery_of_queries.unsupported == []
        assert {name: record.scores[name] for name in view.chance["view"]} == pytest.approx(
            view.chance["view"]
        )
    record = seen_from_around(rods, tmp_path, Constant("thick1@"))
    assert record.gallery_of_queries.unsupported == [("thick1", "no; yes")]
    assert read_distances(tmp_path, record).shape == (4, 3)


def test_a_frame_is_retrieved_among_the_views_of_meshes(rods, finished, in_this_process):
    asked = ("-d", rods, "--gallery-views", "2", "-m", "identity", *SMALL, "--results", finished)
    query = FRAMES / "man-1" / "kneeling.png"
    said = refusal("retrieve", *asked, query)
    assert "rods --gallery-views 2 --scorer" in said
    assert f"--results {finished}` first" in said
    call("run", *asked, "-j", "0")
    lines = call("retrieve", *asked, query).splitlines()
    assert sorted(line.split()[1] for line in lines[1:5]) == ["thick0", "thick1", "thin0", "thin1"]
    itself = call("retrieve", *asked, rods / "thin0.off").splitlines()
    assert sorted(line.split()[1] for line in itself[1:4]) == ["thick0", "thick1", "thin1"]


def test_tables_of_twelve_cameras_have_a_column_with_their_own(tmp_path):
    found = [one for one in galleries(["III-cameras"]) if one.part.endswith("own")]
    assert [one.gallery_of_queries.source for one in found] == ["animals"] * 3
    (own, *_) = found
    assert (own.gallery_of_queries.n_views, own.gallery_of_queries.inputs) == (13, ("view",))
    last = own.gallery_of_queries.seen.entries[12]
    assert own.gallery_of_queries.seen.dataset.camera(
        last
    ) == own.gallery_of_queries.dataset.camera(own.gallery_of_queries.entries[0])
    for one in found:
        rows = [component.base_name for component in one.rows("view", select([], ()))]
        assert (
            {"identity", "mesh-unfolding", "surface-area", "learned", "learned-wide-extra"}
            <= {*rows}
            <= {*ROUND}
        )
    assert not [one for one in galleries() if one.gallery_of_queries]


@pytest.mark.parametrize(
    ("inputs", "queries", "reason"),
    [
        ("view", "view", "does not take the mesh input; pass --gallery-views 12 to see meshes"),
        ("view", "mesh", "does not take the mesh input; pass --gallery-views 12 to see meshes"),
        ("mesh", "view", "does not take the view input"),
    ],
)
def test_cameras_are_advised_where_they_help(rods, tmp_path, inputs, queries, reason):
    plugin = write_plugin(tmp_path / "smooth.py", info=f'inputs=("{inputs}",)')
    (job,) = jobs(rods, rods, tmp_path, "smooth", plugins=[plugin], input=queries)
    assert job.state == "unsupported"
    assert job.reason.partition(" as views")[0] == reason
