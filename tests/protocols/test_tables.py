from dataclasses import replace

import pytest

from benchmark.errors import ConfigurationError, DatasetError
from benchmark.plugins import registry
from benchmark.protocols.galleries import QUICK_POSES, galleries
from benchmark.protocols.tables import ABLATION, TABLES, Rows
from benchmark.protocols.trainings import trainings_by_shape
from benchmark.reference import paper
from retrieval.measures import PRINTED
from tests import mean_folds, mean_target
from tests.toy import rod, write_off, write_rods


def test_without_data_the_stand_ins_run_and_say_so():
    first, *_, second, third, held_out = galleries(["I", "II", "III"])
    assert [
        (gallery.table.identifier, gallery.dataset.name, gallery.dataset.stand_in_for, len(gallery.entries))
        for gallery in (first, second, third, held_out)
    ] == [
        ("I", "humans", "shrec14-synthetic", 100),
        ("II", "humans-scanlike", "shrec14-real", 400),
        ("III", "animals", "tosca", 80),
        ("III-held-out", "animals", "tosca", 19),
    ]


def test_tables_of_synthetic_humans_have_a_gallery_for_each_fold_of_the_subjects():
    chosen = galleries()
    between = ["I-whole", "I-printed", "I-printed", *["I-random"] * 3, "II", "III", "III-held-out"]
    assert [gallery.table.identifier for gallery in chosen] == ["I"] * 3 + between + ["IV"] * 3
    for folds in chosen[:3], chosen[-3:]:
        assert [gallery.name for gallery in folds] == [f"humans fold {k}" for k in range(3)]
        assert [len(gallery.entries) for gallery in folds] == [100, 100, 100]
        assert [len({entry.subject for entry in gallery.entries}) for gallery in folds] == [5, 5, 5]
        assert len({entry.identifier for gallery in folds for entry in gallery.entries}) == 300
    assert [gallery.entries for gallery in chosen[:3]] == [gallery.entries for gallery in chosen[-3:]]
    assert [gallery.part for gallery in chosen[3:9]] == ["", "fold 0", "fold 1", "", "", ""]
    # By hand: places 0, 5, 7, 9, 14 of the set.
    first = ["man-1", "child-2", "woman-3", "child-4", "woman-5"]
    assert list(dict.fromkeys(entry.subject for entry in chosen[0].entries)) == first


def test_the_official_synthetic_humans_have_the_same_folds(tmp_path):
    folder = tmp_path / "shrec14" / "synthetic"
    folder.mkdir(parents=True)
    for number in range(300):
        (folder / f"{number}.off").touch()
    *folds, whole, first, second = galleries(["I"], data_root=tmp_path)
    assert [first.entries, second.entries] == [gallery.entries for gallery in folds[:2]]
    assert (whole.name, len(whole.entries)) == ("shrec14-synthetic", 300)
    assert [gallery.name for gallery in folds] == [f"shrec14-synthetic fold {k}" for k in range(3)]
    assert [list(dict.fromkeys(entry.subject for entry in gallery.entries)) for gallery in folds] == [
        ["0", "5", "7", "9", "14"],
        ["1", "3", "8", "10", "12"],
        ["2", "4", "6", "11", "13"],
    ]
    models = trainings_by_shape(mean_target.MeanTarget(), folds[1].dataset, folds[1].entries, tmp_path)
    assert {training.name for training in models.values()} == {"shrec14-synthetic-fold-1"}


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
    assert 1 < len(poses) <= QUICK_POSES
    assert poses[0] == gallery.dataset.shapes[0].pose
    assert (gallery.name, len(gallery.entries)) == ("humans fold 0 (quick)", 15)
    assert [gallery.table.identifier for gallery in galleries(quick=True)] == ["I", "III"]
    assert [gallery.table.identifier for gallery in galleries(["III"], quick=True)] == ["III"]


def test_a_set_brings_all_its_tables_and_in_quick_runs_the_main_one():
    def tables(name, **options):
        return [gallery.table.identifier for gallery in galleries([], [name], **options)]

    assert tables("animals") == ["III", "III-held-out"]
    assert tables("animals", quick=True) == ["III"]
    assert tables("humans") == ["I"] * 3 + ["I-whole", "I-printed", "I-printed"] + ["IV"] * 3
    assert tables("humans", quick=True) == ["I"]
    assert tables("humans-scanlike", quick=True) == ["II"]


def test_a_folder_may_be_called_like_a_known_set_or_a_table_and_is_neither(tmp_path):
    for name, table in (("humans", "humans-folder"), ("tosca", "tosca-folder"), ("III", "III-folder")):
        (gallery,) = galleries([], [str(write_rods(tmp_path / name))])
        assert (gallery.table.identifier, gallery.dataset.name) == (table, table.replace("III-folder", "III"))
        assert gallery.table.folds == ()
        trainings = trainings_by_shape(mean_target.MeanTarget(), gallery.dataset, gallery.entries, None)
        assert {training.name for training in trainings.values()} == {"humans-fold-0"}


