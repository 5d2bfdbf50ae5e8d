"""Curves of robustness from made-up records, and from a run of its own."""

import csv
import io
import json

from benchmark.datasets.changes import CHANGES, LEVELS, changed_name
from benchmark.pipeline.storage.records import as_text
from benchmark.protocols.tables import INPUTS
from benchmark.report.results import Result
from benchmark.report.robustness import as_csv, latex, markdown, robustness
from tests.records import failed, record
from tests.toy import write_rods
from tests.verbs import call


def perturbed(perturbation, strength, **more):
    name = changed_name("rods", perturbation, strength)
    return record(gallery=name, **more)


def collected(*records):
    (found,) = robustness(Result(each) for each in records)
    return found


def noisy(*values, **more):
    return [perturbed("noise", k, nn=value, **more) for k, value in enumerate(values, start=1)]


def test_a_method_fails_where_nn_is_first_below_half_of_its_clean_value():
    found = collected(record(nn=1.0), *noisy(0.9, 0.75, 0.5, 0.25, 0.5))
    assert set(found["half_at"]) == {CHANGES["noise"].amounts[3]}  # a half is not below a half
    assert "| Classic-Mds | 1.00 | 0.008 |" in markdown(found)
    assert "Classic-Mds & 1.00 & 0.008" in latex(found)
    rows = list(csv.DictReader(io.StringIO(as_csv([found]))))
    assert [float(row["NN"]) for row in rows] == [0.9, 0.75, 0.5, 0.25, 0.5]


def test_destroyed_shapes_are_queries_without_success():
    lost = [["cat9", "gone"], ["cat8", "gone"], ["cat7", "gone"], ["cat6", "gone"]]
    gone = failed(status="unsupported", gallery=changed_name("rods", "noise", 2))
    found = collected(record(nn=1.0), perturbed("noise", 1, nn=0.75, unsupported=lost), gone)
    assert found["NN"].tolist()[:3] == [0.375, 0.0, None]
    assert "| *Shapes destroyed, at most* | 0 | 4 |" in markdown(found)


def test_what_survives_is_told_apart_from_what_was_not_run_or_could_not_fall():
    survives = collected(record(nn=1.0), *noisy(1, 1, 1, 1, 1))
    assert "| > 0.016 |" in markdown(survives)
    partly = collected(record(nn=1.0), *noisy(1, 1))
    assert "| 1.00 | -- |" in markdown(partly)
    holed = collected(record(nn=1.0), perturbed("noise", 3, nn=0.0))
    assert "| 1.00 | -- |" in markdown(holed)  # nobody knows whether a weaker one is enough
    hopeless = collected(record(nn=0.5), *noisy(0.1, 0.1, 0.1, 0.1, 0.1))  # chance is 0.25
    assert "| n/a |" in markdown(hopeless)


def test_tables_write_the_curves_beside_the_other_tables_and_perturbed_sets_have_none_of_their_own(tmp_path):
    folder = tmp_path / "results" / "runs" / "records"
    folder.mkdir(parents=True)
    for method in ("classic-mds", "fast-mds"):
        for each in (record(method, nn=1.0), *noisy(0.75, 0.5, 0.25, 0.25, 0.0, method=method)):
            (folder / f"{each['key']}.json").write_text(as_text(each))
    whole = ("tables", "--results", tmp_path / "results", "-o", tmp_path / "out")
    call(*whole, "-d", "rods")
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"robustness-rods-mesh.md", "robustness-rods-mesh.tex", "robustness-rods-mesh.png"} <= files
    assert {"robustness.csv", "robustness.json", "table-rods.md"} <= files
    assert not [name for name in files if "table-rods[" in name or "noise" in name]
    call(*whole, "-d", "rods", "--check")
    call(*whole, "--check")
    (tmp_path / "out" / "table-old.md").write_text("")
    (tmp_path / "out" / "mine.md").write_text("")
    (tmp_path / "out" / "robustness-rods-mesh.png").unlink()
    told = call(*whole, "--check", code=1)
    assert "stale: robustness-rods-mesh.png\nleft over: table-old.md;" in told
    assert json.loads(call(*whole[:3], "-d", "rods", "--format", "json"))[0]["table"] == "rods"  # one document
    alone = call(*whole[:3], "-d", "rods", "-t", "robustness")
    assert "| Fast-Mds † | 1.00 | 0.004 |" in alone and "†: made before the last change." in alone
    assert "Table rods" not in alone


def test_a_plan_of_robustness_has_each_perturbation_under_the_inputs_that_it_is_made_for(tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    options = ("-d", rods, "-m", "fast-mds", "-t", "robustness", "--results", tmp_path / "results")
    lines = call("plan", *options).splitlines()
    expected = {f"rods {input_} fast-mds" for input_ in INPUTS} | {
        f"{changed_name('rods', perturbation, strength)} {input_} fast-mds"
        for perturbation, known in CHANGES.items() if perturbation not in ("jitter", "perspective")
        for input_ in known.inputs
        for strength in LEVELS
    }
    assert {
        line.removeprefix("missing").split("  never")[0].strip() for line in lines if line.startswith("missing")
    } == expected
