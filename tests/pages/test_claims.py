"""The ten claims of the page on reproduction, each computed anew from published records.

A test says what its section must contain, from records alone, and asserts what the sentences say
in words. Other figures than these are not allowed there.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Mapping, Sequence
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import kendalltau, rankdata

from benchmark.pipeline.record_files import read_records
from benchmark.reference.paper import AS_PRINTED, CLASSICAL, PAPER_MEASURES, PAPERS_NETWORKS
from benchmark.report.notation import hundredths
from benchmark.report.rivals import compare_rivals
from benchmark.report.rows import RowScores
from benchmark.report.table_view import TableView
from benchmark.report.tables import table_views
from benchmark.report.verdicts import TOLERANCE, claims, classical_scores, is_near

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "reproduction.md"

#: What counts as a figure in the text of a claim, which is not a number of a table or data set.
FIGURE = re.compile(r"(?<![\w.])-?\.\d+\b|\b\d+(?:\.\d+)? %|\b\d+\.\d+\b|\b\d+ of \d+\b")

#: Differences below the last decimal of records are none.
SAME = 5e-7


def sections() -> dict[int, str]:
    """Return the text of each claim by its number, in one line."""
    parts = re.split(r"^## (\d+)\. ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {
        int(number): " ".join(text.split())
        for number, text in zip(parts[1::2], parts[2::2], strict=True)
    }


def says(number: int, *sentences: str) -> None:
    """Assert that a claim contains these words, and no other figures."""
    text = sections()[number]
    for sentence in sentences:
        assert sentence in text, f"claim {number} must say: {sentence}"
        text = text.replace(sentence, "", 1)
    links = re.compile(r"\]\([^)]*\)|`[^`]*`")
    assert FIGURE.findall(links.sub("", text)) == [], f"claim {number}: figures without a source"


@pytest.fixture(scope="module")
def every_view() -> list[TableView]:
    return table_views(read_records(ROOT / "results", local=False))


class Tables:
    """Rows of published tables by identifier, data set and column."""

    def __init__(self, views: Sequence[TableView]) -> None:
        self.views = {(view.table.identifier, view.dataset): view for view in views}

    def rows(self, table: str, data: str, column: str) -> dict[str, RowScores]:
        """Return the rows with scores."""
        view = self.views[table, data]
        return {row.method: row.scored[column] for row in view.rows if column in row.scored}

    def forms(self, table: str, data: str, column: str) -> dict[str, RowScores]:
        """Return the rows of canonical forms, no form among them."""
        view = self.views[table, data]
        names = {row.method for row in view.rows if row.kind == "form"}
        rows = self.rows(table, data, column)
        return {name: one for name, one in rows.items() if name in names}

    def chance(self, table: str, data: str, column: str) -> Mapping[str, float]:
        """Return the scores of a random order."""
        return self.views[table, data].chance[column]


@pytest.fixture(scope="module")
def tables(every_view: list[TableView]) -> Tables:
    return Tables(every_view)


PEOPLE = ("I", "people[draw=0]", "15 subjects")
SCANS = ("II", "humans-scanlike", "ours")
TOSCA = ("III", "tosca", "ours")
PEOPLE_SEEN = ("I-view", "people[draw=0]", "5 subjects")
SCANS_SEEN = ("II-view", "humans-scanlike", "ours")


def is_above(one: RowScores, other: RowScores) -> bool:
    """Return whether a row scores above another in every measure."""
    return all(one.means[name] > other.means[name] + SAME for name in PAPER_MEASURES)


def leads(rows: Mapping[str, RowScores], first: str, others: Sequence[str]) -> int:
    """Return in how many comparisons a row is ahead, significantly and above the scatter."""
    tested = compare_rivals({name: rows[name] for name in (first, *others)})
    means = [
        [rows[first].means[m] - rows[name].means[m] for m in PAPER_MEASURES] for name in others
    ]
    return int((tested.is_above_scatter[0, 1:] & (np.array(means) > 0)).sum())


def against_no_form(rows: Mapping[str, RowScores], sign: int = 1) -> tuple[int, int, int]:
    """Return in how many comparisons of a form with no form it is ahead, and in how many there are.

    Parameters
    ----------
    rows
        Scores of the eight forms and of no form.
    sign
        -1 for the comparisons in which it is behind.

    Returns
    -------
    tuple of int
        Comparisons in which it is ahead significantly and above the scatter; in which it is ahead;
        and all.
    """
    tested = compare_rivals({name: rows[name] for name in ("identity", *CLASSICAL)})
    none = rows["identity"].means
    gains = np.array(
        [[rows[name].means[m] - none[m] for m in PAPER_MEASURES] for name in CLASSICAL]
    )
    is_ahead = sign * gains > SAME
    return int((tested.is_above_scatter[0, 1:] & is_ahead).sum()), int(is_ahead.sum()), gains.size


def cells(values: Sequence[str]) -> str:
    """Return the cells of a line of a table."""
    return "| " + " | ".join(values) + " |"


def signed(value: float) -> str:
    """Return a correlation with two decimals and no leading zero."""
    return hundredths(value).replace("-0.", "-.")


def thousandths(value: float) -> str:
    """Return a share with three decimals, or two if it is at least a tenth."""
    return f"{value:.2f}".removeprefix("0") if value >= 0.1 else f"{value:.3f}".removeprefix("0")


def standardised(values: Sequence[float]) -> np.ndarray:
    """Return ranks with mean 0 and variance 1, whose mean product is the rank correlation."""
    ranks = rankdata(values)
    return np.asarray((ranks - ranks.mean()) / ranks.std())


def orders(printed: pd.DataFrame, ours: pd.DataFrame) -> tuple[pd.Series, pd.DataFrame]:
    """Return our rank correlations with the paper by measure, and those of all orders of rows."""
    every = np.array(list(permutations(range(len(ours)))))
    observed, possible = {}, {}
    for name in PAPER_MEASURES:
        first, second = standardised(printed[name]), standardised(ours[name].round(6))
        observed[name] = (first * second).mean()
        possible[name] = (first * second[every]).mean(axis=1)
    return pd.Series(observed), pd.DataFrame(possible)


def test_1_the_order_is_much_the_papers_in_dcg_and_ft(every_view):
    printed, ours = classical_scores(every_view)
    observed, possible = orders(printed, ours)
    assert len(possible) == 40_320
    alone = (possible >= observed - 1e-9).mean()
    largest = possible.max(axis=1).to_numpy()
    together = pd.Series(
        {name: (largest >= observed[name] - 1e-9).mean() for name in PAPER_MEASURES}
    )
    assert [name for name in PAPER_MEASURES if together[name] < 0.05] == ["FT", "DCG"]
    lowest = {"gps", "fast-mds"}
    assert {*printed["DCG"].nsmallest(2).index} == {*printed["FT"].nsmallest(2).index} == lowest
    rest = [name for name in CLASSICAL if name not in lowest]
    among, possible = orders(printed.loc[rest], ours.loc[rest])
    reached = 100 * (possible >= among - 1e-9).mean()
    assert abs(observed.NN) < 0.1
    says(
        1,
        "| rank correlation " + cells([signed(value) for value in observed]),
        "| share of orders " + cells([thousandths(value) for value in alone]),
        "| share, four measures at once " + cells([thousandths(value) for value in together]),
        f"the correlation is {hundredths(among.DCG)} in DCG and {hundredths(among.FT)} in FT. "
        f"Of all orders of these six, {reached.DCG:.0f} % agree with the paper at least as well "
        f"in DCG, and {reached.FT:.0f} % in FT.",
    )


def test_2_scores_agree_little_better_than_shuffled_ones(every_view):
    printed, ours = (frame.to_numpy() for frame in classical_scores(every_view))
    near = is_near(printed[:, None], ours).sum(axis=2)
    shuffled = near[range(8), [*permutations(range(8))]].sum(axis=1)
    reached = near.trace()
    share = (shuffled >= reached).mean()
    assert share >= 0.05
    constants = is_near(printed[:, None], printed + TOLERANCE).sum(axis=0).max(axis=0).sum()
    says(
        2,
        f"Of the paper's {printed.size} scores of classical methods, {reached} are within "
        f"{hundredths(TOLERANCE)} of ours.",
        f"{shuffled.mean():.1f} of them are within {hundredths(TOLERANCE)} on average. In "
        f"{100 * share:.0f} % of the random orders, at least {reached} are.",
        f"{constants} of the {printed.size} could be within {hundredths(TOLERANCE)}.",
        f"We set the limit of {hundredths(TOLERANCE)}",
    )


def test_3_no_form_is_shown_to_be_better_on_tosca(tables):
    lines, power = [], "find this difference in {:.0f} to {:.0f} % of cases"
    for name, place in (
        ("TOSCA", TOSCA),
        ("generated people", PEOPLE),
        ("generated scans", SCANS),
    ):
        rows = tables.rows(*place)
        tested = compare_rivals({form: rows[form] for form in CLASSICAL})
        pairs = [*combinations(range(len(CLASSICAL)), 2)]
        found = sum(int(tested.is_above_scatter[a, b].sum()) for a, b in pairs)
        n_above, n_leads, n_comparisons = against_no_form(rows)
        assert n_leads == n_comparisons
        lines.append(
            f"| {name} | {tested.n_classes} | {found} of {len(pairs) * len(PAPER_MEASURES)} | "
            f"{n_above} of {n_comparisons} |"
        )
        if name == "TOSCA":
            highest = hundredths(rows["skeleton"].means["NN"])
            assert not tested.is_significant.any()
        else:  # GPS is the best form, by all its comparisons
            forms = tables.forms(*place)
            others = [form for form in CLASSICAL if form != "gps"]
            assert all(is_above(rows["gps"], row) for form, row in forms.items() if form != "gps")
            assert leads(rows, "gps", others) == len(others) * len(PAPER_MEASURES)
    experiments = (ROOT / "results" / "experiments" / "README.md").read_text(encoding="utf-8")
    shares = pd.read_csv(ROOT / "results" / "experiments" / "power.csv").set_index("table")
    found_by_test = 100 * shares.loc["III", list(PAPER_MEASURES)]
    for title, table in (("complete surfaces", "III"), ("one depth view", "III-view")):
        line = re.search(rf"^\| {title} \|(( \d+ % \|)+)$", experiments, re.MULTILINE)
        printed = [float(share) for share in re.findall(r"\d+", line[1])]
        of_table = 100 * shares.loc[table, list(PAPER_MEASURES)]
        assert printed == pytest.approx(of_table.to_list(), abs=0.5 + 1e-9)
    power = power.format(min(found_by_test), max(found_by_test))
    text = sections()[3].replace(
        "](../../results/experiments/README.md#the-test-and-its-error-rates)", ""
    )
    assert power in text.replace("[", "")
    of_noise = "mean .85 (Table III:"
    assert of_noise in (ROOT / "docs" / "measurements.md").read_text(encoding="utf-8")
    copies = f"(This NN is {highest}. On copies of TOSCA with a noise of a millionth, it is [.85"
    says(
        3,
        copies,
        "better by .2 in every class",
        f"{min(found_by_test):.0f} to {max(found_by_test):.0f} %",
        *lines,
    )


def tau(first: Sequence[float], second: Sequence[float]) -> float:
    """Return how alike two orders are, by Kendall's tau-b."""
    return float(kendalltau(first, second).statistic)


