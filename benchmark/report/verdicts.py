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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from benchmark.protocols.tables import TABLES, TITLES
from benchmark.reference.paper import (
    AS_PRINTED,
    CLAIMS,
    CLASSICAL,
    PAPER_MEASURES,
    PAPERS_NETWORKS,
    PRINTED,
    Claim,
)
from benchmark.report.data_titles import known_copy, official_set
from benchmark.report.formats import MARKDOWN_WIDTH, markdown_table
from benchmark.report.notation import hundredths
from benchmark.report.record_facts import block_of
from benchmark.report.rivals import SAME, scatter_of
from benchmark.report.rows import RowScores, ranked_classes
from benchmark.report.statistics import ALPHA, FEWEST_CLASSES, permutation_test
from benchmark.report.table_view import TableView
from benchmark.text import listed

#: Largest difference of a reproduced score from the paper's: two hundredths more than the standard
#: deviation of NN over draws of the codebook on a hundred shapes (median .026).
TOLERANCE = 0.05


def classical_scores(views: Sequence[TableView]) -> tuple[DataFrame, DataFrame] | None:
    """Return the scores of classical methods in Table III of the paper, and ours.

    Parameters
    ----------
    views
        Our tables.

    Returns
    -------
    printed, ours : pandas.DataFrame
        Scores of methods (rows) by measures (columns), for complete surfaces of TOSCA. Ours are NaN
        where a result is missing. Instead of both, None if none of our tables is of TOSCA.
    """
    view = table_of_tosca(views)
    if view is None:
        return None
    means = {}
    for row in view.rows:
        for scores in row.scored.values():
            if scores.is_complete:
                means[row.method] = scores.means
    printed = DataFrame({name: PRINTED["III"][name] for name in CLASSICAL}).T
    ours = DataFrame(means, index=PAPER_MEASURES).T
    return printed, ours.reindex(index=printed.index)


def table_of_tosca(views: Sequence[TableView]) -> TableView | None:
    """Return Table III on TOSCA, whatever its copy; None if there is none."""
    places = {(view.table.identifier, view.dataset): view for view in reversed(views)}
    return places.get(("III", "tosca"))


