"""Known copies of official sets: told by content, and of the size that their list states."""

from dataclasses import replace

import pytest

from benchmark.datasets.changes import with_change
from benchmark.datasets.checking import check_dataset
from benchmark.datasets.copies import KnownCopy
from benchmark.datasets.official import SETS
from benchmark.datasets.sizes import scaled_to_area
from benchmark.files import file_digest
from tests.datasets.official.layouts import write_tetrahedron
from tests.report.records import record
from tools.publish import has_pictures

LISTED = [(name, copy) for name, known in SETS.items() for copy in known.copies]


@pytest.mark.parametrize(("name", "copy"), LISTED, ids=lambda value: getattr(value, "files", value))
def test_a_list_has_a_digest_for_each_shape_and_none_twice(name, copy):
    assert len(copy.digests) == len({*copy.digests.values()}) == SETS[name].n_shapes
    assert {len(digest) for digest in copy.digests.values()} == {64}


@pytest.fixture
def faust(damaged, tmp_path, monkeypatch):
    """A set whose files are all those of a known copy without sizes; its folder, and how to open
    it.
    """
    folder = damaged("faust")
    files = [entry.path for entry in SETS["faust"].open("faust", folder).shapes]
    lines = [f"{file_digest(path)}  {path.name}" for path in files]
    (tmp_path / "made.sha256").write_text("\n".join(lines))
    copy = KnownCopy(title="FAUST, made", files=str(tmp_path / "made.sha256"), area=1.8)
    made = replace(SETS["faust"], copies=(copy,))
    monkeypatch.setitem(SETS, "faust", made)
    return files, lambda: made.open("faust", folder)


def change(path, size=7.0):
    path.unlink()  # it is a link to what other tests read
    write_tetrahedron(path, size)


def test_surfaces_of_files_without_size_get_their_area_and_other_files_keep_theirs(faust):
    files, opened = faust
    change(files[7])
    shapes = opened()
    listed, other = shapes.shapes[0], shapes.shapes[7]
    assert shapes.load(listed).area == pytest.approx(1.8)
    assert shapes.key(listed) == f"{file_digest(listed.path)} scaled to area 1.8"
    assert shapes.load(other).area != pytest.approx(1.8)
    assert shapes.key(other) == file_digest(other.path)
    views = with_change(shapes, "cameras", 1)
    assert set(views.code(views.shapes[0])) > set(shapes.code(listed))
    assert scaled_to_area.__module__ not in views.code(views.shapes[7])


def checked(shapes):
    """First line of the check of a set, and what it says of copies."""
    report = check_dataset(shapes)
    said = [one for one in report.anomalies if "SHA-256" in one.what]
    return report.lines()[0].partition("classes, ")[2], said


def test_a_check_names_the_copy(faust):
    assert checked(faust[1]()) == ("FAUST, made (SHA-256 of all 100 files)", [])


def test_a_check_names_the_one_file_that_was_changed(faust):
    files, opened = faust
    change(files[7])
    title, (said,) = checked(opened())
    assert title == "files named like FAUST registrations, unverified"
    assert [said.files[0].rpartition("/")[2]] == [files[7].name]
    assert said.what == "its SHA-256 is not that of the file in 'FAUST, made'"


def test_a_check_says_that_other_meshes_are_unverified(faust):
    files, opened = faust
    for number, path in enumerate(files):
        change(path, 3 + number / 1000)
    title, (said,) = checked(opened())
    assert title == "files named like FAUST registrations, unverified"
    assert said.what.startswith("no file has the SHA-256 of a known copy: tables say 'files named")


def test_a_file_under_the_name_of_another_is_not_that_of_the_copy(faust):
    files, opened = faust
    content = files[0].read_bytes()
    files[1].unlink()
    files[1].write_bytes(content)
    _, (said,) = checked(opened())
    assert [said.files[0].rpartition("/")[2]] == [files[1].name]


def test_no_picture_of_people_whose_terms_forbid_it_is_published():
    assert not has_pictures(record("gps", dataset="faust"))
    assert not has_pictures(record("gps", dataset="faust[cameras=12]"))
    assert has_pictures(record("gps", dataset="tosca"))
    assert has_pictures(record("gps", dataset="rods"))
