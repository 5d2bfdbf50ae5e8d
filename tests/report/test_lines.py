"""Means of galleries and of trainings, by hand."""

import json
import re

import pytest

from benchmark.report import frame
from benchmark.report.content import contents
from benchmark.report.formats import as_csv, markdown, rows_as_json
from benchmark.report.html.pages import ENVIRONMENT
from benchmark.report.latex import latex
from benchmark.report.notes import notes
from benchmark.report.results import Result, line_of
from tests.records import failed, record

MODEL = {"training": "humans-fold-0", "data": "ten humans", "schedule": "one pass", "extra_data": False}
HUMANS = {"name": "humans", "title": "Humans", "stand_in_for": "shrec14-synthetic", "source": "humans"}


def of_fold(fold, nn, *, training_seed=0, digest="a", make=record, method="learned", **more):
    """Record of a learner on a fold of the synthetic humans."""
    name = f"{method}[training_seed={training_seed}]" if training_seed else method
    parameters = {"training_seed": training_seed} if training_seed else more.pop("parameters", {})
    if make is record:
        more = {"models": [MODEL | {"digest": digest}]} | more
        more["nn"] = nn
    return make(
        method=name, input_="view", gallery=f"humans fold {fold}", title="Our", parameters=parameters, data=HUMANS,
        family="paper", **more,
    )  # fmt: skip


def results(*records):
    return [Result(found) for found in records]


def test_means_and_deviation_by_hand():
    shapes = ["cat0", "cat1", "dog0", "dog2"]
    found = results(
        of_fold(0, 0.5),
        of_fold(1, 0.6, digest="b", cost={"seconds_per_shape": {"canonicalise": 2.5, "features": 1.0}}, peak_mib=120),
        of_fold(2, 0.1, digest="c", shapes=shapes, cost={"seconds_per_shape": {"canonicalise": 9.0}}),
    )
    line = line_of(found, 3)
    assert line["scores"]["NN"] == pytest.approx(0.4)
    # Deviations .1, .2 and -.3 from the mean: (.01 + .04 + .09) / 2.
    assert line["deviation"]["NN"] == pytest.approx(0.07**0.5)
    assert line["deviation"]["FT"] == 0
    assert (line["status"], line["n_averaged"], line["n_wanted"], len(line["models"])) == ("ok", 3, 3, 3)
    assert (line["n_shapes"], line["n_classes"]) == (5, 2)
    assert line["phases"] == {"canonicalise": 2.5, "features": 1.0}
    assert line["peak_mib"] == 120


def test_a_job_that_failed_counts_zero_and_is_told():
    line = line_of(results(of_fold(0, 0.5), of_fold(1, 0, make=failed, reason="ate memory"), of_fold(2, 0.7)), 3)
    assert line["scores"]["NN"] == pytest.approx(0.4)
    assert line["coverage"] == pytest.approx(2 / 3)
    assert (line["n_averaged"], line["n_wanted"]) == (2, 3)
    assert line["reason"] == "humans fold 1: ate memory"
    crashed = line_of(results(of_fold(0, 0, make=failed, status="crashed")), 3)
    assert (crashed["status"], crashed["scores"]) == ("crashed", None)


def test_of_one_gallery_whose_second_training_failed_no_deviation_is_known():
    line = line_of(results(of_fold(0, 0.5), of_fold(0, 0, training_seed=1, make=failed)), 1)
    assert (line["scores"]["NN"], line["deviation"]) == (0.25, None)


def of_draw(draw, nn, training=""):
    """Record of a learner, or one of its fold models, on people drawn at random."""
    name = f"people[draw={draw}]"
    return record(
        f"learned[training={training}]" if training else "learned", nn=nn, gallery=name, input_="view", family="paper",
        parameters={"training": training} if training else {}, data={"name": name, "title": "People", "source": name},
        models=[MODEL | {"digest": training}],
    )  # fmt: skip


