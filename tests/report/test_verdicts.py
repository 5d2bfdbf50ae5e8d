"""Verdicts on the paper's figures and claims."""

import numpy as np
from pandas import DataFrame

from benchmark.datasets.official import SETS
from benchmark.protocols.tables import SYNTHETIC_HUMANS
from benchmark.reference.paper import AS_PRINTED, CLASSICAL, PAPER_MEASURES, PRINTED, Claim
from benchmark.report import data_titles, verdicts
from benchmark.report.tables import table_views
from benchmark.report.verdicts import (
    _reproduced_by_chance,
    assess,
    classical_scores,
    is_near,
    verdicts_markdown,
)
from tests.report.records import by_class, record


def test_a_figure_is_reproduced_up_to_five_hundredths_and_a_row_that_is_incomplete_has_none():
    nn = {name: PRINTED["III"][name]["NN"] for name in CLASSICAL} | {
        "gps": 0.76,
        "skeleton": 0.8301,
    }
    rows = [record(name, nn[name], dataset="tosca") for name in CLASSICAL]
    rows[0] = record(CLASSICAL[0], 0.74, dataset="tosca", unsupported=[("cat0", "too thin")])
    printed, ours = classical_scores(table_views(rows))
    assert list(is_near(printed, ours).NN) == [False, *[True] * 6, False]
    assert list(is_near(np.array([0.9, 0.9]), np.array([0.85, 0.8499]))) == [True, False]
    assert "|GPS|.71 .76 =|" in verdicts_markdown(table_views(rows))
    assert "|Classic MDS|.74 --|.54 --|.80 --|.80 --|" in verdicts_markdown(table_views(rows))


def test_figures_are_judged_on_tosca_alone():
    on_stand_in = [record(name, 0.5, dataset="animals", stand_in_for="tosca") for name in CLASSICAL]
    assert classical_scores(table_views(on_stand_in)) is None
    assert "Table III" not in verdicts_markdown(table_views(on_stand_in))


def test_quick_runs_give_no_verdicts():
    rows = [record(name, 0.74, dataset="tosca", quick=True) for name in CLASSICAL]
    assert verdicts_markdown(table_views(rows)) == ""


def claim_on(better, *others, measures=("NN",)):
    return Claim("One is better.", "III", better, others, measures)


def judged(claim, *records):
    return assess(claim, table_views(records)[0])


def test_a_claim_needs_other_classes_to_hold():
    labels = [name for name in "abcdefgh" for _ in range(3)]
    high, low, mixed = (
        record(name, by_class(values, labels), labels=labels)
        for name, values in {
            "high": dict.fromkeys("abcdefgh", 0.9),
            "low": dict.fromkeys("abcdefgh", 0.1),
            "mixed": dict(zip("abcdefgh", (1.0, 1.0, 1.0, 1.0, 0.2, 0.2, 0.2, 0.2), strict=True)),
        }.items()
    )
    assert judged(claim_on("high", "low"), high, low).decision == "holds on the stand-in"
    assert judged(claim_on("low", "high"), high, low).decision == "fails on the stand-in"
    assert judged(claim_on("high", "mixed"), high, mixed).decision == "open on the stand-in"
    assert judged(claim_on("high", "none"), high, low).decision == (
        "not comparable: no complete scores of none"
    )
    assert assess(claim_on("high", "low"), None).decision == (
        "not comparable: the table has no scores"
    )


def test_a_row_that_lacks_a_shape_of_another_decides_nothing():
    """The shape counts 0, which would be a lead of the other row."""
    labels = [name for name in "abcdefgh" for _ in range(3)]
    lacks = {"labels": labels, "unsupported": [("a0", "too thin")]}
    rows = [record(name, nn, **lacks) for name, nn in (("high", 0.9), ("low", 0.1))]
    assert judged(claim_on("high", "low"), *rows).decision == "holds on the stand-in"
    whole = record("high", 0.9, labels=labels)
    assert judged(claim_on("high", "low"), whole, rows[1]).decision == (
        "not comparable: no complete scores of Low"
    )


def test_queries_of_classes_that_a_row_has_seen_decide_nothing():
    """A lead on training shapes is none: every other class is behind."""
    labels = [name for name in "abcdefghi" for _ in range(2)]
    seen = record("net", [1.0, 1.0, *[0.2] * 16], labels=labels, seen=["a0"])
    rows = [seen, record("gps", 0.3, labels=labels)]
    one = judged(claim_on("net", "gps"), *rows)
    found = (one.decision, one.n_unseen, one.n_queries, one.leads)
    assert found == ("fails on the stand-in", 16, 18, 0)
    assert judged(claim_on("gps", "net"), *rows).decision == "holds on the stand-in"
    few = judged(claim_on("net", "gps"), record("net", 1.0, seen=["cat1"]), record("gps", 0.5))
    assert (few.decision, few.n_unseen, few.leads) == ("not decidable: 2 classes", 8, 1)
    none = judged(
        claim_on("net", "gps"), record("net", seen=["cat0", "dog4", "owl8"]), record("gps")
    )
    assert none.decision == "not comparable: no class is unseen in training"
    assert (none.n_unseen, none.n_queries) == (0, 12)


