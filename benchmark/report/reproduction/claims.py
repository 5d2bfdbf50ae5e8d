"""Outcomes of the paper's claims, by the queries of our tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmark.reference.paper import CLAIMS, Claim
from benchmark.report.content import TableContent
from benchmark.report.statistics.queries import queries_of
from benchmark.report.statistics.significance import ALPHA, class_permutation_test, holm

Decision = Literal["supported", "contradicted", "undecided", "not comparable"]


@dataclass(frozen=True)
class AssessedClaim:
    """Outcome of a claim by our queries.

    Parameters
    ----------
    claim
        The claim.
    decision
        Supported: the row leads in every comparison, and no lead can be chance. Contradicted: it is behind in some, and
        one of these cannot be chance. Undecided: neither.
    leads, n_comparisons
        Comparisons in which the row leads, and all of them: rows times measures.
    certain
        Comparisons that other subjects would hardly turn, either way.
    missing
        Rows without scores.
    """

    claim: Claim
    decision: Decision
    leads: int = 0
    n_comparisons: int = 0
    certain: int = 0
    missing: tuple[str, ...] = ()


def assess_claims(contents: Mapping[str, TableContent], claims: Sequence[Claim] = CLAIMS) -> list[AssessedClaim]:
    """Decide each claim by permutation tests over classes of all folds, with Holm's correction over its comparisons.

    Parameters
    ----------
    contents
        Content by numeral of the paper; see :func:`benchmark.report.reproduction.figures.paper_tables`.
    claims
        What to decide.
    """
    return [_judged(claim, contents.get(claim.table)) for claim in claims]


def _judged(claim: Claim, content: TableContent | None) -> AssessedClaim:
    records = {
        row.method: row.cells[claim.input].records
        for row in (content.rows if content is not None else ())
        if claim.input in row.cells and row.cells[claim.input].records
    }
    missing = tuple(name for name in (claim.better, *claim.others) if name not in records)
    if missing:
        return AssessedClaim(claim, "not comparable", missing=missing)
    parts = [_differences(records[claim.better], records[name], claim.measures) for name in claim.others]
    totals = np.concatenate([differences.sum(axis=0) for differences, _ in parts])
    leads = totals > 0
    certain = np.array(holm([p for part in parts for p in class_permutation_test(*part).tolist()])) < ALPHA
    decision: Decision = "undecided"
    if np.any(certain & (totals < 0)):
        decision = "contradicted"
    elif np.all(certain & leads):
        decision = "supported"
    return AssessedClaim(claim, decision, int(leads.sum()), len(leads), int(certain.sum()))


def _differences(
    better: Sequence[Mapping[str, object]], other: Sequence[Mapping[str, object]], measures: Sequence[str]
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Shape (N, M): how much better each query is by each measure, over the queries of both, and their classes."""
    here, there = queries_of(better, measures), queries_of(other, measures)
    names = set(there.names)
    both = [name for name in here.names if name in names]
    here, there = here.among(both), there.among(both)
    return np.column_stack([here.values[name] - there.values[name] for name in measures]), here.labels
