import pytest

from benchmark.errors import ConfigurationError, DatasetError
from benchmark.protocols.tables import QUICK_POSES, TABLES, galleries
from benchmark.reference import paper
from retrieval.chance import chance_levels
from tests.toy import write_rods


def test_without_data_the_stand_ins_run_and_say_so():
    first, second, third, held_out, *ablation = galleries()
    assert (first.table.identifier, first.dataset.name, first.dataset.stand_in_for) == (
        "I",
        "humans",
        "shrec14-synthetic",
    )
    assert (third.table.identifier, third.dataset.name, third.dataset.stand_in_for) == ("III", "animals", "tosca")
    assert (second.table.identifier, second.dataset.name, second.dataset.stand_in_for) == (
        "II",
        "humans-scanlike",
        "shrec14-real",
    )
    assert [len(gallery.entries) for gallery in (first, second, third, held_out)] == [100, 400, 80, 19]
    assert {gallery.table.identifier for gallery in ablation} == {"IV"}
    assert {entry.subject for entry in first.entries} == {entry.subject for entry in first.dataset.entries[200:]}


@pytest.mark.data
def test_official_data_replaces_its_stand_in_and_is_never_mixed_with_it(data_root):
    third, held_out = galleries(["III"], data_root=data_root)
    assert {entry.subject for entry in held_out.entries} == {"cat", "horse"}
    assert (third.dataset.name, third.dataset.stand_in_for, len(third.entries)) == ("tosca", "", 80)
    assert len({entry.subject for entry in third.entries}) == 9
    assert {named.dataset.name for named in galleries(["III"], ["animals"], data_root)} == {"animals"}


def test_quick_thins_the_poses_of_each_subject_evenly():
    (gallery,) = galleries(["I"], quick=True)
    poses = [entry.pose for entry in gallery.entries if entry.subject == gallery.entries[0].subject]
    assert 2 < len(poses) <= QUICK_POSES
    assert poses[0] == gallery.dataset.entries[0].pose
    assert gallery.name.endswith("(quick)")
    assert [gallery.table.identifier for gallery in galleries(quick=True)] == ["I", "III"]
    assert [gallery.table.identifier for gallery in galleries(["III"], quick=True)] == ["III"]


def test_a_set_brings_all_its_tables_and_in_quick_runs_the_main_one():
    def tables(name, **options):
        return [gallery.table.identifier for gallery in galleries([], [name], **options)]

    assert tables("animals") == ["III", "III-held-out"]
    assert tables("animals", quick=True) == ["III"]
    assert tables("humans") == ["I", "IV", "IV", "IV", "IV"]
    assert tables("humans-scanlike", quick=True) == ["II"]


def test_cats_and_horses_alone_have_their_own_level_of_chance():
    (held_out,) = galleries(["III-held-out"])
    chance = chance_levels([entry.subject for entry in held_out.entries])
    assert [round(chance[name], 3) for name in ("NN", "FT", "ST", "DCG")] == [0.485, 0.485, 0.906, 0.729]


def test_a_folder_gets_a_table_of_its_own(tmp_path):
    folder = write_rods(tmp_path / "rods")
    (gallery,) = galleries([], [str(folder)])
    assert (gallery.table.identifier, len(gallery.entries)) == ("rods", 6)
    assert paper.rows("rods") == {}


@pytest.mark.parametrize(
    ("tables", "datasets", "error", "message"),
    [
        (["V"], [], ConfigurationError, "unknown table 'V'"),
        (["III-held-uot"], [], ConfigurationError, "unknown table 'III-held-uot'; did you mean III-held-out"),
        ([], ["tosk"], ConfigurationError, "unknown data set 'tosk'; did you mean tosca"),
        ([], ["tosca"], DatasetError, "is not at DATA_ROOT/tosca; put it there"),
        (["I"], ["animals"], ConfigurationError, "no selected table uses animals"),
        ([], ["./nowhere"], ConfigurationError, "is not a folder"),
    ],
)
def test_what_cannot_be_selected_is_named(tables, datasets, error, message):
    with pytest.raises(error, match=message):
        galleries(tables, datasets)


def test_every_table_of_the_paper_has_rows_with_all_measures():
    for table in TABLES:
        rows = paper.rows(table.identifier)
        assert next(iter(rows), "") == {"III-held-out": "", "IV": "learned-strict"}.get(table.identifier, "classic-mds")
        assert all(set(row.values[table.identifier]) == set(paper.METRICS) for row in rows.values())
    assert paper.rows("I")["gps"].values["I"] == {"NN": 0.40, "FT": 0.20, "ST": 0.32, "DCG": 0.56}
    assert list(paper.rows("IV")) == ["learned-strict", "learned-without-srf", "learned-without-lrf", "learned"]