def test_4_another_scorer_gives_another_order(tables):
    scores = pd.read_csv(ROOT / "results" / "figures" / "two-scorers.csv").query("input == 'mesh'")
    of = scores.set_index(["scorer", "measure", "method"])["value"]
    rows = tables.rows(*TOSCA)
    n_draws, random = 2000, np.random.default_rng(0)
    labels = np.array(rows["gps"].labels)
    classes = np.unique(labels)
    sizes = np.array([(labels == label).sum() for label in classes])
    by_scorers, by_features, by_classes = [], [], []
    for number, name in enumerate(PAPER_MEASURES):
        ours, other = (
            np.array([of[scorer, name, form] for form in CLASSICAL])
            for scorer in ("cm-bof", "spherical-harmonics")
        )
        by_scorers.append(tau(ours, other))

        errors = [rows[form].all_records[0].draw_errors[name] for form in CLASSICAL]
        noise = random.normal(0, errors, (n_draws, 2, len(CLASSICAL)))
        drawn = [tau(ours + first, ours + second) for first, second in noise]
        by_features.append(np.mean(drawn))
        assert by_scorers[-1] < np.quantile(drawn, 0.05)

        values = np.array([rows[form].values[:, number] for form in CLASSICAL])
        sums = np.array([values[:, labels == label].sum(axis=1) for label in classes])
        chosen = random.integers(0, len(classes), (n_draws, len(classes)))
        drawn = [tau(ours, sums[nine].sum(axis=0) / sizes[nine].sum()) for nine in chosen]
        by_classes.append(np.mean(drawn))
        changes_more = by_scorers[-1] < np.quantile(drawn, 0.05)
        assert changes_more == (name == "NN")
    says(
        4,
        "| another scorer " + cells([signed(value) for value in by_scorers]),
        "| other features " + cells([signed(value) for value in by_features]),
        "| other classes " + cells([signed(value) for value in by_classes]),
    )