def test_a_row_of_people_drawn_at_random_is_the_mean_over_models_and_draws():
    folds = ("", "humans-fold-1", "humans-fold-2")
    made = [of_draw(draw, 0.1 * draw + 0.01 * k, fold) for draw in range(3) for k, fold in enumerate(folds)]
    (table,) = contents(results(*made))
    (row,) = table.rows
    assert row.scores["NN"] == pytest.approx(0.11)
    assert row.deviation["NN"] == pytest.approx(0.1)
    assert (row.label, table.data["name"]) == ("Learned (3 models)", "people")
    assert table.caption.endswith("mean over three draws")
    (one,) = contents(results(of_draw(1, 0.5)))
    assert one.rows[0].scores["NN"] == 0.5
    assert "mean" not in one.caption


def tables_of(*records):
    return {table.identifier: table for table in contents(results(*records))}


FOUR = (
    of_fold(0, 0.5),
    of_fold(0, 0.9, training_seed=1, digest="b"),
    of_fold(1, 0.6, digest="c"),
    of_fold(2, 0.4, digest="d"),
)


def test_table_one_is_the_mean_of_the_folds_and_table_four_of_the_trainings_as_well():
    found = tables_of(*FOUR)
    assert list(found) == ["I", "I-printed", "IV"]
    one, printed, four = (found[name].line("learned", "view") for name in found)
    assert (printed.scores["NN"], printed.n_averaged) == (pytest.approx(0.55), 2)
    assert (one.scores["NN"], one.n_averaged) == (pytest.approx(0.5), 3)
    assert (four.scores["NN"], four.n_averaged) == (pytest.approx(1.7 / 3), 4)  # the first fold has .7 on average
    assert found["I"].n_galleries == 3
    assert "3 x 4 shapes, 2 classes" in markdown(found["I"])


def test_the_network_as_printed_has_a_row_only_in_tables_that_name_it():
    name = "learned[configuration=as_printed]"
    records = [of_fold(k, 0.4, method=name, parameters={"configuration": "as_printed"}) for k in range(2)]
    found = tables_of(*FOUR, *records)
    assert {table: {row.method for row in found[table].rows} >= {name} for table in found} == {
        "I": False, "I-printed": True, "IV": False,
    }  # fmt: skip


def test_all_formats_print_mean_deviation_and_number_of_models():
    table = tables_of(*FOUR)["IV"]
    (line,) = [line for line in markdown(table).splitlines() if line.startswith("| Our")]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[0] == "Our (4 models) ¹"
    assert cells[5:] == ["**0.57** ± 0.15", "**0.50** ± 0.00", "**0.75** ± 0.00", "**0.80** ± 0.00"]
    assert any(line.startswith("- Our: trained on ten humans: one pass") for line in markdown(table).splitlines())
    assert r"\textbf{0.57}\,$\pm$0.15 & \textbf{0.50}\,$\pm$0.00" in latex(table)
    page = ENVIRONMENT.get_template("parts.html").module.score_table(frame.lines(table))
    assert re.search("<td class='first' title='95 %: [0-9.]+ to [0-9.]+'><b>0.57</b> ± 0.15</td>", page)
    (row,) = [row for row in rows_as_json([table]) if row["method"] == "learned"]
    assert (row["n_models"], row["NN"], row["title"], row["n_galleries"]) == (4, 0.566667, "Our", 3)
    # The folds have .7, .6 and .4: deviations 4/30, 1/30 and -5/30.
    assert row["spread"] == {"NN": round((42 / 900 / 2) ** 0.5, 6), "FT": 0.0, "ST": 0.0, "DCG": 0.0}
    assert json.loads(json.dumps(row)) == row
    header, *lines = (line.split(",") for line in as_csv([table]).splitlines())
    (values,) = [line for line in lines if "learned" in line]
    assert dict(zip(header, values, strict=True))["spread_NN"] == str(row["spread"]["NN"])


@pytest.mark.parametrize(("most", "told"), [(0.25, True), (0.011, True), (0.01, False), (0.0, False)])
def test_a_table_tells_how_much_preparation_lost(most, told):
    noted = {"lost_area": {"mean": 0.004, "max": most}}
    found = results(*(record(input_=input_, notes=noted) for input_ in ("mesh", "view")))
    lines = [line for table in contents(found) for line in notes(table) if "preparation lost" in line]
    expected = [
        f"Mesh input: preparation lost 0.4% of the area per shape on average, {most:.1%} at most.",
        f"View input: preparation lost 0.4% of what the camera sees per shape on average, {most:.1%} at most.",
    ]
    assert lines == (expected if told else [])
