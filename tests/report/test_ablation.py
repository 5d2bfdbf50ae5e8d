"""Table IV: which jobs make its rows, and their means by hand."""

import json

import pytest
from benchmark.report.ablation import averaged

from benchmark.jobs.plan import Job
from benchmark.methods import registry
from benchmark.protocols.tables import galleries
from benchmark.report.content import Row, TableContent
from benchmark.report.formats import as_csv, latex, markdown, rows_as_json
from benchmark.report.page import page
from tests import mean_folds, mean_target

MODEL = {"training": "humans-I", "data": "ten humans", "schedule": "one pass", "extra_data": False}


def specs(*names):
    return registry.select(names, registry.methods([mean_target.PLUGIN_PATH, mean_folds.PLUGIN_PATH]))


def names(gallery, *methods):
    return [spec.name for spec in gallery.rows(specs(*methods))]


def test_the_ablation_has_the_gallery_of_table_one_and_one_for_each_fold():
    first, *folds = galleries(["IV"])
    assert (first.name, first.split, first.entries) == ("humans", "table", galleries(["I"])[0].entries)
    assert [(fold.name, fold.split, len(fold.entries)) for fold in folds] == [
        ("humans fold 0", "strict", 100),
        ("humans fold 1", "strict", 100),
        ("humans fold 2", "strict", 100),
    ]
    assert len({entry.identifier for fold in folds for entry in fold.entries}) == 300
    assert len({entry.subject for entry in folds[1].entries}) == 5


def test_a_row_is_trained_with_three_seeds_and_the_first_is_the_plain_method():
    first, fold, *_ = galleries(["IV"])
    assert names(first, "mean-target", "mean-strict", "gps") == [
        "mean-target",
        "mean-target[training_seed=1]",
        "mean-target[training_seed=2]",
    ]
    assert names(first, "mean-target[training_seed=1]") == ["mean-target[training_seed=1]"]
    assert names(first, "mean-target[configuration=other]")[1] == "mean-target[configuration=other,training_seed=1]"
    assert names(fold, "mean-target", "mean-strict") == ["mean-strict"]


def test_a_seed_of_a_row_is_the_method_that_can_be_named():
    (named,) = specs("mean-target[configuration=other,training_seed=1]")
    (plain,) = specs("mean-target[configuration=other]")
    assert plain.with_parameter("training_seed", 1) == named
    assert named.without_parameter("training_seed") == plain


def test_methods_of_the_ablation_are_in_other_tables_only_when_named():
    (table_one,) = galleries(["I"])
    known = registry.select([], registry.methods())
    unasked = [spec.name for spec in table_one.rows(known)]
    assert "learned" in unasked
    assert not {"learned-strict", "learned-without-srf", "learned-without-lrf"} & set(unasked)
    asked = registry.select(["learned-without-srf"], registry.methods())
    assert [spec.name for spec in table_one.rows(asked)] == ["learned-without-srf"]
    first, fold, *_ = galleries(["IV"])
    assert [spec.base_name for spec in first.rows(known)][::3] == [
        "learned",
        "learned-without-srf",
        "learned-without-lrf",
    ]
    assert [spec.name for spec in fold.rows(known)] == ["learned-strict"]


def record(nn, digest, shapes=("a", "b"), **more):
    scores = {"NN": nn, "FT": 0.5, "ST": 0.75, "DCG": 0.8}
    return {
        "key": digest, "status": "ok", "scores": scores, "chance": dict.fromkeys(scores, 0.25), "shapes": list(shapes),
        "labels": ["x", "y"], "unsupported": [], "phase_seconds": {"match": 1.5}, "peak_mib": 100,
        "models": [MODEL | {"digest": digest}], **more,
    }  # fmt: skip


def jobs(*methods):
    gallery = galleries(["IV"])[0]
    return [Job(name, gallery, "view", spec, {}, "cached", "") for name in methods for spec in specs(name)]


