"""Verification: what an honest bundle proves, and what is said to forged ones."""

from __future__ import annotations

import json
import stat
import struct
import zipfile
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmark.bundles.archive import LARGEST_FILE, BundleError, check_arrays
from benchmark.bundles.outcomes import Outcome
from benchmark.bundles.packing import _withheld
from benchmark.bundles.remaking import rigid_distance
from benchmark.bundles.rows import Request
from benchmark.bundles.verification import verified
from benchmark.pipeline.storage.keys import digest
from benchmark.plugins.scorers import ScorerSpec
from benchmark.source_code import digest_of_source
from tests.bundles.made import SCORER, Forgery, command, object_array, where
from tests.toy import write_rods
from tests.verbs import call

pytestmark = pytest.mark.usefixtures("forked_workers")


def outcome(path: Path, *, data: Path | None = None, results: Path = Path("nowhere"), run: bool = False) -> Outcome:
    """Outcome of a bundle, found out in this process."""
    request = Request(path, results, None, {"rods": data} if data else {}, run)
    return msgspec.convert(json.loads(json.dumps(verified(request, lambda line: None))), Outcome)


def faults(found: Outcome) -> dict[str, str]:
    every = [*found.faults, *(fault for row in found.rows for fault in row.faults)]
    assert all(fault.problem and fault.hint for fault in every)
    return {fault.name: fault.status for fault in every}


@pytest.fixture
def forged(ran, tmp_path) -> Forgery:
    return Forgery(ran / "flat.zip")


def test_another_process_verifies_a_bundle_and_makes_forms_again(ran, tmp_path):
    """By the command line, in a folder that has nothing but the bundle and the data."""
    words = ("verify", ran / "flat.zip", "--results", tmp_path / "results")
    told = command(*words, "-d", ran / "rods", "--run", "--json")
    assert told.exit_code == 0, told.output
    found = json.loads(told.stdout)
    (row,) = found["rows"]
    assert (found["status"], found["author"], found["licence"]) == ("verified", "Ada <b>", "MIT")
    assert (row["status"], row["holds"], row["compared"], len(row["again"])) == ("verified", "forms", "data", 3)
    assert row["apart"] < 1e-6
    assert row["scores"] == row["told"]
    assert not (tmp_path / "results").exists()


def test_forms_of_something_else_are_found_by_making_them_again(forged, ran, tmp_path):
    """All of the bundle agrees but for the source, whose digest the forger has told, too."""
    other = tmp_path / "flat.py"
    other.write_bytes(forged.plugin.replace(b"0.5", b"0.7"))
    forged.put_source(other.read_bytes())
    forged.record["recipe"]["plugin"]["flat.py"] = digest_of_source(other.read_bytes())
    forged.rekey()
    path = forged.write(tmp_path / "forged.zip")
    assert faults(outcome(path, data=ran / "rods")) == {}
    assert faults(outcome(path, data=ran / "rods", run=True)) == {"not-made-again": "false"}


def test_a_source_that_is_not_that_of_the_records_is_not_run(forged, ran, tmp_path):
    mark = tmp_path / "ran"
    forged.put_source(f"open({str(mark)!r}, 'w')\n".encode() + forged.plugin)
    path = forged.write(tmp_path / "forged.zip")
    assert faults(outcome(path, data=ran / "rods", run=True)) == {"source-differs": "false"}
    assert not mark.exists()


def test_labels_are_those_of_the_data(forged, ran, tmp_path):
    """A careful forger gives the gallery and the record the digests of the labels that he would like."""
    labels = forged.record["labels"]
    labels[0], labels[2] = labels[2], labels[0]
    path = forged.write(tmp_path / "careless.zip")
    assert faults(outcome(path)) == {"inputs-differ": "false", "scores-differ": "false"}
    sources = [
        (n, label, forged.entry["inputs"][n][0]) for n, label in zip(forged.record["shapes"], labels, strict=True)
    ]
    forged.record["recipe"]["gallery"] = digest(sources)
    forged.rekey()
    path = forged.write(tmp_path / "careful.zip")
    assert faults(outcome(path)) == {"scores-differ": "false"}
    assert faults(outcome(path, data=ran / "rods"))["labels-differ"] == "false"


def test_another_folder_of_the_same_name_tells_nothing(ran, tmp_path):
    """Nobody has lied; and forms of other shapes are not asked for."""
    other = write_rods(tmp_path / "rods", bends=(0.0, 1.3))
    found = outcome(ran / "flat.zip", data=other, run=True)
    assert (faults(found), found.rows[0].again) == ({"inputs-differ": "claimed"}, ())
    write_rods(other, bends=(0.0, 1.3, 2.0))
    assert faults(outcome(ran / "flat.zip", data=other, run=True)) == {"shapes-differ": "claimed"}


