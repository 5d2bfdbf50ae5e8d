"""Rows, means, marks and notes of tables, by hand."""

import json
import random
import re
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from benchmark.api.learning import CARD
from benchmark.pipeline.record_files import write_record
from benchmark.protocols.published_models import published_files
from benchmark.protocols.tables import (
    FROZEN,
    RECIPE,
    RECIPE_AS_PRINTED,
    SYNTHETIC_HUMANS,
    TITLES,
)
from benchmark.reference.paper import AS_PRINTED, PAPER_MEASURES, PRINTED
from benchmark.registry import select_one
from benchmark.report.columns import PRINTED_QUANTITIES, score_groups
from benchmark.report.formats import as_json, blocks, latex, markdown, robustness_markdown
from benchmark.report.notation import hundredths, two_decimals, two_digits
from benchmark.report.notes import block_lead, leads, table_notes
from benchmark.report.output import table_files
from benchmark.report.record_facts import chosen_records
from benchmark.report.results import Results
from benchmark.report.tables import table_views
from learned.fitting import DEFAULTS
from learned.training import Schedule
from tests.report.records import LABELS, failed, record
from tests.verbs import call

HUMANS = {"dataset": SYNTHETIC_HUMANS[0], "stand_in_for": "shrec14-synthetic"}


def view(*records, **options):
    (only,) = table_views(records, **options)
    return only


def cell(table, method, column="mesh"):
    (row,) = (row for row in table.rows if row.method == method)
    return round(table.scores(row, column)["NN"], 6)


def marks(table, column="mesh"):
    """Mark of NN by method; "" for a row that is no rival."""
    return {
        row.method: table.marks.get((row.method, column), {}).get("NN", "") for row in table.rows
    }


def test_a_row_is_the_mean_of_its_folds_and_a_missing_fold_counts_0():
    folds = [record("gps", 0.9, fold=f"fold {k}", **HUMANS) for k in range(3)]
    table = view(
        *folds, *[record("skeleton", 0.6, fold=f"fold {k}", **HUMANS) for k in (0, 2)], tables=["I"]
    )
    assert cell(table, "gps", "5 subjects") == pytest.approx(0.9)
    assert cell(table, "skeleton", "5 subjects") == pytest.approx(0.4)
    assert f"Missing, and counts 0: Skeleton-based ({SYNTHETIC_HUMANS[0]} fold 1)." in table_notes(
        table
    )


@pytest.fixture
def with_map(monkeypatch):
    """Tables that also show mean average precision."""
    measures = (*PAPER_MEASURES, "mAP")
    monkeypatch.setattr("benchmark.report.tables.TABLE_MEASURES", measures)
    monkeypatch.setattr("benchmark.report.notes.TABLE_MEASURES", measures)


def two_rows_of_nine_classes(**more):
    """Table of a row that is better in NN and one that is better in mAP; DCG is the same."""
    labels = [letter for letter in "abcdefghi" for _ in range(2)]
    better, worse = (
        record(name, nn, dataset="tosca", labels=labels, **more)
        for name, nn in (("gps", 0.9), ("skeleton", 0.1))
    )
    worse = msgspec.structs.replace(
        worse, per_query=worse.per_query | {"mAP": [0.9] * 18}, scores=worse.scores | {"mAP": 0.9}
    )
    return view(better, worse)


@pytest.mark.usefixtures("with_map")
def test_a_further_measure_of_tables_is_shown_and_marked_beside_the_figures_of_the_paper():
    errors = dict.fromkeys((*PAPER_MEASURES, "mAP"), 0.01)
    table = two_rows_of_nine_classes(draw_errors=errors)
    column = table.columns[0].title
    groups = [[column.title for column in group.columns] for group in score_groups(table)]
    assert groups == [["NN", "FT", "ST", "DCG"], ["NN", "FT", "ST", "DCG", "mAP"]]
    assert [table.marks[name, column]["NN"] for name in ("gps", "skeleton")] == ["bold", ""]
    assert [table.marks[name, column]["mAP"] for name in ("gps", "skeleton")] == ["", "bold"]
    assert table.chance[column].keys() == {"NN", "FT", "ST", "DCG", "mAP"}
    # DCG says which row leads, and is the same in both.
    row, n_behind = block_lead(table, column, "form")
    assert (row.method, n_behind) == ("gps", 0)
    assert f"|paper: NN FT ST DCG|{column}: NN FT ST DCG mAP|" in markdown(table)
    assert r"NN & FT & ST & DCG & NN & FT & ST & DCG & mAP & s" in latex(table)


