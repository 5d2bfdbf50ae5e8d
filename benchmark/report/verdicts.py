"""What of the paper holds: its figures for TOSCA, the only official set here, and its claims.

:data:`TOLERANCE` was committed with its first outcome (394cbf19), a day after our scores of TOSCA
(769b38d8). Stand-ins give no verdicts on figures, because an equal figure on other data shows
nothing; claims and orders can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product
from textwrap import wrap

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from benchmark.protocols.tables import TABLES, TITLES
from benchmark.reference.paper import AS_PRINTED, CLAIMS, CLASSICAL, MEASURES, PRINTED, Claim
from benchmark.reference.paper import NETWORKS as PAPERS_NETWORKS
from benchmark.report.data_titles import known_copy, official_set
from benchmark.report.formats import markdown_table
from benchmark.report.frames import hundredths, kind_of
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, permutation_test
from benchmark.report.tables import SAME, Scored, TableView, least_difference, query_measures

#: Largest difference of a reproduced score from the paper's: two hundredths more than the standard
#: deviation of NN over draws of the codebook on a hundred shapes (median .026).
TOLERANCE = 0.05


def classical_figures(views: Sequence[TableView]) -> tuple[DataFrame, DataFrame] | None:
    """Return the paper's figures of Table III, and ours on complete surfaces of TOSCA, by method and measure.

    Ours are NaN where a row is incomplete; None without a table of TOSCA.
    """
    view = table_of_tosca(views)
    if view is None:
        return None
    complete = {
        row.method: one.means for row in view.rows for one in row.scored.values() if one.is_complete
    }
    printed = DataFrame({name: PRINTED["III"][name] for name in CLASSICAL}).T
    return printed, DataFrame(complete, index=MEASURES).T.reindex(index=printed.index)


def table_of_tosca(views: Sequence[TableView]) -> TableView | None:
    """Return Table III on TOSCA, whatever its copy; None if there is none."""
    places = {(view.table.identifier, view.dataset): view for view in reversed(views)}
    return places.get(("III", "tosca"))


def is_near(printed: NDArray[np.float64], ours: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which figures are reproduced."""
    return np.abs(printed - ours) <= TOLERANCE + SAME


def _exchanged(printed: DataFrame, ours: DataFrame) -> str:
    """Say how many figures are reproduced if our rows are exchanged or are all alike, and how far we keep the order."""
    if ours.isna().any(axis=None):
        return ""
    near = is_near(printed.to_numpy()[:, None], ours.to_numpy()).sum(axis=2)
    counts = near[range(len(ours)), [*permutations(range(len(ours)))]].sum(axis=1)
    alike = is_near(printed.to_numpy(), ours.mean().to_numpy()).sum()
    values = printed.to_numpy()
    constants = is_near(values[:, None], values + TOLERANCE).sum(axis=0).max(axis=0).sum()
    order = [f"{name} {rho:.2f}" for name, rho in printed.rank().corrwith(ours.rank()).items()]
    return (
        f"With our rows exchanged at random, {counts.mean():.1f} are reproduced on average, and "
        f"{(counts >= near.trace()).mean():.0%} of all exchanges reproduce {near.trace()} or more; the mean of each of "
        f"our columns reproduces {alike}, and one constant for each measure, chosen in hindsight, {constants}. "
        f"Rank correlation with the paper: {', '.join(order).replace('0.', '.')}. "
    )


@dataclass(frozen=True)
class AssessedClaim:
    """Outcome of a claim.

    Parameters
    ----------
    claim
        The claim.
    decision
        On the paper's data, "supported": the row leads in every comparison, each lead is
        significant and above the scatter; "contradicted": it is behind in at least one, by as much;
        "undecided": neither. On other data "holds", "fails" and "open", which say nothing of the
        paper's data. "not decidable" and "not comparable", with the reason.
    data
        Title of the data, with the copy of an official set; "" without a table.
    queries, n_queries
        Queries of classes that no compared row has seen in training, and all queries.
    leads, n_comparisons
        Comparisons (rows times measures) in which it leads, and all.
    significant, above_scatter
        Comparisons that are significant in all trainings, and those of them that are also larger
        than the scatter and of one sign in all trainings.
    trainings
        Choices of a seed for each row, times folds, all of which have to agree; 0 without a
        network.
    """

    claim: Claim
    decision: str
    data: str = ""
    queries: int = 0
    n_queries: int = 0
    leads: int = 0
    n_comparisons: int = 0
    significant: int = 0
    above_scatter: int = 0
    trainings: int = 0

    @property
    def is_tested(self) -> bool:
        """Whether a test decided it, or could have."""
        return bool(self.n_comparisons) and not self.decision.startswith("not ")