def test_a_name_of_the_suite_needs_more_than_forms(forged, tmp_path):
    forged.rename("classic-mds")
    assert faults(outcome(forged.write(tmp_path / "plugin.zip")))["name-taken"] == "false"
    del forged.files["plugin/flat.py"]
    forged.manifest["plugin"] = None
    assert faults(outcome(forged.write(tmp_path / "alone.zip"))) == {"not-made-again": "claimed"}


def test_a_set_of_the_catalogue_must_be_that_set(forged, ran, tmp_path):
    forged.record["data"] |= {"name": "tosca", "source": "tosca"}
    forged.record["gallery"] = "tosca"
    assert faults(outcome(forged.write(tmp_path / "tosca.zip"))) == {"gallery-unknown": "claimed"}
    forged.record["data"] |= {"name": "animals", "source": str(ran / "rods")}
    forged.record["gallery"] = "animals"
    assert faults(outcome(forged.write(tmp_path / "animals.zip"))) == {"shapes-differ": "false"}


# Edits ---------------------------------------------------------------------------------------------------------------


def edit_score(forged):
    forged.record["scores"]["NN"] = 0.5


def edit_score_and_queries(forged):
    forged.record["scores"]["NN"] = 0.5
    forged.record["per_query"]["NN"] = [0, 0, 1, 1]


def edit_distances(forged):
    (matrix,) = forged.arrays("distances")
    forged.put_arrays([{"distances": matrix["distances"] * 2}], "distances")


def edit_distances_alone(forged):
    (matrix,) = forged.arrays("distances")
    forged.put_arrays([{"distances": matrix["distances"] * (1 + 1e-9)}], "distances", told=False)


def edit_forms(forged):
    forms = forged.arrays()
    forged.put_arrays([{**forms[0], "vertices": forms[0]["vertices"] * np.float32([1, 2, 1])}, *forms[1:]])


def edit_forms_alone(forged):
    forms = forged.arrays()
    forged.put_arrays([{**forms[0], "vertices": forms[0]["vertices"] * np.float32(1 + 1e-6)}, *forms[1:]], told=False)


def swap_forms(forged):
    forms = forged.arrays()
    forged.put_arrays([forms[3], *forms[1:3], forms[0]])


def swap_inputs(forged):
    inputs = forged.entry["inputs"]
    inputs["thin0"], inputs["thick0"] = inputs["thick0"], inputs["thin0"]


def leave_a_form_out(forged):
    forged.put_arrays(forged.arrays()[:3])


def put_a_nan(forged):
    forms = forged.arrays()
    forms[0]["vertices"][0, 0] = np.nan
    forged.put_arrays(forms)


def name_a_vertex_that_is_not_there(forged):
    forms = forged.arrays()
    forged.put_arrays([{**forms[0], "about:faces": forms[0]["about:faces"] + 10_000}, *forms[1:]])


def put_a_pickle(forged):
    forged.files[f"arrays/{forged.key}.npz"] = object_array(forged.key)


def put_another_source(forged):
    forged.put_source(b"print('hello')\n", told=False)


def put_another_comment(forged):
    forged.put_source(forged.plugin + b"# see http://example.org/virus\n", told=False)


def put_another_source_with_its_digest(forged):
    forged.put_source(b"print('hello')\n")


def put_a_source_that_is_none(forged):
    forged.put_source(b"(" * 10_000)


def name_a_shape_twice(forged):
    forged.record["shapes"][1] = forged.record["shapes"][0]


def be_of_another_method(forged):
    forged.manifest |= {"method": "other", "base_name": "other"}


def claim_another_scorer(forged):
    forged.record["recipe"]["scorer"]["n_shells"] = 3
    forged.rekey()


def leave_the_distances_out(forged):
    del forged.files[f"distances/{forged.key}.npz"]


def be_no_bundle(forged):
    forged.manifest = {"format": "other"}


def lack_a_part(forged):
    del forged.manifest["licence"]


def be_nested(forged):
    forged.files["records/" + "0" * 32 + ".json"] = b"[]"