@pytest.mark.usefixtures("with_map")
def test_any_difference_in_a_measure_may_be_chance_if_its_scatter_is_unknown():
    table = two_rows_of_nine_classes()
    assert table.marks["gps", table.columns[0].title]["mAP"] == "scatter"


@pytest.mark.usefixtures("with_map")
def test_a_measure_that_a_record_lacks_is_left_out_with_a_note():
    old = record("gps")
    del old.per_query["mAP"]
    table = view(old, record("skeleton"))
    assert table.measures == PAPER_MEASURES
    assert (
        "Not shown, because some rows were scored before tables had it: mAP; run them again."
        in table_notes(table)
    )
    assert view(record("gps"), record("skeleton")).measures == (*PAPER_MEASURES, "mAP")


def test_a_row_is_the_mean_of_all_draws_of_people_and_networks_see_the_first():
    draws = {name: round(0.1 * k, 1) for k, name in enumerate(SYNTHETIC_HUMANS, 3)}
    forms = [
        record(m, nn * f, dataset=name)
        for name, nn in draws.items()
        for m, f in (("gps", 1.0), ("skeleton", 0.5))
    ]
    networks = [
        record(name, nn, input_="view", dataset=SYNTHETIC_HUMANS[0], models=[])
        for name, nn in (("learned", 0.8), ("learned-size-free", 0.6))
    ]
    (table,) = (
        each for each in table_views([*forms, *networks], ["I"]) if each.table.identifier == "I"
    )
    assert cell(table, "gps", "15 subjects") == pytest.approx(sum(draws.values()) / len(draws))
    assert cell(table, "learned", "15 subjects") == 0.8
    assert (
        marks(table, "15 subjects")["gps"] == "bold"
    )  # nine classes; the network's three are too few
    assert marks(table, "15 subjects")["learned"] == ""
    apart = f"at most .{len(draws) - 1}0 apart (NN of GPS); networks: one draw."
    apart = f"15 subjects: mean of {len(draws)} draws, {apart}"
    assert any(apart in note for note in table_notes(table)) == (len(draws) > 1)
    headings = [heading for heading, _ in blocks(table)]
    assert headings == [
        "Canonical forms (complete surfaces)",
        f"Networks (one depth view; 15 subjects: 1 of {len(draws)} draws)",
        "",
    ]


@pytest.mark.parametrize(
    ("draws", "expected"),
    [
        (SYNTHETIC_HUMANS[:1], 0.6),
        (SYNTHETIC_HUMANS[1:2], 0.6),
        (SYNTHETIC_HUMANS[::2], 0.7),
    ],
)
def test_a_draw_that_no_row_ranks_does_not_count_as_missing(draws, expected):
    stand_in = {"stand_in_for": "shrec14-synthetic"}
    rows = [record("gps", 0.6 + 0.2 * k, dataset=d, **stand_in) for k, d in enumerate(draws)]
    table = view(*rows, tables=["I"], datasets=draws)
    assert cell(table, "gps", "15 subjects") == pytest.approx(expected)
    assert table.dataset == draws[0]
    assert "'people'" in table.caption or f"'{draws[0]}'" in table.caption
    notes = " ".join(table_notes(table))
    assert f"15 subjects: {len(draws)} of 3 draws only." in notes
    assert "Missing" not in notes
    # A draw that another row ranks is missing, and counts 0.
    table = view(*rows, record("skeleton", 0.9, dataset=draws[0], **stand_in), tables=["I"])
    assert cell(table, "skeleton", "15 subjects") == pytest.approx(0.9 / len(draws))
    assert "networks: one draw" not in " ".join(table_notes(table))


def test_skeletons_of_views_say_that_they_are_level_sets():
    surface, view_ = (record("skeleton", 0.5, input_=name) for name in ("mesh", "view"))
    swept = record("skeleton[bands=12]", 0.5, input_="view", parameters={"bands": 12})
    assert [row.title for row in view(surface).rows] == ["Skeleton-based"]
    assert [row.title for row in view(view_).rows] == ["Skeleton-based (level sets)"]
    both = [row.title for row in view(surface, view_).rows]
    assert both == ["Skeleton-based (views: level sets)"]
    assert any("level sets" in row.title for row in view(view_, swept).rows[1:])


