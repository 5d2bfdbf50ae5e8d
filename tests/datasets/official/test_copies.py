"""Known copies of official sets: told by content, and of the size that their list states."""

from dataclasses import replace

import pytest

from benchmark.datasets.copies import KnownCopy
from benchmark.datasets.official import SETS
from benchmark.files import file_digest
from tests.report.records import record
from tools.publish import has_pictures

LISTED = [(name, copy) for name, known in SETS.items() for copy in known.copies]


@pytest.mark.parametrize(("name", "copy"), LISTED, ids=lambda value: getattr(value, "files", value))
def test_a_list_has_a_digest_for_each_shape_and_none_twice(name, copy):
    assert len(copy.digests) == len({*copy.digests.values()}) == SETS[name].n_shapes
    assert {len(digest) for digest in copy.digests.values()} == {64}


def test_surfaces_of_files_without_size_get_their_area_and_other_files_keep_theirs(sets, tmp_path):
    files = [entry.path for entry in SETS["faust"].open("faust", sets / "faust").shapes]
    lines = [f"{file_digest(path)}  {path.name}" for path in files if path.stem != "tr_reg_007"]
    (tmp_path / "made.sha256").write_text("\n".join(lines))
    copy = KnownCopy(title="made", files=str(tmp_path / "made.sha256"), area=1.8)
    shapes = replace(SETS["faust"], copies=(copy,)).open("faust", sets / "faust")
    listed, other = shapes.shapes[0], shapes.shapes[7]
    assert shapes.load(listed).area == pytest.approx(1.8)
    assert shapes.key(listed) == f"{file_digest(listed.path)} scaled to area 1.8"
    assert shapes.load(other).area != pytest.approx(1.8)
    assert shapes.key(other) == file_digest(other.path)


def test_no_picture_of_people_whose_terms_forbid_it_is_published():
    assert not has_pictures(record("gps", dataset="faust"))
    assert not has_pictures(record("gps", dataset="faust[cameras=12]"))
    assert has_pictures(record("gps", dataset="tosca"))
    assert has_pictures(record("gps", dataset="rods"))