EDITS = [
    (edit_score, "record-edited", "false"),
    (edit_score_and_queries, "scores-differ", "false"),
    (edit_distances, "distances-differ", "false"),
    (edit_distances_alone, "distances-differ", "false"),
    (edit_forms, "distances-differ", "false"),
    (edit_forms_alone, "forms-differ", "false"),
    (swap_forms, "distances-differ", "false"),
    (swap_inputs, "inputs-differ", "false"),
    (leave_a_form_out, "forms-missing", "false"),
    (put_a_nan, "bad-form", "unreadable"),
    (name_a_vertex_that_is_not_there, "bad-form", "unreadable"),
    (put_a_pickle, "pickle", "unreadable"),
    (put_another_source, "source-differs", "false"),
    (put_another_comment, "source-differs", "false"),
    (put_another_source_with_its_digest, "source-differs", "false"),
    (put_a_source_that_is_none, "source-differs", "false"),
    (name_a_shape_twice, "record-edited", "false"),
    (be_of_another_method, "other-method", "false"),
    (claim_another_scorer, "scores-differ", "false"),
    (leave_the_distances_out, "file-missing", "unreadable"),
    (be_no_bundle, "no-bundle", "unreadable"),
    (lack_a_part, "no-bundle", "unreadable"),
    (be_nested, "unknown-file", "unreadable"),
]


@pytest.mark.parametrize(("edit", "name", "status"), EDITS, ids=lambda value: getattr(value, "__name__", ""))
def test_an_edit_is_found_and_named(forged, tmp_path, edit, name, status):
    edit(forged)
    found = outcome(forged.write(tmp_path / "forged.zip"))
    assert faults(found).get(name) == status, found
    assert found.status == status
    assert not Path("pwned").exists()


def test_a_bundle_that_was_only_packed_again_is_verified(forged, tmp_path):
    assert outcome(forged.write(tmp_path / "same.zip")).status == "verified"


# Files that must not be unpacked -------------------------------------------------------------------------------------


def named(name):
    return lambda archive: archive.writestr(name, b"import os")


def link(archive):
    part = zipfile.ZipInfo("plugin/link.py")
    part.external_attr = (stat.S_IFLNK | 0o777) << 16
    archive.writestr(part, "/etc/passwd")


def twice(archive):
    with pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("bundle.json", b"{}")


def bzip(archive):
    archive.writestr("plugin/packed.py", b"pass", zipfile.ZIP_BZIP2)


FILES = [
    (named("../evil.py"), "path-outside"),
    (named("/etc/evil.py"), "path-outside"),
    (named("plugin/../../evil.py"), "path-outside"),
    (named("plugin\\evil.py"), "path-outside"),
    (named("C:/evil.py"), "path-outside"),
    (named("plugin/.hidden.py"), "unknown-file"),
    (named("setup.cfg"), "unknown-file"),
    (named("plugin/helper.py"), "unknown-file"),  # which the manifest does not name
    (named("BUNDLE.json"), "unknown-file"),
    (named("plugin/FLAT.py"), "name-twice"),
    (link, "link"),
    (twice, "name-twice"),
    (bzip, "no-zip"),
]


@pytest.mark.parametrize(("further", "name"), FILES)
def test_a_file_that_no_bundle_has_is_refused_before_anything_is_read(forged, tmp_path, further, name):
    found = outcome(forged.write(tmp_path / "forged.zip", further))
    assert (faults(found), found.status) == ({name: "unreadable"}, "unreadable")
    assert "''" not in found.faults[0].problem
    assert found.digest


def announced(path: Path, name: bytes, size: int) -> Path:
    """Let the list of files announce another size of one."""
    content = bytearray(path.read_bytes())
    start = content.rindex(name) - 46  # its entry in the list at the end
    assert content[start : start + 4] == b"PK\x01\x02"
    struct.pack_into("<I", content, start + 24, size)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(("size", "name"), [(LARGEST_FILE + 1, "too-large"), (10, "damaged")])
def test_a_bomb_does_not_go_off(forged, tmp_path, size, name):
    """One that says how large it unfolds, and one that says it is small."""
    forged.put_source(b"#" * 20_000_000)
    path = announced(forged.write(tmp_path / "bomb.zip"), b"plugin/flat.py", size)
    assert path.stat().st_size < 100_000
    assert faults(outcome(path)) == {name: "unreadable"}


@pytest.mark.parametrize("content", [b"", b"junk", b"PK\x05\x06" + bytes(18)])
def test_what_is_no_bundle_is_told_so(tmp_path, content):
    path = tmp_path / "junk.zip"
    path.write_bytes(content)
    assert set(faults(outcome(path)).values()) == {"unreadable"}


# Parts ---------------------------------------------------------------------------------------------------------------


def test_signatures_are_looked_at_before_compiled_code_is_given_them():
    fine = {"descriptors": np.zeros((5, 128), np.uint8), "view_offsets": np.full(67, 5, np.int32)}
    fine["view_offsets"][0] = 0
    check_arrays("signatures", "a", fine, ScorerSpec())
    for wrong in (
        {"view_offsets": fine["view_offsets"] + np.int32(1)},
        {"view_offsets": np.where(np.arange(67) == 3, -4, fine["view_offsets"]).astype(np.int32)},
        {"view_offsets": fine["view_offsets"][:-1]},
        {"descriptors": fine["descriptors"].astype(np.float32)},
        {"descriptors": fine["descriptors"][:, :5]},
        {"further": np.zeros(3)},
    ):
        with pytest.raises(BundleError, match="signature"):
            check_arrays("signatures", "a", {**fine, **wrong}, ScorerSpec())