def test_rows_of_one_title_show_their_names():
    table = view(
        *[record(name, 0.5, title="Mine") for name in ("mine", "mine-too")], record("gps", 0.5)
    )
    assert [row.title for row in table.rows] == ["GPS", "Mine (mine)", "Mine (mine-too)"]


def test_rows_of_a_sweep_are_in_the_order_of_its_numbers_and_the_default_row_shows_its_value():
    def swept(**chosen):
        texts = ",".join(f"{name}={value}" for name, value in chosen.items())
        defaults = {name: value for name, value in (("n", 25), ("x", 0.5)) if name not in chosen}
        name, title = (f"mine[{texts}]", f"Mine (1) ({texts})") if texts else ("mine", "Mine (1)")
        return record(name, title=title, parameters=chosen, defaults=defaults)

    rows = [
        swept(n=100),
        swept(n=10),
        swept(),
        swept(n=9, x=1e-5),
        swept(x=2.0),
        record("gps"),
        record("minx"),
    ]
    assert [row.title.removeprefix("Mine (1) ") for row in view(*rows).rows] == [
        "GPS",
        "(n=9,x=1e-05)",
        "(n=10, x=0.5)",
        "(n=25, x=0.5)",
        "(x=2.0, n=25)",
        "(n=100, x=0.5)",
        "Minx",
    ]
    assert [row.title for row in view(record("gps", defaults={"n": 25}), swept(n=9)).rows] == [
        "GPS",
        "Mine (1) (n=9)",
    ]


def test_the_title_of_a_known_row_gets_brackets_of_its_own_for_the_defaults_of_a_sweep():
    shown = "learned[configuration=as_printed,training=animals-III]"
    chosen = {"configuration": "as_printed", "training": "animals-III"}
    rows = [
        record(shown, input_="view", parameters=chosen, defaults={"epochs": 5}),
        record("learned[epochs=2]", input_="view", parameters={"epochs": 2}),
    ]
    titles = {row.method: row.title for row in view(*rows).rows}
    assert titles[shown] == "Depth network, 500 px, generated animals (epochs=5)"


def test_a_default_that_chooses_nothing_is_in_no_title():
    chosen = {"training": "animals-III"}
    of_table = record("learned", input_="view", defaults={"training": ""})
    other = record("learned[training=animals-III]", input_="view", parameters=chosen)
    assert "Depth network, 128 px" in {row.title for row in view(of_table, other).rows}


SCHEDULES = {
    "learned": "128 x 128 pixels, 500 epochs, stretch_depth True, AMD EPYC, 1 core",
    AS_PRINTED: "500 x 500 pixels, 500 epochs, AMD EPYC, 1 core",
}


@pytest.mark.parametrize(
    ("name", "training", "digest", "schedule", "is_own"),
    [
        ("learned", "people-fold-0", "published", "as on the card", False),
        ("learned", "people-fold-0", "0" * 16, SCHEDULES["learned"], True),
        ("learned-wide-extra", "humans-sampled", "published", "as on the card", False),
        ("learned-wide-extra", "humans-sampled", "0" * 16, "128 x 128 pixels, 8 epochs", True),
        ("learned", "tosca-III", "0" * 16, SCHEDULES["learned"], False),
        (
            "learned",
            "tosca-III",
            "0" * 16,
            "64 x 64 pixels, 500 epochs, stretch_depth True, A",
            True,
        ),
        (
            "learned",
            "tosca-III",
            "0" * 16,
            "128 x 128 pixels, 5 epochs, stretch_depth True, A",
            True,
        ),
        ("learned", "tosca-III", "0" * 16, SCHEDULES[AS_PRINTED], True),
        (AS_PRINTED, "tosca-III", "0" * 16, SCHEDULES[AS_PRINTED], False),
        (AS_PRINTED, "tosca-III", "0" * 16, SCHEDULES["learned"], True),
        ("mine", "tosca-III", "0" * 16, "any", False),
    ],
)
def test_the_title_of_a_network_says_whose_model_it_is(name, training, digest, schedule, is_own):
    if digest == "published":
        paths = (path for path in published_files() if path.startswith(f"{training}/"))
        digest = published_files()[next(path for path in paths if path.endswith(CARD))][:16]
    model = {"training": training, "data": training, "digest": digest, "schedule": schedule}
    row = view(record(name, title="Mine", input_="view", models=[model])).rows[-1]
    title = TITLES.get(name, "Mine")
    if is_own:
        title = f"{title.removesuffix(f', {FROZEN}')}, own model"
    assert row.title == title


