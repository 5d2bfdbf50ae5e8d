"""What data are called: published records by their content, and others by what they are not."""

from pathlib import Path

import msgspec
import pytest

from benchmark.datasets.copies import KnownCopy
from benchmark.pipeline.record_files import read_records
from benchmark.report.data_titles import data_title, known_copy
from benchmark.report.tables import table_views
from tests.report.records import record

RESULTS = Path(__file__).parents[2] / "results"
COPY = "TOSCA, re-meshed to 5 000 vertices"


@pytest.fixture(scope="module")
def of_tosca():
    every = read_records(RESULTS, local=False)
    return {(r.gallery, r.input): r for r in every if r.data.name.startswith("tosca")}


def test_every_published_record_of_tosca_ranks_the_known_copy(of_tosca):
    """Whole sets, parts, turned views, and queries of other galleries, seen once or from around."""
    assert len(of_tosca) >= 13
    for (gallery, _), one in of_tosca.items():
        assert data_title(one).startswith(COPY), gallery
    turned = of_tosca["tosca[view-angle=3]", "view"]
    assert data_title(turned) == f"{COPY}, view angle: largest angle in degrees 30"


@pytest.mark.parametrize("field", ["gallery_digest", "shapes", "labels"])
def test_a_record_of_other_shapes_is_not_that_copy(of_tosca, field):
    one = of_tosca["tosca", "mesh"]
    other = {"gallery_digest": "0" * 32, "shapes": one.shapes[::-1], "labels": one.labels[::-1]}
    changed = msgspec.structs.replace(one, **{field: other[field]})
    assert known_copy(changed) is None
    assert data_title(changed) == "files named like TOSCA, unverified"


def test_another_gallery_is_not_that_of_the_copy(of_tosca):
    one = of_tosca["tosca against 12 cameras", "view"]
    for name, value in {"views": 11, "gallery_digest": "0" * 32}.items():
        against = msgspec.structs.replace(one.gallery_of_queries, **{name: value})
        assert known_copy(msgspec.structs.replace(one, gallery_of_queries=against)) is None


def test_a_part_of_the_files_is_that_copy(of_tosca):
    """The digest of fewer files follows from theirs, so missing ones do not hide which copy."""
    assert known_copy(of_tosca["tosca held out", "view"]) is known_copy(of_tosca["tosca", "mesh"])


def test_tables_say_which_copy_it_is_or_that_nobody_knows():
    (view,) = table_views([record("gps", dataset="tosca")])
    assert "files named like TOSCA, unverified" in view.caption
    (view,) = table_views([record("gps", dataset="faust")])
    assert "files named like FAUST registrations, unverified" in view.caption


def test_a_folder_or_a_stand_in_is_called_by_its_name():
    assert data_title(record("gps")) == "rods"
    stand_in = record("gps", dataset="animals", stand_in_for="tosca")
    assert data_title(stand_in) == "generated stand-in 'animals', not TOSCA"


def test_a_list_is_read_without_regard_to_case(tmp_path):
    (tmp_path / "made.sha256").write_text(f"{'a' * 64}  Cat0.off\n")
    copy = KnownCopy(title="made", files=str(tmp_path / "made.sha256"))
    assert copy.has("cat0", "a" * 64)
    assert not copy.has("cat1", "a" * 64)