def test_forms_are_compared_after_a_rotation_and_no_reflection():
    points = np.random.default_rng(0).normal(size=(50, 3))
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert rigid_distance(points @ turn + 3, points) < 1e-12
    assert rigid_distance(points * [1, 1, -1], points) > 0.1
    assert rigid_distance(points * 1.1, points) > 0.05


def test_what_is_said_of_a_method_of_the_suite(ran, tmp_path):
    """A descriptor of the suite: a claim where nothing is known of it, verified beside its record."""
    path = tmp_path / "area.zip"
    made = call("submit", "surface-area", "-o", path, "--results", ran / "results")
    assert "rods mesh surface-area: descriptors" in made
    assert faults(outcome(path)) == {"not-made-again": "claimed"}
    found = outcome(path, results=ran / "results")
    assert (found.status, found.rows[0].compared) == ("verified", "records")


@pytest.mark.parametrize(
    ("name", "is_withheld"),
    [("tosca", True), ("tosca[noise=3]", True), ("tosca[decimation=libigl]", True), ("faust", True), ("rods", False)]
    + [("tosca[decimation=unheard-of]", False)]
    + [(name, False) for name in ("animals", "humans[subjects=3,poses=2]", "animals[noise=3]", "camera")],
)
def test_forms_of_official_sets_are_never_passed_on(name, is_withheld):
    record = {"data": {"name": name, "source": name}}
    assert bool(_withheld(record, None, with_forms=True)) == is_withheld


def test_own_data_is_not_passed_on_unless_somebody_says_that_it_may_be(ran, tmp_path):
    path = tmp_path / "signatures.zip"
    made = call("submit", "flat", "--scorer", SCORER, "-o", path, *where(ran))
    assert "signatures and distances alone; rods: nobody has said" in made
    forged = Forgery(path)
    assert {name for arrays in forged.arrays() for name in arrays} == {"energies"}
    found = outcome(path, data=ran / "rods")
    assert (found.status, found.rows[0].holds) == ("verified", "signatures")
    text = json.dumps([forged.manifest, forged.record])
    assert str(ran) not in text


def test_the_data_files_of_a_plugin_travel_and_count(ran, tmp_path):
    """One that it names, one that it opens, and one that does not lie beside it."""
    elsewhere = tmp_path / "elsewhere.txt"
    elsewhere.write_text("1")
    (tmp_path / "plugin" / "data").mkdir(parents=True)
    plugin = tmp_path / "plugin" / "scaled.py"
    plugin.write_text(
        "from pathlib import Path\nfrom benchmark.api import canonical_form\nHERE = Path(__file__).parent\n\n\n"
        "@canonical_form(name='scaled', title='Scaled', inputs=('mesh',), files=('factors.csv',))\n"
        "def scaled(shape):\n"
        "    factors = [float(text) for text in (HERE / 'factors.csv').read_text().split(',')]\n"
        f"    power = float(Path({str(elsewhere)!r}).read_text())\n"
        "    return shape.mesh.vertices * factors * float((HERE / 'data' / 'one.txt').read_text()) ** power\n"
    )
    (plugin.parent / "factors.csv").write_text("1, 1, 0.5")
    (plugin.parent / "data" / "one.txt").write_text("1")
    of_run = ("-d", ran / "rods", "--input", "mesh", "--executor", "serial", "--scorer", SCORER)
    of_both = ("--plugin", plugin, "--results", tmp_path / "results")
    call("run", "-m", "scaled", *of_run, *of_both)
    made = call("submit", "scaled", "--scorer", SCORER, "--forms", "-o", tmp_path / "scaled.zip", *of_both)
    assert f"omitted {elsewhere}: it is not next to the plugin" in made
    with zipfile.ZipFile(tmp_path / "scaled.zip") as archive:
        names = {name for name in archive.namelist() if name.startswith("plugin/")}
    assert names == {"plugin/scaled.py", "plugin/factors.csv", "plugin/data/one.txt"}
    found = outcome(tmp_path / "scaled.zip", data=ran / "rods", run=True)
    assert (found.status, len(found.rows[0].again)) == ("verified", 3), found
    forged = Forgery(tmp_path / "scaled.zip", "plugin/factors.csv")
    forged.put_source(b"1, 1, 0.6")
    assert faults(outcome(forged.write(tmp_path / "forged.zip"))) == {"source-differs": "false"}