@pytest.mark.parametrize("method", ["learned", "learned-size-free", "learned-without-weighting"])
@pytest.mark.parametrize("training", ["tosca-III", "shrec14-synthetic-fold-0"])
def test_the_recipe_of_a_model_that_is_not_published_is_that_of_run_train(method, training):
    network = select_one(method).create()
    options = network.recipe(training)
    schedule = Schedule(**{**DEFAULTS.get(network.configuration, {}), **options})
    assert re.match(RECIPE, f"{schedule.in_words()}, AMD EPYC")
    assert re.match(RECIPE_AS_PRINTED, f"{Schedule().in_words()}, AMD EPYC")


def test_data_are_a_stand_in_by_their_record_and_not_by_their_title():
    named = {"name": "rods", "title": "my stand-in", "source": "rods"}
    assert [row["stand_in"] for row in as_json([view(record(data=named))])] == [False]
    table = view(record(dataset="animals", stand_in_for="tosca"), tables=["III"])
    assert [row["stand_in"] for row in as_json([table]) if row["method"] == "gps"] == [True]


def test_a_network_stays_one_where_its_first_job_failed_and_the_gallery_of_that_is_named():
    model = {"training": "t", "data": "d", "digest": "0"}
    folds = [
        record("net", fold=f"fold {k}", input_="view", models=[model], **HUMANS) for k in (1, 2)
    ]
    table = view(failed("net", fold="fold 0", input_="view", **HUMANS), *folds, tables=["I-view"])
    (row,) = (row for row in table.rows if row.method == "net")
    assert row.kind == "network"
    gallery = f"{SYNTHETIC_HUMANS[0]} fold 0"
    assert f"No result: Net ({gallery}: failed: it fell)." in table_notes(table)


def test_trainings_are_averaged_within_a_fold_before_folds_are():
    seeds = [
        record(f"learned[training_seed={s}]", 0.2 * s, fold="fold 0", input_="view", **HUMANS)
        for s in (1, 2)
    ]
    rest = [record("learned", 0.6, fold=f"fold {k}", input_="view", **HUMANS) for k in (1, 2)]
    table = view(*seeds, *rest, tables=["IV"])
    assert cell(table, "learned", "ours") == pytest.approx((0.3 + 0.6 + 0.6) / 3)
    assert not any("one seed" in note for note in table_notes(table))
    assert "Trained with one seed, so no spread over seeds: Depth network, 128 px." in table_notes(
        view(*rest, tables=["IV"])
    )


def test_networks_see_a_view_and_all_others_complete_surfaces():
    both = [
        record(name, nn, input_=i, dataset="tosca", models=models)
        for name, models in (
            ("gps", []),
            (AS_PRINTED, [{"training": "t", "data": "d", "digest": "1"}]),
        )
        for i, nn in (("mesh", 0.5), ("view", 0.8))
    ]
    table, fair = table_views(both, ["III"])
    assert (cell(table, "gps", "ours"), cell(table, AS_PRINTED, "ours")) == (0.5, 0.8)
    assert (table.table.identifier, fair.table.identifier) == ("III", "III-view")
    assert (cell(fair, "gps", "all shapes"), cell(fair, AS_PRINTED, "all shapes")) == (0.8, 0.8)
    assert not fair.paper
    assert cell(table, "gps", "paper") == PRINTED["III"]["gps"]["NN"]


def eight(method, *values, **more):
    """Record of eight classes of two shapes, in the order of the values."""
    labels = [name for name in "abcdefgh" for _ in range(2)]
    return record(method, [value for value in values for _ in range(2)], labels=labels, **more)