def is_near(printed: NDArray[np.float64], ours: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which figures are reproduced."""
    return np.abs(printed - ours) <= TOLERANCE + SAME


def _reproduced_by_chance(printed: DataFrame, ours: DataFrame) -> str:
    """Say how many of the paper's figures would be reproduced without computing anything right.

    This is tried with our rows exchanged in all ways, with the mean of our rows, and with the best
    constant for each measure. The sentence also tells how our rows correlate in rank with those of
    the paper. It is "" if one of our rows lacks a result.

    Parameters
    ----------
    printed, ours
        Scores in the paper and ours, shape (methods, measures).
    """
    if ours.isna().any(axis=None):
        return ""
    values = printed.to_numpy()
    # near[i, j]: how many measures of printed row i are reproduced by our row j.
    near = is_near(values[:, None], ours.to_numpy()).sum(axis=2)
    exchanges = np.array(list(permutations(range(len(ours)))))
    counts = near[range(len(ours)), exchanges].sum(axis=1)
    n_ours = near.trace()

    # A constant that reproduces most figures can be found among the figures plus the tolerance.
    n_by_mean = is_near(values, ours.mean().to_numpy()).sum()
    n_by_constants = is_near(values[:, None], values + TOLERANCE).sum(axis=0).max(axis=0).sum()

    correlations = printed.rank().corrwith(ours.rank())
    order = ", ".join(f"{measure} {rho:.2f}" for measure, rho in correlations.items())
    return (
        f"With our rows exchanged at random, {counts.mean():.1f} are reproduced on average, and "
        f"{(counts >= n_ours).mean():.0%} of all exchanges reproduce {n_ours} or more; the mean of "
        f"each of our columns reproduces {n_by_mean}, and one constant for each measure, chosen in "
        f"hindsight, {n_by_constants}. Rank correlation with the paper: "
        f"{order.replace('0.', '.')}. "
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
    n_unseen, n_queries
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
    n_unseen: int = 0
    n_queries: int = 0
    leads: int = 0
    n_comparisons: int = 0
    significant: int = 0
    above_scatter: int = 0
    trainings: int = 0


class DecisionWords(NamedTuple):
    """What it is called that a claim holds, that it fails, and neither."""

    holds: str
    fails: str
    neither: str


#: On the paper's data, on other data, and on files that only bear the names of the paper's.
ON_PAPERS_DATA = DecisionWords("supported", "contradicted", "undecided")
ON_OTHER_DATA = DecisionWords(
    "holds on the stand-in", "fails on the stand-in", "open on the stand-in"
)
UNVERIFIED = DecisionWords(
    "holds, unverified data", "fails, unverified data", "open, unverified data"
)


def assess(claim: Claim, view: TableView | None) -> AssessedClaim:
    """Judge whether our scores bear out a claim of the paper: that one method scores best.

    The claim is tested on queries of those classes from which none of the methods has seen a shape
    in training.

    Parameters
    ----------
    claim
        The claim.
    view
        Our scores in the table to which it belongs; None if there are none.

    Returns
    -------
    AssessedClaim
        The decision and what it rests on; "not comparable" if a method lacks scores, or there is no
        unseen query.
    """
    if view is None:
        return AssessedClaim(claim, "not comparable: the table has no scores")
    rows, lacking = _rows_of_claim(claim, view)
    if lacking:
        titles = {row.method: row.title for row in view.rows}
        names = listed([titles.get(method, TITLES.get(method, method)) for method in lacking])
        return AssessedClaim(claim, f"not comparable: no complete scores of {names}", view.title)

    # Leave out the queries of classes seen in training.
    labels = rows[0].labels  # all rows rank the same shapes
    seen_classes = frozenset[str]().union(*(row.seen_classes for row in rows))
    unseen = [index for index, label in enumerate(labels) if label not in seen_classes]
    if not unseen:
        problem = "not comparable: no class is unseen in training"
        return AssessedClaim(claim, problem, view.title, n_queries=len(labels))
    unseen_labels = [labels[index] for index in unseen]

    measures = [rows[0].measures.index(name) for name in claim.measures]
    leads = _leads(rows, unseen_labels, unseen, measures)
    decision = _decision(claim, decision_words(view), leads, n_classes=len(set(unseen_labels)))
    return AssessedClaim(
        claim,
        decision,
        view.title,
        n_unseen=len(unseen),
        n_queries=len(labels),
        leads=int((leads.lead > 0).sum()),
        n_comparisons=leads.lead.size,
        significant=int(leads.is_significant.sum()),
        above_scatter=int(leads.is_decided.sum()),
        trainings=leads.n_trainings,
    )


#: Column of Table I that decides its claims: the five subjects of which no network saw a shape.
_COLUMN_OF_SUBJECTS = "5 subjects"


def _rows_of_claim(claim: Claim, view: TableView) -> tuple[list[RowScores], list[str]]:
    """Return the scores of the methods that a claim compares, and the methods without any.

    The claimed better one is the first. Incomplete scores are none: those without a gallery, or
    without a shape that another of the methods has.
    """
    # In the column of the five subjects, if the table has it; else in its first column.
    title = view.columns[0].title
    if _COLUMN_OF_SUBJECTS in view.groups:
        title = _COLUMN_OF_SUBJECTS
    methods = (claim.better, *claim.others)
    scores_of_methods = {}
    for row in view.rows:
        if row.method in methods and title in row.scored and not row.scored[title].missing:
            scores_of_methods[row.method] = row.scored[title]
    refused = [scores.refused for scores in scores_of_methods.values()]
    refused_by_all = refused[0].intersection(*refused) if refused else frozenset[str]()
    rows = []
    lacking = []
    for method in methods:
        scores = scores_of_methods.get(method)
        if scores is None or scores.refused - refused_by_all:
            lacking.append(method)
        else:
            rows.append(scores)
    return rows, lacking


def _decision(claim: Claim, words: DecisionWords, leads: _Leads, n_classes: int) -> str:
    """Return the decision on a claim; a network of ours decides no claim on the paper's data."""
    if n_classes < FEWEST_CLASSES:
        return f"not decidable: {n_classes} classes"
    if claim.better in PAPERS_NETWORKS and (words is ON_PAPERS_DATA or claim.better == AS_PRINTED):
        return "not decidable: the paper's network may be far larger"
    if np.any(leads.is_decided & (leads.lead < 0)):
        return words.fails
    if np.all(leads.is_decided & (leads.lead > 0)):
        return words.holds
    return words.neither


def decision_words(view: TableView) -> DecisionWords:
    """Return what decisions are called on the data of a table, by what these are."""
    if known_copy(view.sample):
        return ON_PAPERS_DATA
    if official_set(view.sample):
        return UNVERIFIED
    return ON_OTHER_DATA


@dataclass(frozen=True, eq=False)
class _Leads:
    """Leads of a row before others, by other row and measure.

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
    rows: Sequence[RowScores],
    labels: Sequence[str],
    queries: Sequence[int],
    measures: Sequence[int],
) -> _Leads:
    """Return by how much a method leads before others, and how certain that is.

    Networks were trained several times, with other seeds and on other folds. A lead is certain only
    if it is significant for every choice of one training for each row, and has the same sign in
    every fold.

    Parameters
    ----------
    rows
        Scores of the method, then of the others.
    labels
        Classes of the queries to compare.
    queries, measures
        Indices of the queries and measures to compare.
    """
    # Queries are listed fold by fold. Without a network, all are in one fold.
    has_network = any(block_of(row.all_records[0]) == "network" for row in rows)
    sizes_of_folds = [len(rows[0].labels)]
    if has_network:
        sizes_of_folds = [len(ranked_classes(records[0])) for records in rows[0].records.values()]
    fold_of_query = np.repeat(np.arange(len(sizes_of_folds)), sizes_of_folds)[queries]

    # Leads, summed over the queries, have the shape (other methods, measures).
    chosen = np.ix_(queries, measures)
    lead = _total_leads(np.array([row.values[chosen] for row in rows]))
    largest = scatter_of(rows).largest[measures]
    is_above_scatter = np.abs(lead) / len(labels) > largest + SAME

    # Every choice of trainings has to agree.
    is_significant = np.ones(lead.shape, dtype=bool)
    has_one_sign = np.ones(lead.shape, dtype=bool)
    choices = list(product(*(row.trainings for row in rows)))
    for trainings in choices:
        values = np.array([training[chosen] for training in trainings])
        is_significant &= permutation_test(values, labels)[0, 1:] < ALPHA
        has_one_sign &= _has_sign_in_folds(values, fold_of_query, np.sign(lead))

    n_trainings = len(choices) * len(sizes_of_folds) if has_network else 0
    is_decided = is_significant & is_above_scatter & has_one_sign
    return _Leads(lead, is_significant, is_decided, n_trainings)


def _total_leads(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the total leads of the first row before each other, shape (rows - 1, measures).

    They have the six decimals of records, so that a lead of rounding errors has no sign.
    """
    return np.asarray((values[0] - values[1:]).sum(axis=1).round(6))


def claims(views: Sequence[TableView]) -> list[AssessedClaim]:
    """Judge the paper's claims, all methods on one view, on official data or the stand-in."""
    first = {view.table.identifier: view for view in reversed(views)}
    judged = []
    for claim in CLAIMS:
        identifier = "IV" if claim.table == "IV" else f"{claim.table}-view"
        judged.append(assess(claim, first.get(identifier)))
    return judged


def _has_sign_in_folds(
    values: NDArray[np.float64], fold_of_query: NDArray[np.int64], sign: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return whether a method leads, or trails, in every fold alike.

    Parameters
    ----------
    values
        Scores of the method, then of the others, shape (methods, queries, measures).
    fold_of_query
        Number of the fold of each query.
    sign
        Sign of the lead before each other method, shape (other methods, measures).

    Returns
    -------
    numpy.ndarray
        Whether the lead has this sign in every fold, shape (other methods, measures).
    """
    has_sign = np.ones(sign.shape, dtype=bool)
    for fold in np.unique(fold_of_query):
        lead_of_fold = _total_leads(values[:, fold_of_query == fold])
        has_sign &= np.sign(lead_of_fold) == sign
    return has_sign


def verdicts_markdown(views: Sequence[TableView]) -> str:
    """Return as Markdown what our scores say of the paper: first its figures, then its claims.

    "" if all tables are of the user's own data, or of quick runs, which decide nothing.
    """
    views = [view for view in views if not view.quick]
    if not any(view.table in TABLES for view in views):
        return ""
    lines = [f"**What holds up in the paper.** {views[0].scored_by.note}", ""]
    figures = classical_scores(views)
    tosca = table_of_tosca(views)
    if figures and tosca:
        lines += _lines_of_figures(tosca, *figures)
    judged = claims(views)
    lines += wrap(f"{CLAIMS_EXPLAINED} {_data_of_tables(judged)}", MARKDOWN_WIDTH)
    head = ["Claim", "row", "table", "decision", "queries", "leads"]
    head += ["significant", "above scatter", "trainings"]
    return "\n".join([*lines, "", *markdown_table(head, map(_cells_of_claim, judged))]) + "\n"


def _lines_of_figures(tosca: TableView, printed: DataFrame, ours: DataFrame) -> list[str]:
    """Return lines of Markdown with the paper's figures for TOSCA beside ours, and how many agree.

    Parameters
    ----------
    tosca
        Our table of TOSCA, which names the data.
    printed, ours
        From :func:`classical_scores`: methods by measures.
    """
    near = is_near(printed.to_numpy(), ours.to_numpy())
    words = (
        f"Table III, {tosca.title}, complete surfaces: {near.sum()} of {near.size} classical "
        f"figures are reproduced (`=`, at most .05 apart). {_reproduced_by_chance(printed, ours)}"
        f"Each cell: the paper's figure, ours."
    )
    cells = printed.map(hundredths) + " " + ours.map(hundredths) + np.where(near, " =", "")
    body = []
    for name, of_row in zip(cells.index, cells.to_numpy(), strict=True):
        body.append([TITLES[str(name)], *of_row])
    table = markdown_table(["Method", *cells.columns], body)
    return [*wrap(words, MARKDOWN_WIDTH), "", *table, ""]


def _cells_of_claim(judged: AssessedClaim) -> list[str]:
    """Return the cells of a claim; without queries or comparisons, fewer."""
    claim = judged.claim
    cells = [claim.words, TITLES.get(claim.better, ""), claim.table, judged.decision]
    if judged.n_queries:
        cells.append(f"{judged.n_unseen} of {judged.n_queries}")
    if judged.n_comparisons:
        cells.append(f"{judged.leads} of {judged.n_comparisons}")
        cells += [str(judged.significant), str(judged.above_scatter), str(judged.trainings or "")]
    return cells


CLAIMS_EXPLAINED = (
    "The paper's claims, all methods on one depth view. Only the paper's data support or "
    "contradict a claim. On a stand-in, a claim holds, fails or stays open, which says nothing of "
    "the paper's data. The paper does not say how wide its network is, and its days of training "
    "leave room for one far larger than ours. So no network here decides a claim on the paper's "
    "data, and the one with the paper's pixels decides none at all. "
    "Queries: those of classes on which no compared network was trained. Leads: comparisons (rows "
    "times measures) in which the row is ahead. Significant: comparisons with p < .05 among these "
    "rows and measures (studentised permutation test over whole classes), in either direction and "
    "in all trainings, which are seeds of the networks times folds. Above scatter: those of them "
    "that are larger than the scatter of codebooks and trainings, and have one sign in all "
    "trainings. A claim holds if the row is ahead in every comparison, each of them above the "
    "scatter. It fails if the row is behind in a comparison above the scatter. Otherwise it stays "
    f"open. Below {FEWEST_CLASSES} classes, nothing is decided."
)


def _data_of_tables(judged: Sequence[AssessedClaim]) -> str:
    """Say which data each table of claims shows, with the copy of an official set."""
    tables: dict[str, dict[str, None]] = {}
    for assessed in judged:
        tables.setdefault(assessed.data, {})[assessed.claim.table] = None
    texts = [f"{' and '.join(numerals)}, {data}" for data, numerals in tables.items() if data]
    return f"Data: {'; '.join(texts)}." if texts else ""
