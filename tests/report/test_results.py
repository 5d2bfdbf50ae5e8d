"""Which record stands for a job, and when it is marked: the same wherever the folder lies."""

import importlib.metadata
import shutil

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import BenchmarkError
from benchmark.execution.plan import make_plan
from benchmark.pipeline.storage import keys, lock
from benchmark.pipeline.storage.merging import publish, records_under
from benchmark.pipeline.storage.records import as_text
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, select
from benchmark.protocols.galleries import galleries
from benchmark.report.content import contents
from benchmark.report.formats import markdown
from benchmark.report.results import Results
from tests import records as made_up
from tests.pipeline.test_records import put_aliens
from tests.verbs import call

METHODS = ("identity", "surface-area", "least-squares-mds[start=classic]")
EARLIER, LATER = "2026-01-01T00:00:00+00:00", "2026-02-01T00:00:00+00:00"


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "results")


def jobs(rods, store, names=METHODS):
    return make_plan(galleries([], [str(rods)]), ["mesh"], select(names, methods()), store)


def of_job(job, *, code=None, finished=EARLIER, make=made_up.record, **more):
    """A record under the recipe of a job, its scores made up; with ``code`` under that of another version."""
    recipe = keys.plain(job.recipe)
    if code:
        recipe["versions"]["method/identity"] = code
    options = {"method": job.method.name, "finished": finished, **more}
    return {**make(**options), **keys.plain(job.facts), "recipe": recipe, "key": keys.digest(recipe)}


def chosen(store, **options):
    return {result.record["method"]: result for result in Results(store, methods()).all(**options)}


def test_tables_say_the_same_in_whichever_order_the_jobs_ended(rods, tmp_path):
    texts = []
    for step in (1, -1):
        store = Store.open(tmp_path / f"results{step}")
        plan = make_plan(galleries([], [str(rods)]), ["mesh", "view"], select(METHODS, methods()), store)
        for second, job in enumerate([*plan][::step]):
            store.write_record(of_job(job, finished=f"2026-01-01T00:00:{second:02}+00:00"))
        texts.append([markdown(table) for table in contents(Results(store, methods()).all())])
    assert texts[0] == texts[1] and texts[0][0].index("(mesh), NN") > texts[0][0].index("surface area alone")


def test_what_this_code_would_make_again_is_not_outdated(rods, store):
    for job in jobs(rods, store):
        store.write_record(of_job(job))
    found = chosen(store)
    assert set(found) == set(METHODS)
    assert [result.outdated for result in found.values()] == ["", "", ""]
    assert {job.state for job in jobs(rods, store)} == {"cached"}


def test_a_record_of_other_code_is_marked_and_never_a_blank(rods, store):
    (job,) = jobs(rods, store, ["identity"])
    store.write_record(of_job(job, code="0123", nn=0.5))
    (result,) = chosen(store).values()
    said = "versions changed: method/identity"
    assert result.outdated == said
    assert result.record["scores"]["NN"] == 0.5
    assert chosen(store, fresh=True) == {}
    text = call("tables", "--results", store.root.parent)
    assert "| Identity (no canonical form) † |" in text
    assert f"- † Identity (no canonical form): made before the last change ({said})" in text
    assert call("plan", "-d", rods, "-m", "identity", "--input", "mesh", "--results", store.root.parent).startswith(
        f"stale        rods mesh identity  {said}"
    )


def test_another_version_of_a_package_is_named_by_the_table_and_outdates_no_job(rods, store):
    for job in jobs(rods, store):
        store.write_record(
            of_job(job, environments=[{"environment": '{"libigl": "9.9", "blas": "x"}', "artefacts": 1}])
        )
    said = f"libigl 9.9 -> {importlib.metadata.version('libigl')}"
    assert {result.outdated for result in chosen(store).values()} == {said}
    assert {job.state for job in jobs(rods, store)} == {"cached"}
    assert call("tables", "--results", store.root.parent).count(said) == 1