def test_a_block_marks_its_best_what_is_not_significantly_worse_and_what_is_within_the_scatter():
    descriptor = {"scorer": "", "scorer_title": ""}
    rows = [
        eight("top", *[0.9] * 8),
        eight("near", *[1.0] * 4, *[0.6] * 4),
        eight("close", *[0.88] * 8),  # in every class, but within the scatter of codebooks
        eight("far", *[0.2] * 8),
        eight("dna", *[0.4] * 8, **descriptor),
        eight("area", *[0.5] * 4, *[0.2] * 4, **descriptor),
    ]
    table = view(*rows)
    expected = {
        "top": "bold",
        "near": "italic",
        "close": "scatter",
        "far": "",
        "dna": "bold",
        "area": "italic",
    }
    assert marks(table) == expected
    none = "No difference is significant and above the scatter: Descriptors (mesh)."
    assert none in table_notes(table)
    assert "bold" in table.marks["area", "mesh"].values()


def test_below_eight_classes_nothing_is_marked():
    table = view(record("best", 0.9), record("far", 0.1))
    assert table.marks == {}
    assert "Too few classes for a test: mesh (3 classes)." in table_notes(table)
    assert not any("No difference" in note for note in table_notes(table))
    alone = replace(table, methods=frozenset({"far"}))
    assert not any("Too few classes" in note for note in table_notes(alone)), (
        "one row has no rival beside it"
    )


@pytest.mark.parametrize(
    "spoiled",
    [{"seen": ["a0"]}, {"unsupported": [("a0", "too thin")]}],
    ids=["seen in training", "a shape refused"],
)
def test_rows_that_are_incomplete_or_saw_shapes_in_training_have_no_mark(spoiled):
    table = view(
        eight("best", *[0.99] * 8, **spoiled),
        eight("other", *[0.5] * 8),
        eight("third", *[0.4] * 8),
    )
    assert marks(table) == {"best": "", "other": "bold", "third": ""}


def test_a_row_that_lacks_a_fold_takes_the_marks_from_no_other():
    """A shape that all others lack, too, may be of this fold."""

    def folds(method, *numbers, **more):
        lacking = {1: {"unsupported": [("a0", "two pieces")]}}
        return [
            eight(method, *[0.5] * 8, fold=f"fold {k}", **lacking.get(k, {}), **HUMANS, **more)
            for k in numbers
        ]

    complete = [*folds("gps", 0, 1, 2), *folds("identity", 0, 1, 2)]
    table = view(*complete, *folds("skeleton", 0, 2), tables=["I"])
    found = {method: mark for method, mark in marks(table, "5 subjects").items() if mark}
    assert found == {"gps": "bold", "identity": "bold"}


def test_a_row_leads_those_that_are_tested_if_its_block_has_others():
    seen = eight("best", *[0.9] * 8, unsupported=[("a0", "too thin")])
    others = [eight("other", *[0.5] * 8), eight("third", *[0.4] * 8)]
    among = "has the highest DCG of the rows that are tested, .70"
    assert among in leads(view(seen, *others))[0]
    assert "has the highest DCG, .70" in leads(view(*others))[0]


def test_a_column_in_which_all_rows_failed_is_named():
    table = view(record("gps"), failed("gps", input_="view"), failed("mine", input_="view"))
    assert table.groups == ["mesh"]
    notes = " ".join(table_notes(table))
    assert "No result: GPS; Mine (view: failed: it fell); Mine (mesh: not run, or" in notes


def test_marks_do_not_change_with_the_methods_that_are_shown():
    rows = [eight("best", *[0.9] * 8), eight("near", *[1.0, 0.7] * 4), eight("far", *[0.1] * 8)]
    few = view(*rows, methods=["far"])
    assert [row.method for row in few.printed_rows] == ["far"]
    assert few.marks == view(*rows).marks != {}
    hidden = "These marks count rows that are not printed, too: "
    titles = [row.title for row in few.rows if row.method != "far"]
    assert table_notes(few)[0].endswith(f"{hidden}{', '.join(titles)}.")
    assert hidden not in table_notes(view(*rows))[0]


