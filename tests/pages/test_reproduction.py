"""What docs/explanation/reproduction.md says of the paper's own figures follows from them; scores of the ablation."""

from __future__ import annotations

import re
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

import pandas as pd
import pytest

from benchmark.reference import paper
from benchmark.report.escaping import number
from benchmark.results import open_results
from retrieval.chance import chance_levels
from retrieval.measures import PRINTED

ROOT = Path(__file__).parents[2]
NETWORK = (ROOT / "docs" / "appendix" / "paper-network.md").read_text(encoding="utf-8")
HUNDREDTH = Decimal("0.01")


def nearest_neighbours(*, classical: bool = True) -> list[Decimal]:
    """The NN of Table III as printed."""
    rows = paper.rows("III")
    return [Decimal(str(row.values["III"]["NN"])) for name, row in rows.items() if (name != "learned") == classical]


def fits(value: Decimal, queries: int) -> bool:
    """Whether a share of so many queries can print as a value."""
    shares = (Decimal(hits) / queries for hits in range(queries + 1))
    return any(share.quantize(HUNDREDTH, ROUND_HALF_UP) == value for share in shares)


@pytest.mark.parametrize(("gallery", "is_possible"), [("held out", False), ("all animals", False), ("TOSCA", True)])
def test_of_the_galleries_that_the_text_allows_only_all_80_shapes_fit_the_classical_rows(
    gallery: str, is_possible: bool
) -> None:
    queries = {"held out": 11 + 8, "all animals": 11 + 8 + 6 + 9 + 4 + 3, "TOSCA": 80}[gallery]
    assert all(fits(value, queries) for value in nearest_neighbours()) == is_possible


def test_the_row_of_the_network_does_not_come_from_80_queries() -> None:
    assert not fits(*nearest_neighbours(classical=False), 80)


def test_second_tiers_of_cats_and_horses_alone_would_lie_below_chance() -> None:
    chance = chance_levels(["cat"] * 11 + ["horse"] * 8)["ST"]
    assert round(chance, 2) == 0.91
    assert all(row.values["III"]["ST"] < chance for row in paper.rows("III").values())


@pytest.fixture(scope="module")
def records() -> pd.DataFrame:
    """Published scores of single views of the folds of the synthetic humans."""
    records = open_results(ROOT / "results", published=True).records()
    return records.query(
        "dataset == 'humans' and scorer == 'cm-bof' and status == 'ok' and input == 'view'"
        " and gallery.str.contains('fold')"
    )


@pytest.fixture(scope="module")
def ablation(records: pd.DataFrame) -> pd.DataFrame:
    """Means over the folds, by method and seed of the training."""
    names = records["method"].str.extract(r"^(learned(?:-without-(?:[sl]rf|weighting))?)(?:\[training_seed=(\d)\])?$")
    named = records.assign(network=names[0], training=names[1].fillna("0")).dropna(subset="network")
    assert set(named.groupby(["network", "training"]).size()) == {3}
    return named.groupby(["network", "training"])[list(PRINTED)].mean()


WORDS = {
    "learned": "whole",
    "learned-without-srf": "without short-range features",
    "learned-without-lrf": "without long-range features",
    "learned-without-weighting": "without progressive weighting",
}


def test_the_scores_of_each_seed_are_those_of_the_records(ablation: pd.DataFrame) -> None:
    printed = dict(re.findall(r"^\| (with[a-z -]+|whole) \| (.*) \|$", NETWORK, re.MULTILINE))
    for network, of_network in ablation.groupby("network"):
        assert printed.pop(WORDS[str(network)]) == " | ".join(as_printed(scores) for _, scores in of_network.iterrows())
    assert not printed


def as_printed(scores: pd.Series) -> str:
    """Measures as pages write them, rounded as in tables."""
    return " ".join(number(value).lstrip("0") for value in scores)


def test_the_scores_of_the_network_as_printed_are_those_of_the_records(records: pd.DataFrame) -> None:
    page = (ROOT / "docs" / "explanation" / "reproduction.md").read_text(encoding="utf-8")
    rows = records[records["gallery"].isin(["humans fold 0", "humans fold 1"])].groupby("method")[list(PRINTED)].mean()
    network = paper.rows("I")["learned"].values["I"]
    assert f"| paper | {as_printed(pd.Series(network))} |" in page
    assert f"| as printed | {as_printed(rows.loc['learned[configuration=as_printed]'])} |" in page
    assert f"| 128 x 128, 60 epochs | {as_printed(rows.loc['learned'])} |" in page
    best = rows.loc[[name for name in paper.CLASSICAL if name in rows.index], "NN"].max()
    assert rows.loc["learned[configuration=as_printed]", "NN"] < best < rows.loc["learned", "NN"]


def test_each_part_of_the_network_helps_in_the_mean_of_two_seeds_by_at_most_what_the_page_says(
    ablation: pd.DataFrame,
) -> None:
    means = ablation.groupby("network").mean()
    leads = means.loc["learned"] - means.drop("learned")
    assert (leads > 0).all(axis=None) and leads.max(axis=None) < 0.04
    seeds = ablation.loc["learned"]
    assert 0.04 < (seeds.max() - seeds.min()).max() < 0.05


def test_what_short_range_features_bring_is_less_than_what_two_seeds_differ_by(ablation: pd.DataFrame) -> None:
    whole, without = ablation.loc["learned"], ablation.loc["learned-without-srf"]
    assert (whole.mean() - without.mean() < whole.max() - whole.min()).all()


def test_people_drawn_at_random_are_harder_and_the_network_leads_there_too() -> None:
    rows = pd.read_json(ROOT / "results" / "tables" / "tables.json")
    drawn, chosen = (rows[rows["table"] == table].set_index(["input", "method"]) for table in ("I-random", "I-whole"))
    page = " ".join((ROOT / "docs" / "explanation" / "reproduction.md").read_text(encoding="utf-8").split())
    named = {"classic MDS of complete surfaces has NN": ("mesh", "classic-mds"), "GPS": ("mesh", "gps")}
    for words, row in {**named, "and the network": ("view", "learned")}.items():
        assert f"{words} {figure(drawn, row)} instead of {figure(chosen, row)}" in page
    network, classical = drawn.loc["view", "learned"], {*paper.rows("I")} - {"learned"}
    forms = drawn[drawn.index.get_level_values("method").isin(classical)]
    assert len(forms) == 16
    assert all(network[measure] > forms[measure].max() for measure in PRINTED)


def figure(rows: pd.DataFrame, row: tuple[str, str]) -> str:
    """NN in print, without its leading zero."""
    return f"{Decimal(str(round(rows.loc[row, 'NN'], 6))).quantize(HUNDREDTH, ROUND_HALF_UP)}"[1:]