def test_means_and_spread_by_hand():
    three = jobs("mean-target", "mean-target[training_seed=1]", "mean-target[training_seed=2]")
    cell = averaged(three, [record(0.5, "a"), record(0.6, "b"), record(0.1, "c", shapes=("b", "c"))])
    assert cell.scores["NN"] == pytest.approx(0.4)
    # Deviations .1, .2 and -.3 from the mean: (.01 + .04 + .09) / 2.
    assert cell.spread["NN"] == pytest.approx(0.07**0.5)
    assert cell.spread["FT"] == 0
    assert (cell.n_averaged, cell.n_wanted, len(cell.models)) == (3, 3, 3)
    assert (cell.record["n_shapes"], cell.record["n_classes"]) == (3, 2)
    assert cell.record["phase_seconds"] == {"all": 4.5}


def content(*records):
    methods = ("mean-target", "mean-target[training_seed=1]", "mean-target[training_seed=2]")[: len(records)]
    paper = {"NN": 0.61, "FT": 0.53, "ST": 0.73, "DCG": 0.78}
    row = Row("learned", "Our", "paper", paper, {"view": averaged(jobs(*methods), records)})
    return TableContent(galleries(["IV"])[0], ("view",), (row,), dict.fromkeys(paper, 0.2))


def test_all_formats_print_mean_spread_and_number_of_models():
    table = content(record(0.5, "a"), record(0.6, "b"))
    (line,) = [line for line in markdown(table).splitlines() if line.startswith("| Our")]
    assert [cell.strip() for cell in line.strip("|").split("|")] == [
        "Our (2 models)", "0.61", "0.53", "0.73", "0.78",
        "**0.55** ± 0.07", "**0.50** ± 0.00", "**0.75** ± 0.00", "**0.80** ± 0.00",
    ]  # fmt: skip
    assert "- Our: trained on ten humans: one pass" in markdown(table).splitlines()
    assert r"Our (2 models) & 0.61 & 0.53 & 0.73 & 0.78 & \textbf{0.55} $\pm$ 0.07" in latex(table)
    assert "<td><b>0.55</b> ± 0.07</td>" in page([table], {})
    (row,) = rows_as_json([table])
    assert (row["n_models"], row["NN"], row["title"]) == (2, 0.55, "Our")
    assert row["spread"] == {"NN": 0.070711, "FT": 0.0, "ST": 0.0, "DCG": 0.0}
    header, values = (line.split(",") for line in as_csv([table]).splitlines())
    assert dict(zip(header, values, strict=True))["spread_NN"] == "0.070711"
    assert json.loads(json.dumps(row)) == row


def test_a_missing_training_is_told():
    table = content(record(0.5, "a"), record(0.6, "b"), {"reason": "needs the model humans-I"})
    assert table.rows[0].label == "Our (2 models)"
    told = "mean of 2 instead of 3 (humans view training seed 2: needs the model humans-I)"
    assert any(told in note for note in table.notes())


def test_one_training_has_no_spread_and_none_has_no_scores():
    single = content(record(0.5, "a"), {"reason": "needs the model humans-I"})
    assert single.rows[0].label == "Our (1 model)"
    assert "±" not in markdown(single).split("| Our")[1].splitlines()[0]
    none = content({"reason": "needs the model humans-I"}, {"reason": "needs the model humans-I"})
    assert none.rows[0].label == "Our"
    assert none.rows[0].cells["view"].scores is None


def test_extra_training_data_is_marked():
    row = content(record(0.5, "a", models=[MODEL | {"digest": "a", "extra_data": True}])).rows[0]
    assert row.label == "Our (extra training data)"


def test_learners_beyond_the_papers_have_rows_where_models_are_shipped_or_when_named():
    known = registry.methods().values()
    one, three = (galleries([numeral])[0] for numeral in ("I", "III"))
    beyond = {"learned-wide", "learned-wide-extra"}
    assert beyond <= {spec.name for spec in one.rows(known)}
    assert not beyond & {spec.name for spec in three.rows(known)}
    assert "learned" in {spec.name for spec in three.rows(known)}
    assert [spec.name for spec in three.rows(specs("learned-wide"))] == ["learned-wide"]


def test_a_further_ablation_beside_all_methods_goes_to_the_ablation_alone():
    chosen = registry.select(["all", "learned-strict[smoothing=3]"], registry.methods())
    one, fold = galleries(["I"])[0], galleries(["IV"])[1]
    assert "learned-strict[smoothing=3.0]" not in {spec.name for spec in one.rows(chosen)}
    assert [spec.name for spec in fold.rows(chosen)] == ["learned-strict", "learned-strict[smoothing=3.0]"]