def test_rows_on_another_version_of_the_data_are_left_out_and_named():
    old = record(
        "gps", 0.9, labels=LABELS[:8], gallery_digest="0", finished="2025-01-01T00:00:00+00:00"
    )
    table = view(old, record("skeleton", 0.5))
    assert [row.method for row in table.rows] == ["skeleton"]
    assert any("gps on rods, mesh" in note for note in table_notes(table))
    assert table.size == "12 shapes of 3 classes"


def test_local_rows_decide_which_version_of_the_data_is_shown():
    here = record("gps", gallery_digest="0", finished="2025-01-01T00:00:00+00:00")
    assert [row.method for row in view(here, record("skeleton", published=True)).rows] == ["gps"]


def test_notes_say_what_s_is_why_a_score_is_missing_and_what_was_seen_in_training():
    seen = record("learned", dataset="tosca", input_="view", models=[], seen=["cat0", "owl8"])
    table, _ = table_views([record("gps", dataset="tosca"), seen], ["III"], paper=True)
    found = "\n".join(table_notes(table))
    assert "processor seconds per shape for form and geodesics; machine: unknown." in found
    assert "Ranks by spherical harmonics: no record yet." in found
    assert (
        "Depth network, 500 px, width 16 (no model was trained for this data, or it was not run; "
        "'run --train' trains the models that this code can train)"
    ) in " ".join(found.split())
    assert "Classic MDS; Fast MDS; Non-metric MDS; 4 more (not run)" in found
    assert "Trained on the classes of: Depth network, 128 px (ours: 8 of 12 shapes)." in found


def test_methods_of_the_paper_that_never_ran_are_printed_on_demand():
    (ran,) = table_views(
        [record("gps", dataset="tosca"), failed("skeleton", dataset="tosca")], ["III"]
    )
    assert [row.title for row in ran.printed_rows] == ["GPS", "Skeleton-based"]
    assert not any("not run" in note for note in table_notes(ran))
    (every,) = table_views([record("gps", dataset="tosca")], ["III"], paper=True)
    assert [row.method for row in every.printed_rows] == [*PRINTED["III"]]


def test_notes_name_each_kind_of_fact_once_and_every_fact_that_moves_a_score():
    refused = [("cat0", "two pieces"), ("dog4", "cannot be read")]
    rows = [record(f"m{k}", 0.5, unsupported=refused, unprepared=["dog4"]) for k in range(9)]
    rows += [
        record("net", models=[], seen=["owl8"]),
        record("here"),
        record("there", published=True),
    ]
    old = record("old", gallery_digest="0", finished="2025")
    found = table_notes(
        view(*rows, old, *[failed(f"f{k}", "smooth.py:14: NameError") for k in range(9)])
    )
    assert sum("Refused shapes" in note for note in found) == 1
    assert "Cannot be read or prepared, and count 0: dog4 (cannot be read)." in found
    assert sum("smooth.py:14" in note for note in found) == 1
    for kind in (
        "Too few classes",
        "s: median",
        "Trained on the classes",
        "Published with",
        "Left out, because",
    ):
        assert sum(kind in note for note in found) == 1, kind


def test_a_shape_that_cannot_be_read_is_named_with_the_column_that_lacks_it():
    lacking = record("gps", unsupported=[("cat0", "cut off")], unprepared=["cat0"])
    found = table_notes(view(lacking, record("gps", input_="view")))
    assert "Cannot be read or prepared, and count 0: cat0 (cut off) in mesh." in found


def test_a_table_without_scores_shows_the_input_that_failed():
    assert view(failed("gps", dataset="mine", input="view")).groups == ["view"]
    assert view(
        failed("gps", dataset="mine"), failed("gps", dataset="mine", input="view")
    ).groups == ["mesh"]


def test_a_table_of_which_only_one_fold_was_tried_and_failed_is_printed():
    table = view(failed("gps", "it fell", fold="fold 0", **HUMANS), tables=["I"])
    assert "failed" in markdown(table)
    assert table.size == "12 shapes of 3 classes"


