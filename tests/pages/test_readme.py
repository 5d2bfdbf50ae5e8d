"""What the README and the page on reproduction say of the tables is what the published records say."""

import json
import re
from collections import Counter
from pathlib import Path

import pytest

from benchmark.check import check
from benchmark.pipeline.records import read_records
from benchmark.reference.paper import CLASSICAL, MEASURES, PRINTED
from benchmark.registry import find
from benchmark.report.formats import hundredths
from benchmark.report.tables import table_views
from benchmark.report.verdicts import claims, verdicts
from tests.verbs import call

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
TABLES = ROOT / "results" / "tables"
REPRODUCTION = (ROOT / "docs" / "explanation" / "reproduction.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def every_view():
    return table_views(read_records(ROOT / "results", local=False))


@pytest.fixture(scope="module")
def views(every_view):
    return {view.table.identifier: view for view in every_view if view.dataset != "animals"}


def unwrapped(text):
    return " ".join(text.split())


def shown(view, title, column):
    """NN and DCG of a row as printed; "" if it has none."""
    if title == "Random order":
        scores = view.chance[column]
    else:
        row = next(row for row in view.rows if row.title == title)
        scores = row.scored[column].means if column in row.scored else {}
    return f"{hundredths(scores['NN'])} {hundredths(scores['DCG'])}" if scores else ""


def test_the_rows_of_the_readme_are_those_of_the_tables(views):
    lines = re.findall(r"^\|([^|]+)\|([^|]*)\|([^|]*)\|([^|]*)\|$", README, re.MULTILINE)
    rows = [[cell.strip() for cell in line] for line in lines if line[0].strip() not in ("Method", "---")]
    assert len(rows) == 6
    for title, paper, surfaces, view in rows:
        assert view == shown(views["III-view"], title, "all shapes")
        if not title.startswith("Depth"):
            assert surfaces == shown(views["III"], title, "ours")
        if paper:
            figures = PRINTED["III"][next(row.method for row in views["III"].rows if row.title == title)]
            assert paper == f"{hundredths(figures['NN'])} {hundredths(figures['DCG'])}"


def test_21_of_32_classical_figures_of_tosca_come_out_again(every_view):
    counts = Counter(verdict for figures in verdicts(every_view).values() for *_, verdict in figures)
    assert (counts["reproduced"], counts["same order"], counts["otherwise"]) == (21, 4, 7)
    assert "21 of the paper's 32 scores of classical methods are within .05 of ours" in unwrapped(README)
    assert "21 of 32 scores of classical methods differ by at most .05, four" in unwrapped(REPRODUCTION)


def test_chance_comes_as_near_to_the_papers_real_humans_as_any_figure_can(views):
    chance = views["II"].chance["ours"]
    near = [abs(PRINTED["II"][name][m] - chance[m]) <= 0.05 for name in CLASSICAL for m in MEASURES]
    sentence = f"Of the paper's {len(near)} scores of classical methods, {sum(near)} are within .05 of a random order's"
    assert sentence in unwrapped(README)
    fair = {row.method: row.scored["ours"].means["NN"] for row in views["II-view"].rows if row.scored}
    assert all(fair[name] < 0.1 for name in CLASSICAL if name != "gps")


@pytest.mark.parametrize(("table", "column"), [("I", "5 subjects"), ("III", "ours")])
def test_the_surface_area_beats_every_canonical_form_of_complete_surfaces(views, table, column):
    scores = {row.method: row.scored[column].means for row in views[table].rows if column in row.scored}
    forms = [row.method for row in views[table].rows if row.kind == "form" and row.method in scores]
    assert len(forms) >= 9
    assert all(scores["surface-area"][m] > scores[name][m] for name in forms for m in MEASURES)
    assert scores["si-hks"]["NN"] >= 0.975 - 5e-7


def test_claims_are_decided_as_the_page_says(every_view):
    found = {(one.claim.words, one.claim.better): one.decision for one in claims(every_view)}
    assert found["Poses seen in training are found better.", "learned"] == "supported"
    assert found["Long-range features help.", "learned"] == "undecided"


def test_of_the_galleries_that_the_text_allows_only_all_80_shapes_fit_table_three():
    values = [PRINTED["III"][name]["NN"] for name in CLASSICAL]

    def fits(value: float, queries: int) -> bool:
        return any(abs(round(hits / queries + 1e-9, 2) - value) < 1e-9 for hits in range(queries + 1))

    assert [all(fits(value, n) for value in values) for n in (19, 41, 80)] == [False, False, True]


def test_committed_tables_are_those_of_the_published_records(tmp_path):
    words = ("tables", "--published", "--results", ROOT / "results", "-o")
    call(*words, tmp_path / "all")
    made, committed = ({path.name: path.read_bytes() for path in f.iterdir()} for f in (tmp_path / "all", TABLES))
    assert made == committed
    assert json.loads(made["tables.json"])
    call(*words, tmp_path / "one", "-t", "robustness")
    assert (tmp_path / "one" / "robustness.md").read_bytes() == committed["robustness.md"]


def test_the_plugin_of_the_readme_keeps_the_contract(tmp_path):
    (block,) = (text for text in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "BiharmonicMDS" in text)
    path = tmp_path / "biharmonic.py"
    path.write_text(block, encoding="utf-8")
    (component,) = find(str(path))
    assert {finding.outcome for finding in check(component)} == {"ok"}
