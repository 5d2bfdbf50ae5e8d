"""Which galleries and rows the tables have."""

import pytest

from benchmark.api.learning import CARD
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.protocols.galleries import QUICK_ROWS, galleries
from benchmark.protocols.tables import (
    ABLATION,
    CONTROLS,
    QUICK_POSES,
    SYNTHETIC_HUMANS,
    TABLES,
    TITLES,
)
from benchmark.protocols.trainings import trainings_by_shape
from benchmark.reference import paper
from benchmark.registry import by_name, select, select_one
from benchmark.runs.planning import gallery_facts, plan_selection
from tests.toy import write_rods

FIRST = SYNTHETIC_HUMANS[0]


def names(*arguments, **options):
    return [(g.table.identifier, g.name, *g.inputs) for g in galleries(*arguments, **options)]


def test_without_data_the_stand_ins_run_and_say_so():
    chosen = {
        gallery.table.identifier: gallery.dataset for gallery in galleries(["I", "II", "III"])
    }
    assert {name: shapes.stand_in_for for name, shapes in chosen.items()} == {
        "I": "shrec14-synthetic",
        "I-view": "shrec14-synthetic",
        "II": "shrec14-real",
        "II-view": "shrec14-real",
        "III": "tosca",
        "III-view": "tosca",
    }


@pytest.mark.parametrize("sets", [["faust"], ["animals", "faust"]])
def test_an_absent_set_that_was_named_is_refused_though_its_tables_accompany_others(sets, tmp_path):
    with pytest.raises(DatasetError, match="faust"):
        galleries([], sets, tmp_path)


def test_classical_rows_of_table_one_see_surfaces_of_both_galleries_and_networks_one_view():
    found = names(["I"])
    assert {("I", name, "mesh") for name in SYNTHETIC_HUMANS[1:]} <= {*found}
    assert {
        ("I", name, "mesh", "view") for name in (FIRST, *(f"{FIRST} fold {k}" for k in range(3)))
    } <= {*found}
    assert ("I-view", f"{FIRST} fold 1", "view") in found
    assert {name for table, name, *_ in found if table == "I-view"} == {
        FIRST,
        *(f"{FIRST} fold {k}" for k in range(3)),
    }


def test_official_data_replace_the_stand_in(tmp_path):
    write_rods(tmp_path / "tosca", radii={"cat": 0.06, "horse": 0.1, "dog": 0.18})
    chosen = galleries(["III"], data_root=tmp_path)
    assert {gallery.dataset.name for gallery in chosen} == {"tosca"}
    (alone,) = (gallery for gallery in chosen if gallery.part)
    assert {entry.subject for entry in alone.entries} == {"cat", "horse"}


def test_a_companion_without_its_classes_is_left_out_unless_it_is_named(tmp_path):
    write_rods(tmp_path / "tosca", radii={"cat": 0.06, "dog": 0.18})
    assert {name for name, *_ in names(["III"], data_root=tmp_path)} == {"III"}
    with pytest.raises(DatasetError):
        galleries(["III-view"], data_root=tmp_path)


def test_a_quick_run_has_one_fold_and_few_poses():
    chosen = galleries(quick=True)
    assert {gallery.name for gallery in chosen} == {f"{FIRST} fold 0 (quick)", "animals (quick)"}
    for gallery in chosen:
        poses = [
            sum(e.subject == subject for e in gallery.entries)
            for subject in {e.subject for e in gallery.entries}
        ]
        assert max(poses) <= QUICK_POSES
    with pytest.raises(ConfigurationError, match="mean over all folds"):
        galleries(["IV"], quick=True)


def test_a_quick_run_is_one_whatever_it_leaves_out(rods, tmp_path):
    """Few poses in a folder, or of queries in a large gallery, make it no full run."""
    (own,) = galleries([], [str(rods)], quick=True, input="mesh")
    assert own.name == "rods (quick)"
    assert {*rows(own, "mesh")} <= {*QUICK_ROWS}
    large = write_rods(tmp_path / "large", bends=(0.0, 0.5, 1.0, 1.5))
    (of_queries,) = galleries([], [str(rods)], gallery=str(large), quick=True, input="mesh")
    other = of_queries.gallery_of_queries
    assert len(other.entries) < len(other.dataset.shapes)
    assert of_queries.name == "rods against large (quick)"


def test_a_folder_gets_its_own_table_with_both_inputs(rods, tmp_path):
    write_rods(tmp_path / "III")
    assert names([], [str(rods)]) == [("rods", "rods", "mesh"), ("rods", "rods", "view")]
    assert {name for name, *_ in names([], [str(tmp_path / "III")])} == {"III-folder"}


@pytest.mark.parametrize(
    ("tables", "sets", "options", "message"),
    [
        (["III"], ["animals", "rods"], {}, "no selected table uses .*rods"),
        ([], ["rods", "frames"], {"input": "mesh"}, "'frames' has no complete surfaces"),
        ([], ["rods", "animals"], {"subjects": ["thin", "thick"]}, "unknown subject 'thin'"),
    ],
)
def test_a_data_set_of_which_nothing_is_selected_is_refused_beside_others_in_any_order(
    tables, sets, options, message, rods, frames
):
    folders = {"rods": str(rods), "frames": str(frames)}
    named = [folders.get(name, name) for name in sets]
    for order in (named, named[::-1]):
        with pytest.raises(ConfigurationError, match=message):
            galleries(tables, order, **options)