def test_methods_that_fail_everywhere_have_rows_only_if_they_are_asked_for(tmp_path):
    rows = [
        record("mine"),
        failed("mine", dataset="other"),
        failed("bad"),
        failed("mine[n=2]"),
        failed("gps"),
    ]
    for each in [*rows, record("fine", dataset="other")]:
        write_record(tmp_path, each, "")

    def titles(*options):
        said = call(
            "tables", "--results", tmp_path, "--format", "json", *options
        )  # errors come first
        shown = json.loads(said[said.index("[\n") :])
        return {
            (row["dataset"], row["method"])
            for row in shown
            if not row["NN"] or row["method"] == "mine"
        }

    kept = {("rods", "mine"), ("other", "mine"), ("rods", "gps")}
    assert titles() == kept
    assert titles("-d", "other") == {("other", "mine")}
    assert titles("--failed") == kept | {("rods", "bad"), ("rods", "mine[n=2]")}
    assert ("rods", "bad") in titles("-m", "bad")
    assert ("rods", "mine[n=2]") in titles("-m", "mine")


def test_the_order_of_records_changes_nothing():
    records = [
        record(f"m{k}", 0.1 * k, dataset=name) for k in range(5) for name in ("rods", "tosca")
    ]
    expected = table_files(table_views(records), records)
    for seed in range(3):
        random.Random(seed).shuffle(records)
        files = table_files(table_views(records), records)
        assert sorted(files.pop("scores.csv").splitlines()) == sorted(
            expected["scores.csv"].splitlines()
        )
        assert files == {name: text for name, text in expected.items() if name != "scores.csv"}


def test_changed_sets_and_quick_runs_are_in_no_table_of_full_runs():
    records = [record(dataset="animals[noise=2]"), record(dataset="animals", quick=True)]
    assert table_views(chosen_records(records)) == []
    assert [table.quick for table in table_views(chosen_records(records, quick=True))] == [True]
    assert (
        view(*chosen_records(records), datasets=["animals[noise=2]"]).dataset == "animals[noise=2]"
    )


def test_a_table_that_is_asked_for_shows_the_data_that_ran_here_else_the_official_ones():
    published = [record(dataset=name, published=True) for name in ("tosca", "animals")]
    assert [table.dataset for table in table_views(published, ["III"])] == ["tosca"]
    here = record("skeleton", dataset="animals")
    assert [table.dataset for table in table_views([*published, here], ["III"])] == ["animals"]
    assert len(table_views(published)) == 2


def test_rows_that_came_with_the_suite_are_named_beside_those_of_runs_here():
    published = record("gps", published=True, commit="0123456789")
    found = table_notes(view(published, record("skeleton")))
    assert "Published with the suite, not run here: GPS (01234567)." in found
    assert not any("Published with" in note for note in table_notes(view(published)))


def test_robustness_has_a_line_for_each_change_and_strength_below_the_unchanged_set():
    changes = {
        "rods": 0.75,
        "rods[noise=2]": 0.5,
        "rods[noise=5]": 0.25,
        "rods[holes=1]": 0.0,
        "balls": 1.0,
    }
    records = [record("gps", nn, dataset=name) for name, nn in changes.items()]
    records += [
        record("classic-mds", 1.0, dataset="rods[noise=2]"),
        record("identity", 1.0, dataset="rods[noise=2]"),
    ]
    text = robustness_markdown(records)
    assert text.startswith("**Robustness.** NN of complete surfaces of rods;")
    assert [line for line in text.splitlines() if line.startswith("|")] == [
        "|Change|strength|Classic MDS|GPS|",
        "|---|---:|---:|---:|",
        "|unchanged|0|--|.75|",
        "|holes|1|--|.00|",
        "|noise|2|1.00|.50|",
        "|noise|5|--|.25|",
    ]
    assert robustness_markdown([record("gps", dataset="rods")]) == ""


def test_lines_of_robustness_name_their_data_if_several_sets_were_changed():
    names = ("rods[noise=2]", "my_balls[noise=2]")
    text = robustness_markdown([record("gps", 0.5, dataset=name) for name in names])
    assert [line for line in text.splitlines() if line.startswith("|")] == [
        "|Data|Change|strength|GPS|",
        "|---|---:|---:|---:|",
        "|my\\_balls|noise|2|.50|",
        "|rods|noise|2|.50|",
    ]


def test_robustness_shows_no_record_of_another_version_of_the_data():
    old = {"labels": LABELS[:8], "gallery_digest": "0", "finished": "2025-01-01T00:00:00+00:00"}
    noisy = {"dataset": "rods[noise=2]"}
    rows = [record("gps", 0.5, **noisy, **old), record("classic-mds", 0.75, **noisy)]
    assert "|noise|2|.75|" in robustness_markdown(rows)


