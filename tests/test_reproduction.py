"""What docs/reproduction.md says of the paper's own figures follows from them."""

from __future__ import annotations

from decimal import ROUND_HALF_UP, Decimal

import pytest

from benchmark.reference import paper
from retrieval.chance import chance_levels

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