#: Decisions on the paper's data and on other data: the claim holds, it fails, and neither.
ON_PAPERS_DATA = ("supported", "contradicted", "undecided")
ON_OTHER_DATA = (
    "holds on the stand-in",
    "fails on the stand-in",
    "open on the stand-in",
)
UNVERIFIED = ("holds, unverified data", "fails, unverified data", "open, unverified data")


def assess(claim: Claim, view: TableView | None) -> AssessedClaim:
    """Judge a claim by a permutation test of its rows on unseen queries; on the five subjects of Table I."""
    if view is None:
        return AssessedClaim(claim, "not comparable")
    title = "5 subjects" if "5 subjects" in view.groups else view.columns[0].title
    scored = {row.method: row.scored[title] for row in view.rows if title in row.scored}
    complete = {method: one for method, one in scored.items() if not one.missing}
    if not complete.keys() >= {claim.better, *claim.others}:
        return AssessedClaim(claim, "not comparable", view.title)
    rows = [complete[name] for name in (claim.better, *claim.others)]
    seen = set[str]().union(*(one.seen_classes for one in rows))
    unseen = [place for place, label in enumerate(rows[0].labels) if label not in seen]
    labels = [rows[0].labels[place] for place in unseen]
    if not unseen:
        return AssessedClaim(claim, "not comparable", view.title, 0, len(rows[0].labels))
    measures = [MEASURES.index(name) for name in claim.measures]
    found = _leads(rows, labels, np.ix_(unseen, measures))
    return AssessedClaim(
        claim,
        _decision(claim, view, found, len(set(labels))),
        view.title,
        len(unseen),
        len(rows[0].labels),
        int((found.lead > 0).sum()),
        found.lead.size,
        int(found.is_significant.sum()),
        int(found.is_decided.sum()),
        found.n_trainings,
    )


def _decision(claim: Claim, view: TableView, found: _Leads, n_classes: int) -> str:
    """Return the decision on a claim; a network of ours decides no claim on the paper's data."""
    words = decision_words(view)
    if n_classes < FEWEST_CLASSES:
        return f"not decidable: {n_classes} classes"
    if claim.better in PAPERS_NETWORKS and (words is ON_PAPERS_DATA or claim.better == AS_PRINTED):
        return "not decidable: a small share of the paper's computation"
    holds, fails, neither = words
    if np.any(found.is_decided & (found.lead < 0)):
        return fails
    return holds if np.all(found.is_decided & (found.lead > 0)) else neither


def decision_words(view: TableView) -> tuple[str, str, str]:
    """Return what decisions are called on the data of a table, by what these are."""
    sample = next(iter(view.samples.values()))[0]
    if known_copy(sample):
        return ON_PAPERS_DATA
    return UNVERIFIED if official_set(sample) else ON_OTHER_DATA


@dataclass(frozen=True, eq=False)
class _Leads:
    """Leads of a row before others, by comparison.

    Parameters
    ----------
    lead
        Total leads over queries.
    is_significant
        Which differences are significant with each choice of one seed for each row.
    is_decided
        Which of them are also above the scatter, and of one sign in all trainings.
    n_trainings
        Trainings that have to agree; 0 without a network.
    """

    lead: NDArray[np.float64]
    is_significant: NDArray[np.bool_]
    is_decided: NDArray[np.bool_]
    n_trainings: int


