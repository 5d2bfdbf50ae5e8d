"""What the README and the page on reproduction say of the tables is what the published records say."""

import csv
import json
import re
from collections import Counter
from pathlib import Path

import pytest

from benchmark.check import check
from benchmark.pipeline.records import read_records
from benchmark.reference.paper import AS_PRINTED, CLASSICAL, MEASURES, PRINTED
from benchmark.registry import find
from benchmark.report.formats import hundredths
from benchmark.report.tables import table_views
from benchmark.report.verdicts import claims, verdicts, verdicts_markdown
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
    assert (counts["reproduced"], counts["same order"], counts["otherwise"]) == (21, 2, 9)
    assert "21 of the paper's 32 scores of classical methods are within .05 of ours" in unwrapped(README)
    assert "21 of 32 scores of classical methods differ by at most .05, two" in unwrapped(REPRODUCTION)


def test_chance_comes_as_near_to_the_papers_real_humans_as_any_figure_can(views):
    chance = views["II"].chance["ours"]
    near = [abs(PRINTED["II"][name][m] - chance[m]) <= 0.05 for name in CLASSICAL for m in MEASURES]
    sentence = f"Of the paper's {len(near)} scores of classical methods, {sum(near)} are within .05 of a random order's"
    assert sentence in unwrapped(README)
    fair = {row.method: row.scored["ours"].means["NN"] for row in views["II-view"].rows if row.scored}
    assert all(fair[name] < 0.1 for name in CLASSICAL if name != "gps")


@pytest.mark.parametrize(("table", "column"), [("I", "5 subjects"), ("III", "ours")])
def test_the_surface_area_beats_every_canonical_form_but_skeletons_in_nn(views, table, column):
    scores = {row.method: row.scored[column].means for row in views[table].rows if column in row.scored}
    forms = [row.method for row in views[table].rows if row.kind == "form" and row.method in scores]
    assert len(forms) >= 9
    better = [(name, m) for name in forms for m in MEASURES if scores["surface-area"][m] <= scores[name][m]]
    assert better == ([("skeleton", "NN")] if table == "III" else [])
    assert scores["si-hks"]["NN"] >= 0.975 - 5e-7


def scores(view, method, column):
    """NN FT ST DCG of a row as printed."""
    (row,) = (row for row in view.rows if row.method == method)
    return " ".join(hundredths(row.scored[column].means[name]) for name in MEASURES)


def test_what_the_count_of_reproduced_scores_is_worth_stands_beside_it(every_view):
    text = unwrapped(verdicts_markdown(every_view))
    mean, share, order = re.search(r"random, (.*?) are .*?and (\d+)% .*?paper: (.*?)\. Each", text).groups()
    assert f"exchanged at random, {mean} on average" in unwrapped(README)
    assert f"exchanged at random, {mean} scores are reproduced on average, and {share} % of" in unwrapped(REPRODUCTION)
    nn, *others = [word.split()[1] for word in order.split(", ")]
    assert f"rank correlations {', '.join(others)}), NN does not ({nn})" in unwrapped(REPRODUCTION)
    assert f"rank correlations {min(others)} to {max(others)}), NN does not ({nn})" in unwrapped(README)


def test_claims_are_decided_as_the_pages_say(every_view):
    found = {(one.claim.table, one.claim.better, one.claim.words.split()[0]): one for one in claims(every_view)}
    of_network = {(table, better): one for (table, better, first), one in found.items() if first == "The"}
    decisions = {place: one.decision for place, one in of_network.items()}
    assert decisions == {
        ("I", AS_PRINTED): "undecided", ("I", "learned"): "supported",
        ("II", AS_PRINTED): "contradicted", ("II", "learned"): "undecided",
        ("III", AS_PRINTED): "not comparable", ("III", "learned"): "not decidable: 5 classes",
    }  # fmt: skip
    assert found["IV", "learned", "Poses"].decision == "supported"
    assert of_network["I", AS_PRINTED].leads == of_network["I", "learned"].leads == 32
    real, unseen = of_network["II", "learned"], of_network["III", "learned"]
    assert f"leads in {real.leads} of {real.n_comparisons} comparisons, {real.certain} of them" in unwrapped(
        REPRODUCTION
    )
    lost = of_network["II", AS_PRINTED]
    assert f"leads in {lost.leads} of {lost.n_comparisons} comparisons (NN" in unwrapped(REPRODUCTION)
    assert (unseen.queries, unseen.n_queries) == (58, 80)
    for page in (README, REPRODUCTION):
        assert f"leads in {unseen.leads} of {unseen.n_comparisons} comparisons" in unwrapped(page)


def test_the_visible_area_and_identity_are_as_good_as_the_pages_say(views):
    area, printed, small = (scores(views["I-view"], m, "5 subjects") for m in ("surface-area", AS_PRINTED, "learned"))
    sentence = f"({area}) beats the network as printed in all measures, and the one at 128 pixels in FT and ST"
    assert sentence in unwrapped(REPRODUCTION)
    assert f"the visible area alone ({area[:3]}) beats the network with the paper's training" in unwrapped(README)
    assert all(ours > theirs for ours, theirs in zip(area.split(), printed.split(), strict=True))
    assert [ours > theirs for ours, theirs in zip(area.split(), small.split(), strict=True)] == [
        False,
        True,
        True,
        False,
    ]
    identity, best = (scores(views["III-view"], name, "all shapes") for name in ("identity", "mesh-unfolding"))
    assert f"identity ({identity}) equals the best form, mesh unfolding ({best})" in unwrapped(REPRODUCTION)


def test_networks_and_the_best_forms_of_people_have_the_nn_of_the_readme(views):
    def nn(table, column, *methods):
        rows = {row.method: row.scored[column].means["NN"] for row in views[table].rows if column in row.scored}
        return hundredths(max(rows[method] for method in methods or CLASSICAL))

    printed, small = (nn("I-view", "5 subjects", name) for name in (AS_PRINTED, "learned"))
    assert f"Its NN is {printed} with the paper's training (500 x 500 pixels, 500 epochs), not" in unwrapped(README)
    assert f"not certainly above GPS, and {small} at 128 x 128 pixels" in unwrapped(README)
    best = nn("I-view", "5 subjects"), nn("I", "5 subjects")
    assert f"The best classical form has {best[0]}, or {best[1]} from complete surfaces." in unwrapped(README)
    printed, small = (nn("II-view", "ours", name) for name in (AS_PRINTED, "learned"))
    of_gps = nn("II-view", "ours", "gps")
    assert f"(NN {printed}) loses to the classical form GPS ({of_gps}). At 128" in unwrapped(README)
    assert f"it has {small}, too" in unwrapped(README) and small == of_gps == nn("II-view", "ours")


def test_figures_of_experiments_are_those_of_their_file():
    folder = ROOT / "results" / "experiments"
    known = {float(row["value"]) for row in csv.DictReader((folder / "experiments.csv").open(encoding="utf-8"))}
    lines = [line for line in (folder / "README.md").read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    printed = [word for line in lines for word in re.findall(r"(?<![\w.])\.\d+", line)]
    assert len(printed) > 80
    for word in printed:
        assert any(abs(value - float(word)) <= 0.5 * 10.0 ** (1 - len(word)) + 1e-9 for value in known), word


def test_committed_tables_are_those_of_the_published_records(tmp_path):
    words = ("tables", "--published", "--paper", "--results", ROOT / "results", "-o")
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