def test_what_edited_code_made_is_marked_and_counts_while_the_edit_lasts(rods, store, monkeypatch):
    (job,) = jobs(rods, store, ["identity"])
    store.write_record(of_job(job, nn=0.25))
    with monkeypatch.context() as patch:
        patch.setattr(lock, "edited_folders", lambda: {"baselines": "0123"})
        (edited,) = jobs(rods, store, ["identity"])
        assert (edited.state, edited.reason) == ("stale", "edited: baselines; run make golden")
        assert edited.key.endswith(f"-{job.key}")
        store.write_record({**of_job(edited, nn=0.75), "key": edited.key})
        (result,) = chosen(store).values()
        assert (result.record["scores"]["NN"], result.outdated) == (0.75, "edited: baselines; run make golden")
        assert jobs(rods, store, ["identity"])[0].state == "cached"
    (result,) = chosen(store).values()
    assert (result.record["scores"]["NN"], result.outdated) == (0.25, "")
    assert [record["scores"]["NN"] for record in records_under(store)] == [0.25]
    made_here = {**of_job(job), "key": edited.key, "finished": LATER}
    assert publish([{**made_here, "data": {**made_here["data"], "source": "rods"}}], store.published).added == []


def test_a_row_on_other_shapes_than_the_newest_is_marked_and_not_compared(rods, store):
    for method, name, finished in (("identity", "horse0", EARLIER), ("fast-mds", "dog0", LATER)):
        (job,) = jobs(rods, store, [method])
        store.write_record(of_job(job, shapes=["cat0", "cat1", name, "dog1"], finished=finished))
    assert {name: result.outdated for name, result in chosen(store).items()} == {
        "identity": "other shapes",
        "fast-mds": "",
    }
    (table,) = contents(Results(store, methods()).all())
    assert table.significance["identity", "mesh"]["NN"].probability is None


def test_the_newest_of_this_code_counts_else_the_newest_with_scores(rods, store):
    (job,) = jobs(rods, store, ["identity"])

    def shown():
        (result,) = chosen(store).values()
        return result.record["status"], result.record.get("scores", {}).get("NN"), bool(result.outdated)

    store.write_record(of_job(job, code="1", nn=0.25))
    assert shown() == ("ok", 0.25, True)
    store.write_record(of_job(job, code="2", nn=0.5, finished=LATER))
    assert shown() == ("ok", 0.5, True)
    store.write_record(of_job(job, code="3", make=made_up.failed, finished="2026-03-01T00:00:00+00:00"))
    assert shown() == ("ok", 0.5, True)  # a failure of other code says nothing
    store.published.write(of_job(job, nn=0.75, finished="2025-01-01T00:00:00+00:00"))
    assert shown() == ("ok", 0.75, False)
    store.write_record(of_job(job, nn=1.0))  # the same key, made here
    assert shown() == ("ok", 1.0, False)