def test_5_two_descriptors_score_above_every_form(tables):
    lines = {"si-hks": ["SI-HKS"], "shape-dna": ["ShapeDNA"]}
    best = ["best form"]
    for place, best_form in ((PEOPLE, "gps"), (SCANS, "gps"), (TOSCA, "mesh-unfolding")):
        rows, forms = tables.rows(*place), tables.forms(*place)
        assert {*CLASSICAL, "identity"} <= forms.keys()
        for name, line in lines.items():
            assert all(is_above(rows[name], form) for form in forms.values()), (place, name)
            line.append(f"{hundredths(rows[name].means['DCG'])}, {leads(rows, name, CLASSICAL)}")
        assert max(forms, key=lambda name: forms[name].means["DCG"]) == best_form
        best.append(hundredths(forms[best_form].means["DCG"]))
    says(5, *(cells(line) for line in (*lines.values(), best)))


def test_6_size_alone_finds_generated_people(tables):
    for place in (PEOPLE, PEOPLE_SEEN, ("I-view", "people[draw=0]", "15 subjects")):
        rows = tables.rows(*place)
        forms = tables.forms(*place).values()
        assert all(is_above(rows["surface-area"], form) for form in forms)
        n_above = 31 if place == ("I-view", "people[draw=0]", "15 subjects") else 32
        assert leads(rows, "surface-area", CLASSICAL) == n_above
    people, scans = (tables.rows(*place) for place in (PEOPLE_SEEN, SCANS_SEEN))
    with_size, without = (
        [rows[name].means["NN"] for rows in (people, scans)]
        for name in ("learned", "learned-size-free")
    )
    pair = "learned", "learned-size-free"
    assert compare_rivals({name: scans[name] for name in pair}).is_above_scatter[0, 1].all()
    everybody = tables.rows("I-view", "people[draw=0]", "15 subjects")
    for of_people in (people, everybody):
        tested = compare_rivals({name: of_people[name] for name in pair})
        assert not tested.is_significant.any()
    chance = tables.chance(*SCANS_SEEN)["NN"]
    faust = ("faust", "faust", "mesh")
    area = tables.rows(*faust)["surface-area"].means["NN"]
    says(
        6,
        f"NN falls from {hundredths(with_size[1])} to {hundredths(without[1])} "
        f"(chance {hundredths(chance)}).",
        f"area has NN {hundredths(area)} (chance {hundredths(tables.chance(*faust)['NN'])}).",
    )