def test_a_failed_job_has_its_status_and_no_score_in_the_table_of_robustness():
    rows = [
        record("gps", 0.5, dataset="rods[noise=2]", quick=True),
        failed("classic-mds", status="timeout", dataset="rods[noise=2]", quick=True),
    ]
    text = robustness_markdown(rows)
    assert "|noise|2|timeout|.50|" in text
    assert "rods (quick run with at most 3 poses of each class);" in text
    assert "quick" not in robustness_markdown([record("gps", 0.5, dataset="rods[noise=2]")])


def test_a_shape_refused_in_two_draws_is_two_shapes():
    rows = [
        record("gps", dataset=name, unsupported=[("cat0", "too thin")])
        for name in SYNTHETIC_HUMANS[:2]
    ]
    trainings = [
        record(f"net[training_seed={seed}]", input_="view", unsupported=[("cat0", "too thin")])
        for seed in (0, 1)
    ]
    notes = " ".join(table_notes(view(*rows, tables=["I"])))
    assert "GPS 2 (15 subjects; cat0: too thin)" in notes
    assert " 1 (view; cat0: too thin)" in " ".join(table_notes(view(*trainings)))


def test_quick_runs_have_no_ranks_by_a_second_scorer():
    """Those are of all shapes, but a score of a quick run may happen to be equal."""
    equal = [record("gps", 0.5, dataset="tosca", quick=quick) for quick in (False, True)]
    full, of_quick = (view(row, tables=["III"]) for row in equal)
    assert any("Ranks by spherical harmonics" in note for note in table_notes(full))
    assert not any("Ranks by spherical harmonics" in note for note in table_notes(of_quick))


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.994, ".99"), (0.996, "1.0"), (1.26, "1.3"), (9.94, "9.9"), (9.96, "10"), (12.3, "12")],
)
def test_seconds_have_two_digits(seconds, text):
    assert two_digits(seconds) == text


@pytest.mark.parametrize(
    ("score", "text"), [(0.125, "0.13"), (0.375, "0.38"), (0.995, "1.00"), (float("nan"), "--")]
)
def test_a_half_of_the_last_decimal_rounds_up_with_and_without_a_leading_zero(score, text):
    assert two_decimals(score) == text
    assert hundredths(score) == text.removeprefix("0")


def test_seconds_are_of_the_processor_and_an_old_record_without_them_has_none():
    new = record("gps", processor_seconds={"canonicalise": 2.0, "geodesics": 0.25})
    old = record("skeleton", processor_seconds={})
    shown = view(new, old)
    assert {
        row.method: column.value(row) for row in shown.rows for column in PRINTED_QUANTITIES
    } == {
        "gps": 2.25,
        "skeleton": None,
    }
    note = "s: median processor seconds per shape for form and geodesics; machine: unknown."
    assert table_notes(shown)[0].endswith(note)
    each = [(of["seconds"], of["processor_seconds"]) for of in as_json([view(new, old)])]
    assert each == [(1.5, 2.25), (1.5, None)]
    jobs = Results(Path(), (new, old)).jobs
    assert jobs.seconds.tolist() == [1.5, 1.5]
    assert jobs.processor_seconds.isna().tolist() == [False, True]


def test_seconds_of_several_machines_are_told_apart():
    here, there = (
        record("skeleton", machines=["A, 2 cores"]),
        record("gps", machines=["B, 4 cores"]),
    )
    for other, named in (
        (there, "B, 4 cores; A, 2 cores"),
        (record("gps"), "unknown; A, 2 cores"),
        (here, "A, 2 cores"),
    ):
        assert any(f"; machine: {named}." in note for note in table_notes(view(here, other)))


@pytest.mark.parametrize(
    "names",
    [
        ("котики", "собачки"[:6]),
        ("a b", "a-b"),
        ("a/b", "a-b"),
        ("x" * 90, "x" * 91),
        ("a b", "a20b"),
    ],
)
def test_data_sets_of_any_name_have_files_of_their_own(names):
    files = table_files(table_views(record(dataset=name) for name in names), [], ["markdown"])
    assert len(files) == 2
    assert all(name.isascii() and len(name) < 100 for name in files)
