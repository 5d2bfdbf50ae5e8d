"""The measures of retrieval: one table with name, formula, source, direction and worst value."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MEASURES", "PRINTED", "Measure"]


@dataclass(frozen=True)
class Measure:
    """One measure; C is the size of the class of a query, c = C - 1, N the size of the gallery, g_i the gain at rank i.

    Parameters
    ----------
    name
        Name in tables, records and CSV.
    title
        Name in words.
    formula
        What it is for one query.
    source
        Who defines it so.
    attribute
        Its mean in :class:`retrieval.metrics.Scores`.
    query_attribute
        Its values in :class:`retrieval.metrics.PerQuery`.
    higher_is_better
        Direction.
    worst
        Value of the worst ranking.
    """

    name: str
    title: str
    formula: str
    source: str
    attribute: str
    query_attribute: str
    higher_is_better: bool = True
    worst: float = 0.0


_PSB = "Shilane, Min, Kazhdan, Funkhouser 2004"

MEASURES: tuple[Measure, ...] = (
    Measure("NN", "nearest neighbour", "g_1", _PSB, "nn", "nn"),
    Measure("FT", "first tier", "(g_1 + ... + g_c) / c", _PSB, "ft", "ft"),
    Measure("ST", "second tier", "(g_1 + ... + g_min(2c, N - 1)) / c", _PSB, "st", "st"),
    Measure(
        "DCG",
        "discounted cumulative gain",
        "sum w_i g_i / (w_1 + ... + w_c) with w_1 = 1, w_i = 1 / log2(i)",
        _PSB,
        "dcg",
        "dcg",
    ),
    Measure("E", "E-measure", "2 h / (k + c), h hits in the first k = min(32, N - 1) ranks", _PSB, "e", "e"),
    Measure(
        "nDCG",
        "normalised discounted cumulative gain",
        "as DCG with w_i = 1 / log2(i + 1)",
        "Jarvelin, Kekalainen 2002",
        "ndcg",
        "ndcg",
    ),
    Measure(
        "mAP",
        "mean average precision",
        "mean over the relevant shapes of the precision at their rank",
        "Manning, Raghavan, Schutze 2008",
        "mean_ap",
        "ap",
    ),
)
"""All measures that a record holds."""

PRINTED: tuple[str, ...] = tuple(measure.name for measure in MEASURES[:4])
"""The measures that the paper prints, in its order; tables print these."""