def test_7_the_network_is_not_shown_to_add_more_than_the_outline(tables):
    rows = tables.rows(*PEOPLE_SEEN)
    average, flat = "learned-average", "learned-flat"
    for name in ("learned", average):
        assert leads(rows, name, CLASSICAL) == 32
    ft, st = (PAPER_MEASURES.index(name) for name in ("FT", "ST"))
    tested = compare_rivals({name: rows[name] for name in (average, "learned")})
    assert [*np.flatnonzero(tested.is_significant[0, 1])] == [st]
    assert not tested.is_above_scatter[0, 1, st]
    assert rows[average].means["ST"] > rows["learned"].means["ST"]
    tested = compare_rivals({name: rows[name] for name in ("learned", flat)})
    assert tested.is_significant[0, 1, ft]
    assert not tested.is_above_scatter[0, 1, ft]
    trainings = zip(rows["learned"].all_records, rows[flat].all_records, strict=True)
    falls = [one.scores["FT"] - other.scores["FT"] for one, other in trainings]
    assert len(falls) == 6 and min(falls) > 0.1
    ranges = [one.scores["FT"] for one in rows["learned"].all_records]
    assert np.ptp(ranges) > rows["learned"].means["FT"] - rows[flat].means["FT"]

    strict = tables.rows("IV", "people[draw=0]", "ours")["learned-strict"]
    with_strict = {**rows, "learned-strict": strict}
    assert all(is_above(strict, form) for form in tables.forms(*PEOPLE_SEEN).values())
    fts = [hundredths(rows[name].means["FT"]) for name in ("learned", flat)]
    sts = [hundredths(rows[name].means["ST"]) for name in (average, "learned")]
    nns = [hundredths(row.means["NN"]) for row in (strict, rows["learned"])]
    says(
        7,
        f"ST {sts[0]} instead of {sts[1]};",
        f"FT falls from {fts[0]} to {fts[1]}.",
        f"have NN {nns[0]} instead of {nns[1]}.",
        f"only {leads(with_strict, 'learned-strict', CLASSICAL)} of 32 differences are",
    )