def test_a_table_is_left_out_where_a_partial_set_lacks_its_classes(tmp_path):
    for number in range(2):
        write_off(tmp_path / "tosca" / f"dog{number}.off", rod(0.1, number))
        write_off(tmp_path / "tosca" / f"cat{number}.off", rod(0.2, number))
    assert [gallery.table.identifier for gallery in galleries(["III"], data_root=tmp_path)] == ["III"]
    with pytest.raises(DatasetError, match=r"what this table ranks of data set 'tosca' has one class \('cat'\)"):
        galleries(["III-held-out"], data_root=tmp_path)
    for path in (tmp_path / "tosca").glob("cat*"):
        path.rename(path.with_name(path.name.replace("cat", "david")))
    assert [gallery.table.identifier for gallery in galleries(["III"], data_root=tmp_path)] == ["III"]
    with pytest.raises(DatasetError, match="what this table ranks of data set 'tosca' has no meshes"):
        galleries(["III-held-out"], data_root=tmp_path)


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
    first_rows = dict.fromkeys(("I", "II", "III"), "classic-mds") | {"IV": "learned-strict"}
    for table in TABLES:
        rows = paper.rows(table.identifier)
        assert next(iter(rows), "") == first_rows.get(table.identifier, "")
        assert all(set(row.values[table.identifier]) == set(PRINTED) for row in rows.values())
    assert paper.rows("I")["gps"].values["I"] == {"NN": 0.40, "FT": 0.20, "ST": 0.32, "DCG": 0.56}
    assert list(paper.rows("IV")) == ["learned-strict", "learned-without-srf", "learned-without-lrf", "learned"]


def specs(*names):
    return registry.select(names, registry.methods([mean_target.PLUGIN_PATH, mean_folds.PLUGIN_PATH]))


def rows(gallery, *methods, trained_here=None):
    return [spec.name for spec in gallery.rows(specs(*methods), trained_here)]


def test_a_row_of_the_ablation_has_a_seed_where_the_fold_has_its_model(tmp_path):
    for name in "humans-fold-0/plain-seed2", "humans-fold-1/plain-seed1", "humans-fold-0/other-seed1":
        mean_target.write_model(tmp_path / name, 0.5)
    first, second, third = galleries(["IV"])

    def of(gallery, *methods):
        return rows(gallery, *methods, trained_here=tmp_path)

    assert of(first, "mean-target", "mean-strict", "mean-sampled", "gps") == [
        "mean-target",
        "mean-target[training_seed=2]",
        "mean-strict",
    ]
    assert of(second, "mean-target") == ["mean-target", "mean-target[training_seed=1]"]
    # The plain method is always there: without a model, its job says which command makes it.
    assert of(third, "mean-target") == ["mean-target"]
    assert of(first, "mean-target[training_seed=1]") == ["mean-target[training_seed=1]"]
    assert of(first, "mean-target[configuration=other]")[1:] == ["mean-target[configuration=other,training_seed=1]"]
    assert of(first, "mean-target[training=nothing]") == ["mean-target[training=nothing]"]
    assert of(galleries(["I"])[0], "mean-target") == ["mean-target"]


def test_methods_of_the_ablation_are_in_other_tables_only_when_named():
    table_one, *_ = galleries(["I"])
    known = registry.select([], registry.methods())
    unasked = [spec.name for spec in table_one.rows(known)]
    assert "learned" in unasked
    assert not ABLATION - {"learned"} & set(unasked)
    asked = registry.select(["learned-without-srf"], registry.methods())
    assert [spec.name for spec in table_one.rows(asked)] == ["learned-without-srf"]
    for gallery in galleries(["IV"]):
        printed = {spec.base_name for spec in gallery.rows(known)}
        assert printed == ABLATION


def test_a_further_training_has_a_row_on_its_set_where_there_is_a_model(tmp_path):
    further = {"mean-target": ("people-fold-1", "animals-sampled"), "mean-sampled": ("animals-III",)}
    known = registry.select([], registry.methods([mean_target.PLUGIN_PATH, mean_folds.PLUGIN_PATH]))

    def of(gallery):
        return [spec.name for spec in gallery.rows(known, tmp_path) if spec.base_name.startswith("mean-")]

    further_rows = Rows(trainings={"animals": further})
    whole, held_out = (
        replace(gallery, table=replace(gallery.table, rows=further_rows))
        for gallery in galleries(["III", "III-held-out"])
    )
    without = of(whole)
    for name in ("people-fold-1", "animals-sampled", "animals-III"):
        mean_target.write_model(tmp_path / name / "plain-seed0", 0.5)
    added = [f"mean-target[training={name}]" for name in ("people-fold-1", "animals-sampled")]
    # A learner that has no row of its own there, as its training is another, has this one all the same.
    assert of(whole) == of(held_out) == [*without, *added, "mean-sampled[training=animals-III]"]
    assert not any("training" in name for name in of(galleries(["I"])[0]))
    assert rows(whole, "mean-target", trained_here=tmp_path) == ["mean-target"]