def _leads(
    rows: Sequence[Scored], labels: Sequence[str], chosen: tuple[NDArray[np.intp], ...]
) -> _Leads:
    """Return the leads of the first row; each fold of a network is a network of its own, and has to agree in sign."""
    is_network = any(kind_of(one.all_records[0]) == "network" for one in rows)
    sizes = [len(rows[0].labels)]
    if is_network:
        sizes = [len(query_measures(of)) for of in rows[0].records.values()]
    folds = np.repeat(np.arange(len(sizes)), sizes)[chosen[0].ravel()]
    lead = _lead(np.array([one.values[chosen] for one in rows]))
    least = least_difference(rows)[0][chosen[1].ravel()]
    is_significant = np.ones(lead.shape, dtype=bool)
    is_decided = np.abs(lead) / len(labels) > least + SAME
    choices = [*product(*(one.trainings for one in rows))]
    for trainings in choices:
        values = np.array([training[chosen] for training in trainings])
        is_significant &= permutation_test(values, labels)[0, 1:] < ALPHA
        for fold in {*folds.tolist()}:
            is_decided &= np.sign(_lead(values[:, folds == fold])) == np.sign(lead)
    n_trainings = len(choices) * len(sizes) if is_network else 0
    return _Leads(lead, is_significant, is_decided & is_significant, n_trainings)


def _lead(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((values[0] - values[1:]).sum(axis=1).round(6))


def claims(views: Sequence[TableView]) -> list[AssessedClaim]:
    """Judge the paper's claims, all methods on one view, on official data or the stand-in."""
    first = {view.table.identifier: view for view in reversed(views)}
    return [
        assess(claim, first.get("IV" if claim.table == "IV" else f"{claim.table}-view"))
        for claim in CLAIMS
    ]


def verdicts_markdown(views: Sequence[TableView]) -> str:
    """Return verdicts and claims as Markdown; "" without a table of the suite."""
    if not any(view.table in TABLES for view in views):
        return ""
    lines = [f"**What holds up in the paper.** {views[0].by.note}", ""]
    figures, tosca = classical_figures(views), table_of_tosca(views)
    if figures and tosca:
        printed, ours = figures
        near = is_near(printed.to_numpy(), ours.to_numpy())
        lines += wrap(
            f"Table III, {tosca.title}, complete surfaces: {near.sum()} of {near.size} classical figures are "
            f"reproduced (`=`, at most .05 apart). {_exchanged(printed, ours)}Each cell: the paper's figure, ours.",
            100,
        )
        cells = printed.map(hundredths) + " " + ours.map(hundredths) + np.where(near, " =", "")
        body = [
            [TITLES[str(name)], *of_row]
            for name, of_row in zip(cells.index, cells.to_numpy(), strict=True)
        ]
        lines += ["", *markdown_table(["Method", *cells.columns], body), ""]
    judged = claims(views)
    lines += wrap(f"{CLAIMS_EXPLAINED} {_data_of_tables(judged)}", 100)
    rows = []
    for one in judged:
        counted = [one.decision]
        if one.n_queries:
            counted.append(f"{one.queries} of {one.n_queries}")
        if one.n_comparisons:
            counted.append(f"{one.leads} of {one.n_comparisons}")
            counted += [str(one.significant), str(one.above_scatter), str(one.trainings or "")]
        rows.append([one.claim.words, TITLES.get(one.claim.better, ""), one.claim.table, *counted])
    head = ["Claim", "row", "table", "decision", "queries", "leads"]
    head += ["significant", "above scatter", "trainings"]
    return "\n".join([*lines, "", *markdown_table(head, rows)]) + "\n"


CLAIMS_EXPLAINED = (
    "The paper's claims, all methods on one depth view. Only the paper's data support or contradict a claim. On a "
    "stand-in it holds, fails or stays open, which says nothing of the paper's data. Networks here have a small share "
    "of the paper's computation, so that none decides a claim on the paper's data, and the one with the paper's pixels "
    "decides none at all. Queries: those of classes on which no compared network was trained. Leads: comparisons (rows "
    "times measures) in which the row is ahead. Significant: comparisons with p < .05 among these rows and measures "
    "(studentised permutation test over whole classes), in either direction and in all trainings, which are seeds of "
    "the networks times folds. Above scatter: those of them that are larger than codebooks and trainings scatter, and "
    "of one sign in all trainings; a claim holds if all comparisons are leads above the scatter, and fails if one "
    f"above it is none. Below {FEWEST_CLASSES} classes, nothing is decided."
)


def _data_of_tables(judged: Sequence[AssessedClaim]) -> str:
    """Say which data each table of claims shows, with the copy of an official set."""
    tables: dict[str, list[str]] = {}
    for one in judged:
        named = tables.setdefault(one.data, [])
        if one.claim.table not in named:
            named.append(one.claim.table)
    texts = [f"{' and '.join(of)}, {data}" for data, of in tables.items() if data]
    return f"Data: {'; '.join(texts)}." if texts else ""