def test_8_two_networks_score_above_the_forms_on_real_people(tables):
    place, best, second = ("faust", "faust", "view"), "learned-streamed", "learned-wide-extra"
    rows, forms = tables.rows(*place), tables.forms(*place)
    assert {*CLASSICAL} < forms.keys()
    assert rows["learned"].means["NN"] < rows["identity"].means["NN"]
    assert leads(rows, "learned", [*forms]) < leads(rows, best, [*forms])
    networks = {row.method for row in tables.views[place[:2]].rows if row.kind == "network"}
    above = {
        name
        for name in networks & rows.keys()
        if all(is_above(rows[name], form) for form in forms.values())
    }
    assert above == {best, second}
    assert all(len(rows[name].all_records) == 1 for name in above)
    surfaces = tables.rows("faust", "faust", "mesh")
    forms_of_surfaces = tables.forms("faust", "faust", "mesh")
    for name in ("si-hks", "shape-dna"):
        assert all(is_above(surfaces[name], form) for form in forms_of_surfaces.values())
    others = [name for name in forms_of_surfaces if name != "gps"]
    assert all(is_above(surfaces["gps"], forms_of_surfaces[name]) for name in others)
    tested = compare_rivals({name: surfaces[name] for name in ("gps", *others)})
    assert not tested.is_significant[0].any()
    nn = {name: hundredths(one.means["NN"]) for name, one in rows.items()}
    highest = max(nn[form] for form in forms)
    says(
        8,
        f"Its NN is {nn['learned']}, and the original bodies have NN {nn['identity']}.",
        f"({leads(rows, 'learned', [*forms])} of {len(PAPER_MEASURES) * len(forms)} comparisons)",
        f"its NN is {nn[best]}.",
        f"{leads(rows, best, [*forms])} of {len(PAPER_MEASURES) * len(forms)} comparisons",
        f"Its NN is {nn[second]}, and the highest NN of a form is {highest}.",
        f"{leads(rows, second, [*forms])} of {len(PAPER_MEASURES) * len(forms)} comparisons",
    )


