"""The guide says what records and measurements say, and its parts are what their functions make."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmark.commands.score import score
from benchmark.reference.paper import CLASSICAL, PAPER_MEASURES
from benchmark.registry import select
from tests.pages.test_readme import ROOT, every_view, rows, scores, views  # noqa: F401
from tools import guide_figures, page_parts
from tools.failures import failure_of, means_of_classes, published_forms
from tools.form_costs import COSTS, METHODS, SIZES
from tools.page_parts import PARTS, pages_with_parts, with_parts

FORMS = (ROOT / "docs/guide/forms.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", pages_with_parts(), ids=lambda page: page.stem)
def test_parts_of_a_page_are_what_their_functions_make(page: Path):
    text = page.read_text(encoding="utf-8")
    assert with_parts(text) == text, "write them with 'python -m tools.page_parts'"


def test_each_part_stands_on_a_page():
    text = "".join(page.read_text(encoding="utf-8") for page in pages_with_parts())
    assert [name for name in PARTS if f"<!-- part: {name} -->" not in text] == []


def test_each_form_has_a_picture_a_source_and_a_cost():
    for method in METHODS:
        assert FORMS.count(f"(../../results/figures/guide-{method}.png)") == 1, method
        assert FORMS.count(f"(../../results/figures/fails-{method}.png)") == 1, method
        assert FORMS.count(f"|`{method}`|") == 2, method
    n_lines = len(COSTS.read_text(encoding="utf-8").splitlines())
    assert n_lines == 1 + len(METHODS) * len(SIZES)
    assert FORMS.count("```math") == len(METHODS) + 1
    assert FORMS.count("*Source:*") + FORMS.count("*Sources:*") == len(METHODS)


def test_every_form_of_the_suite_is_in_the_guide_and_every_method_on_the_page_of_names():
    methods = [method for method in select(["all"]) if not method.learns]
    forms = {m.name for m in methods if not m.describes and m.info.family != "control"}
    assert {*METHODS} == forms, "name it in tools/form_costs.py, and write its section"
    page = (ROOT / "docs/reference/methods.md").read_text(encoding="utf-8")
    table = page.partition("|---|")[2].partition("\n\n")[0]
    assert [method.name for method in methods if f"`{method.name}`" not in table] == []


def test_gps_scores_highest_and_unfolding_misses_most_people(scores):  # noqa: F811
    forms = {name: scores["I_all"][name] for name in CLASSICAL}
    assert {max(forms, key=lambda name: forms[name][measure]) for measure in PAPER_MEASURES} == {
        "gps"
    }
    assert min(forms, key=lambda name: forms[name]["NN"]) == "mesh-unfolding"


def test_all_forms_fail_on_david_who_is_taken_for_another():
    rows_of_table = [line.split("|")[2:5] for line in page_parts.worst_classes().splitlines()[2:]]
    assert {label for label, *_ in rows_of_table} == {"david"}
    taken_for = {other for *_, others in rows_of_table for other in others.split(", ")}
    assert taken_for == {"michael", "victoria"}
    without = means_of_classes(published_forms()["identity"])
    assert min(without, key=lambda label: without[label]) == "david"


def test_the_five_shapes_are_those_of_the_page_and_chance_is_high():
    text = (ROOT / "docs/guide/measures.md").read_text(encoding="utf-8")
    block = text.partition("```text\n")[2].partition("```")[0]
    shown = [line.split() for line in block.splitlines()]
    lines = (ROOT / "docs/guide/five-shapes.csv").read_text(encoding="utf-8").splitlines()
    assert shown == [[cell for cell in line.split(",") if cell] for line in lines]
    scored = score(ROOT / "docs/guide/five-shapes.csv", ROOT / "docs/guide/five-shapes.txt")
    assert scored.scores.loc["ST", "chance"] == pytest.approx(0.8)
    made = page_parts.five_shapes()
    assert "|cat0|cat1 ✓|dog0 ✗|cat2 ✓|dog1 ✗|1.00|.50|1.00|" in made
    assert "|dog0|cat0 ✗|cat2 ✗|dog1 ✓|cat1 ✗|.00|.00|.00|.63|" in made


def test_the_failure_of_a_form_is_a_query_of_its_worst_class_with_a_wrong_match():
    for method, record in published_forms().items():
        if method not in METHODS:
            continue
        failure = failure_of(record)
        label_of = dict(zip(record.shapes, record.labels, strict=True))
        means = means_of_classes(record)
        assert failure.label == min(means, key=lambda label: means[label])
        assert failure.score == means[failure.label]
        assert label_of[failure.query] == label_of[failure.right] == failure.label
        assert label_of[failure.found] != failure.label
        assert failure.rank > 1


def test_pictures_of_the_guide_show_complete_surfaces_and_name_the_run_that_they_lack(monkeypatch):
    def record(method, **changes):
        facts = {"input": "mesh", "scorer": "cm-bof", "shapes": guide_figures.SHAPES}
        data = SimpleNamespace(name="animals", quick=True)
        return SimpleNamespace(**{**facts, "method": method, "data": data, **changes})

    forms = [record(name) for name in ("identity", *METHODS)]
    later = [record("gps", input="view"), record("gps", scorer="spherical-harmonics")]
    monkeypatch.setattr(guide_figures, "read_records", lambda *_, **__: [*forms, *later])
    assert [*guide_figures.records_of(ROOT).values()] == forms
    monkeypatch.setattr(guide_figures, "read_records", lambda *_, **__: [*forms[:-2], *later])
    lacking = " -m ".join(METHODS[-2:])
    with pytest.raises(SystemExit, match=f"run `.*--quick --input mesh .* -m {lacking}`"):
        guide_figures.records_of(ROOT)
