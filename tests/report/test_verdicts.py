"""Verdicts on the paper's figures and claims."""

import pytest

from benchmark.protocols.tables import SYNTHETIC_HUMANS
from benchmark.reference.paper import CLASSICAL, PRINTED, Claim
from benchmark.report.tables import table_views
from benchmark.report.verdicts import assess, verdict_of, verdicts, verdicts_markdown
from tests.report.records import by_class, record

COLUMN = {"a": 0.9, "b": 0.7, "c": 0.5, "d": 0.3, "e": 0.1}


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [
        ({**COLUMN, "a": 0.85}, "reproduced"),
        ({**COLUMN, "a": 0.849}, "same order"),
        ({**COLUMN, "a": 0.6}, "same order"),  # three of four comparisons agree
        ({**COLUMN, "a": 0.4}, "otherwise"),
        ({**COLUMN, "a": 0.7}, "same order"),  # a tie disagrees, the other three agree
        ({"a": 0.6, "b": 0.1, "c": 0.2}, "otherwise"),  # too few to compare
        ({"b": 0.1}, "no figure"),
    ],
)
def test_a_figure_is_reproduced_or_keeps_the_order(ours, verdict):
    assert verdict_of("a", COLUMN, ours) == verdict


def test_verdicts_are_for_tosca_alone_and_come_from_all_rows():
    rows = table_views([record(name, PRINTED["III"][name]["NN"], dataset="tosca") for name in CLASSICAL])
    assert {name: nn[-1] for name, (nn, *_) in verdicts(rows).items()} == dict.fromkeys(CLASSICAL, "reproduced")
    on_stand_in = [record(name, 0.5, dataset="animals", stand_in_for="tosca") for name in CLASSICAL]
    assert not verdicts(table_views(on_stand_in))
    assert "8 of 32" not in verdicts_markdown(rows)
    assert "Table III" not in verdicts_markdown(table_views(on_stand_in))


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
    assert judged(claim_on("high", "low"), high, low).decision == "supported"
    assert judged(claim_on("low", "high"), high, low).decision == "contradicted"
    assert judged(claim_on("high", "mixed"), high, mixed).decision == "undecided"
    assert judged(claim_on("high", "none"), high, low).decision == "not comparable"


def test_with_few_classes_no_lead_is_certain():
    one = judged(claim_on("gps", "skeleton"), record("gps", 1.0), record("skeleton", 0.0))
    assert (one.decision, one.leads, one.certain) == ("undecided", 1, 0)


def test_of_several_trainings_each_must_lead():
    humans = {"dataset": SYNTHETIC_HUMANS[0], "fold": "fold 0", "input_": "view", "models": []}
    labels = [name for name in "abcdefgh" for _ in range(3)]
    better = [
        record(name, nn, labels=labels, **humans) for name, nn in (("learned", 0.9), ("learned[training_seed=1]", 0.3))
    ]
    other = record("learned-without-srf", 0.5, labels=labels, **humans)
    rest = [record(r.method, 0.5, labels=labels, **{**humans, "fold": f"fold {k}"})
            for r in (*better, other) for k in (1, 2)]  # fmt: skip
    (view,) = table_views([*better, other, *rest], ["IV"])
    assert assess(claim_on("learned", "learned-without-srf"), view).certain == 0