def test_on_scans_two_networks_score_above_every_form_as_the_page_on_networks_says(tables):
    rows, forms = tables.rows(*SCANS_SEEN), tables.forms(*SCANS_SEEN)
    for name in ("learned-wide-extra", "learned-streamed"):
        assert all(is_above(rows[name], form) for form in forms.values())
        assert leads(rows, name, [*forms]) == len(forms) * len(PAPER_MEASURES)


def test_9_a_view_is_not_its_surface(tables):
    columns = "against views", "against complete surfaces"
    best = [
        max(one.means["NN"] for one in tables.forms("III-cross", "tosca", column).values())
        for column in columns
    ]
    people = ("I-cross", "people[draw=0]", columns[1])
    most = max(one.means["NN"] for one in tables.rows(*people).values())
    own, extra = "against 12 cameras", "learned-wide-extra"
    cameras = tables.rows("II-cameras", "humans-scanlike", own)
    others = max(one.means["NN"] for name, one in cameras.items() if name != extra)
    before = tables.rows(*SCANS_SEEN)[extra].means["NN"]
    behind = []
    for place in (("III-view", "tosca", "all shapes"), ("faust", "faust", "view")):
        assert against_no_form(tables.rows(*place))[0] == 0
        behind.append(against_no_form(tables.rows(*place), sign=-1))
    (of_tosca, n_tosca, n_all), (of_faust, n_faust, _) = behind
    assert n_tosca == n_faust
    assert of_tosca > 0 and of_faust > 0
    says(
        9,
        f"score below *no form* in {n_tosca} of {n_all} comparisons.",
        f"the best form has NN {hundredths(best[0])} if views are compared with views.",
        f"compared with complete surfaces, the best form has NN {hundredths(best[1])}.",
        f"the NN of every form and of every descriptor is at most {hundredths(most)} "
        f"(chance {hundredths(tables.chance(*people)['NN'])}).",
        f"has NN {hundredths(before)} if both views come from the same camera.",
        f"With the twelve other cameras, it has NN {hundredths(cameras[extra].means['NN'])}.",
        f"The NN of every other method is at most {hundredths(others)}.",
    )


def test_10_no_network_decides_a_claim_on_the_papers_data(every_view):
    judged = [one for one in claims(every_view) if one.claim.better in PAPERS_NETWORKS]
    of_tosca = {one.claim.better: one.decision for one in judged if one.claim.table == "III"}
    assert of_tosca == dict.fromkeys([AS_PRINTED, "learned"], "not decidable: 5 classes")
    others = {one.claim.table: one.data for one in judged if one.claim.table != "III"}
    assert others.keys() == {"I", "II", "IV"}
    assert all("stand-in" in data for data in others.values())
    decided = {one.decision for one in judged if one.claim.better == AS_PRINTED}
    assert not any(word in text for text in decided for word in ("holds", "fails", "open"))
    says(10)


# The page itself
# ------------------------------------------------------------------------------------------------


def named_tests() -> dict[int, str]:
    """Return the names of the tests above by the number of their claim."""
    module = sys.modules[__name__]
    names = [name for name, _ in inspect.getmembers(module, inspect.isfunction)]
    found = [re.fullmatch(r"test_(\d+)_\w+", name) for name in names]
    return {int(match[1]): match[0] for match in found if match}


def test_there_are_ten_claims_and_each_names_its_tables_and_its_test():
    named = named_tests()
    assert sections().keys() == {*range(1, 11)} == named.keys()
    for number, text in sections().items():
        assert re.search(r"\]\(\.\./\.\./results/tables/[\w-]+\.md\)", text), number
        assert f"`{named[number]}`" in text, number