# Rows
# ------------------------------------------------------------------------------------------------


def rows(gallery, input_, *chosen, named=False):
    return [component.name for component in gallery.rows(input_, select(chosen, ()), named=named)]


def gallery(identifier, **options):
    return next(
        gallery
        for gallery in galleries([identifier], **options)
        if gallery.table.identifier == identifier
    )


def test_networks_have_rows_where_views_are_and_all_others_on_surfaces():
    others, networks = rows(gallery("III"), "mesh"), rows(gallery("III"), "view")
    assert {*paper.CLASSICAL, "identity", "shape-dna"} <= {*others}
    assert not any(name.startswith("learned") for name in others)
    assert "learned" in networks
    assert not {*paper.CLASSICAL} & {*networks}


def test_forms_that_the_paper_does_not_compare_have_rows_on_animals_alone():
    forms = [method for method in select(["all"]) if not method.learns]
    extended = {method.name for method in forms if method.info.family == "extended"}
    assert {"accelerated-mds", "feature-preserved"} <= extended
    assert extended <= {*rows(gallery("III"), "mesh")}
    for identifier in ("I", "II", "I-view"):
        input_ = "view" if identifier == "I-view" else "mesh"
        assert not extended & {*rows(gallery(identifier), input_)}
        assert {*paper.CLASSICAL} <= {*rows(gallery(identifier), input_)}


def test_ablations_have_rows_in_table_four_alone():
    found = {name.partition("[")[0] for name in rows(gallery("IV"), "view")}
    assert {"learned", "learned-without-srf", "learned-without-lrf"} <= found <= {*ABLATION}
    assert not {"learned-strict", "learned-without-srf"} & {*rows(gallery("I"), "view")}
    controls = {*CONTROLS} <= found and {*CONTROLS} <= {*rows(gallery("I-view"), "view")}
    assert controls and not {*CONTROLS} & {
        *rows(gallery("I"), "view"),
        *rows(gallery("II-view"), "view"),
    }


def test_a_method_that_is_named_has_a_row_everywhere():
    assert rows(gallery("IV"), "view", "gps", named=True) == []
    quick = gallery("III", quick=True)
    data = gallery_facts(quick, "mesh")["data"]
    assert (data["quick"], data["n_shapes"]) == (True, len(quick.dataset.shapes))
    assert rows(quick, "mesh", "shape-dna") == []
    assert rows(quick, "mesh", "shape-dna", named=True) == ["shape-dna"]


def test_forms_that_the_paper_does_not_compare_run_by_default_on_animals_and_own_sets_alone(rods):
    own = next(iter(galleries([], [str(rods)])))
    assert "feature-preserved" in rows(gallery("III"), "mesh") and "feature-preserved" in rows(
        own, "mesh"
    )
    humans = {name for table in ("I", "II") for name in rows(gallery(table), "mesh")}
    assert not {"feature-preserved", "accelerated-mds"} & humans
    assert rows(gallery("I"), "mesh", "accelerated-mds", named=True)


def test_the_network_has_rows_for_each_seed_and_as_printed_where_these_have_models(tmp_path):
    fold = next(chosen for chosen in galleries(["I-view"]) if chosen.part)
    of_shape = trainings_by_shape(select_one("learned").create(), fold.dataset, fold.entries, None)
    for name in ("literal-seed1", "as_printed-seed0"):
        place = tmp_path / next(iter(of_shape.values())).name / name
        place.mkdir(parents=True)
        (place / CARD).touch()

    def found(*names):
        chosen = select(names, ())
        return [component.name for component in fold.rows("view", chosen, tmp_path, named=True)]

    every = ["learned", "learned[training_seed=1]", "learned[configuration=as_printed]"]
    assert found("learned") == every
    # A training that is named is that one alone, be its parameters the defaults.
    assert found("learned[training_seed=0]") == ["learned"]
    assert found("learned[configuration=literal]") == ["learned"]
    assert found("learned[training_seed=1]") == ["learned[training_seed=1]"]
    assert found("learned[training_seed=0]", "learned") == every
    assert found("learned", "learned[training_seed=0]") == every


def test_every_row_of_the_paper_is_a_method_with_a_title():
    known = by_name("method")
    for table in TABLES:
        if table.has_paper:
            assert all(
                name.partition("[")[0] in known and name in TITLES
                for name in paper.PRINTED[table.identifier]
            )


def test_a_model_that_saw_the_test_shapes_has_no_row_where_none_may_have(tmp_path):
    seen, options = f"learned[training={FIRST.partition('[')[0]}-fold-1]", {"input": "view"}
    job, *_ = plan_selection(tmp_path, tables=["IV"], methods=[seen], **options)
    assert (job.record.gallery, job.state) == (f"{FIRST} fold 0", "unsupported")
    assert "100 shapes were seen in training" in job.reason
    allowed, *_ = plan_selection(tmp_path, tables=["III"], methods=["learned"], **options)
    assert allowed.record.seen and allowed.state == "missing"