def test_claims_say_how_many_queries_decide():
    labels = [name for name in "abcdefghi" for _ in range(2)]
    rows = [record(name, 0.1, dataset="tosca", input_="view", labels=labels) for name in CLASSICAL]
    rows.append(
        record(
            "learned",
            0.9,
            dataset="tosca",
            input_="view",
            labels=labels,
            models=[],
            seen=["a0", "b3"],
        )
    )
    text = verdicts_markdown(table_views(rows))
    assert "|Depth network, 128 px|III|not decidable: 7 classes|14 of 18|8 of 24|" in text


def test_of_several_trainings_each_must_lead():
    humans = {"dataset": SYNTHETIC_HUMANS[0], "fold": "fold 0", "input_": "view", "models": []}
    labels = [name for name in "abcdefgh" for _ in range(3)]
    better = [
        record(name, nn, labels=labels, **humans)
        for name, nn in (("learned", 0.9), ("learned[training_seed=1]", 0.3))
    ]
    other = record("learned-without-srf", 0.5, labels=labels, **humans)
    rest = [
        record(r.method, 0.5, labels=labels, **{**humans, "fold": f"fold {k}"})
        for r in (*better, other)
        for k in (1, 2)
    ]
    (view,) = table_views([*better, other, *rest], ["IV"])
    assert assess(claim_on("learned", "learned-without-srf"), view).above_scatter == 0


def test_the_count_stands_beside_that_of_exchanged_rows_by_hand():
    printed, ours = (
        DataFrame(dict.fromkeys(PAPER_MEASURES, of)) for of in ([0.1, 0.5, 0.5], [0.1, 0.5, 0.9])
    )
    text = _reproduced_by_chance(printed, ours)
    # Of the six exchanges, a stays in two, b's figure falls on b or c in four: 8, 8, 4, 4, 0 and 0
    # figures.
    assert text.startswith(
        "With our rows exchanged at random, 4.0 are reproduced on average, and 33% of all exchanges"
    )
    assert (
        "reproduce 8 or more; the mean of each of our columns reproduces 8, and one" in text
    )  # .50 is near b and c
    assert "one constant for each measure, chosen in hindsight, 8." in text
    assert "NN .87, FT .87" in text
    assert _reproduced_by_chance(printed, ours.replace(0.9, np.nan)) == ""


def test_only_the_papers_data_support_or_contradict_and_the_data_are_named(monkeypatch):
    labels = [name for name in "abcdefgh" for _ in range(3)]
    rows = [record(name, nn, labels=labels, dataset="tosca") for name, nn in PAIR.items()]
    claim, reverse = claim_on("gps", "skeleton"), claim_on("skeleton", "gps")
    one = judged(claim, *rows)
    assert (one.decision, one.data) == (
        "holds, unverified data",
        "files named like TOSCA, unverified",
    )
    (copy,) = SETS["tosca"].copies
    for module in (verdicts, data_titles):
        monkeypatch.setattr(module, "known_copy", lambda _: copy)
    assert judged(claim, *rows).decision == "supported"
    assert judged(claim, *rows).data == copy.title
    assert judged(reverse, *rows).decision == "contradicted"


def test_a_network_of_ours_decides_no_claim_on_the_papers_data(monkeypatch):
    labels = [name for name in "abcdefgh" for _ in range(3)]
    nets = {"gps": 0.1, "learned": 0.9, AS_PRINTED: 0.9}
    rows = [record(name, nn, labels=labels, models=[]) for name, nn in nets.items()]
    none = "not decidable: the paper's network may be far larger"
    assert judged(claim_on("learned", "gps"), *rows).decision == "holds on the stand-in"
    assert judged(claim_on(AS_PRINTED, "gps"), *rows).decision == none
    monkeypatch.setattr(verdicts, "known_copy", lambda _: SETS["tosca"].copies[0])
    assert judged(claim_on("learned", "gps"), *rows).decision == none


def test_a_significant_lead_within_the_scatter_is_counted_apart():
    labels = [name for name in "abcdefgh" for _ in range(3)]
    rows = [record(name, nn, labels=labels) for name, nn in {"gps": 0.51, "skeleton": 0.5}.items()]
    one = judged(claim_on("gps", "skeleton"), *rows)
    assert (one.leads, one.significant, one.above_scatter) == (1, 1, 0)
    assert one.decision == "open on the stand-in"


PAIR = {"gps": 0.9, "skeleton": 0.1}