def test_a_job_that_cannot_be_done_here_hides_no_scores(rods, store):
    (job,) = jobs(rods, store, ["identity"])
    unavailable = of_job(job, make=made_up.failed, status="unavailable", finished="2030-01-01T00:00:00+00:00")
    unavailable |= {"recipe": {"unavailable": "needs torch"}, "key": keys.digest({"unavailable": "needs torch"})}
    store.write_record(unavailable)
    assert chosen(store)["identity"].record["status"] == "unavailable"
    store.write_record(of_job(job, code="1", nn=0.5))
    assert chosen(store)["identity"].record["scores"]["NN"] == 0.5


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_same_records_make_the_same_tables_in_any_folder(rods, store, tmp_path):
    """Once from records made here, with the data; once from a published copy, without; once among alien files."""
    for number, job in enumerate(jobs(rods, store)):
        store.write_record(of_job(job, nn=number / 4, code="1" if number else None))
    call("tables", "-o", tmp_path / "tables", "--results", store.root.parent)
    copy = tmp_path / "clone"
    shutil.copytree(store.records.folder, copy / "records")
    shutil.move(rods, rods.with_name("gone"))
    try:
        call("tables", "-o", tmp_path / "again", "--results", copy)
        put_aliens(copy / "records")
        (copy / "runs" / "records").mkdir(parents=True, exist_ok=True)
        (copy / "runs" / "records" / "dangling.json").symlink_to("/nowhere/at/all")
        assert "5 files are up to date" in call("tables", "-o", tmp_path / "again", "--check", "--results", copy)
    finally:
        shutil.move(rods.with_name("gone"), rods)
    here, published = files(tmp_path / "tables"), files(tmp_path / "again")
    differ = {name for name in here if here[name] != published[name]}
    assert differ == {"tables.csv", "tables.json"}
    for name, old, new in (("tables.csv", b",here,", b",published,"), ("tables.json", b'"here"', b'"published"')):
        assert here[name].replace(old, new) == published[name]
    assert b"\xe2\x80\xa0" in published["table-rods.md"]


def said_of_files(*arguments):
    """Lines on stderr about files that are skipped, for a verb that ends well."""
    done = CliRunner().invoke(cli, [*map(str, arguments)])
    assert done.exit_code == 0, done.output
    return [line for line in done.stderr.splitlines() if line.startswith("skipped ")]


def test_each_verb_names_each_alien_once_on_stderr(rods, store):
    for job in jobs(rods, store):
        store.write_record(of_job(job))
    alien, other = store.records.folder / "alien.json", store.published.folder / "nowhere.json"
    alien.write_text('{"a": 1}')
    other.parent.mkdir()
    other.symlink_to("/nowhere/at/all")
    told = [
        f"skipped {other}: the link is broken; remove it or move it elsewhere",
        f"skipped {alien}: it is not a record: Object missing required field `key`; remove it or move it elsewhere",
    ]
    results = ("--results", store.root.parent)
    selection = ("-d", rods, *(word for method in METHODS for word in ("-m", method)), "--input", "mesh", *results)
    assert said_of_files("plan", *selection) == told[1:]  # of the published ones it reads those that it needs
    assert said_of_files("run", "-j", "0", *selection) == told[::-1]
    assert said_of_files("tables", *selection) == told
    assert said_of_files("merge", store.root.parent, *results) == told
    assert said_of_files("compare", "identity", "surface-area", *results) == told


def test_a_key_that_its_recipe_does_not_give_is_refused_wherever_it_lies(rods, store, tmp_path):
    """A score under a forged key would stand in a table as made by this code."""
    (job,) = jobs(rods, store, ["identity"])
    good = of_job(job, nn=0.5)
    forged = {**good, "recipe": {**good["recipe"], "seed": 7}}
    for folder in (store.records.folder, store.published.folder):
        store.published.write(good)  # makes the folder
        store.published.remove(good["key"])
        (folder / f"{good['key']}.json").write_text(as_text(forged))
        said = CliRunner().invoke(cli, ["tables", "--results", str(store.root.parent)])
        assert "its key is not that of its recipe" in said.stderr
        assert isinstance(said.exception, BenchmarkError)
        merged = CliRunner().invoke(cli, ["merge", str(store.root.parent), "--results", str(tmp_path / "all")])
        assert "its key is not that of its recipe" in merged.stderr
        (folder / f"{good['key']}.json").unlink()
    assert call("plan", "-d", rods, "-m", "identity", "--input", "mesh", "--results", store.root.parent).startswith(
        "missing"
    )


def test_a_plan_says_that_older_code_has_published_a_row(rods, store):
    (job,) = jobs(rods, store, ("identity",))
    store.published.write(of_job(job, code="0" * 16))
    (again,) = jobs(rods, store, ("identity",))
    assert again.state == "missing"
    assert again.reason.startswith("never run here; finished elsewhere: versions changed: method/identity")
