"""The outcome as Markdown: counts, claims, which input comes nearer, and every figure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from benchmark.protocols.tables import INPUTS
from benchmark.reference.paper import MEASURES, NUMERALS, is_learned
from benchmark.report.content import TableContent
from benchmark.report.escaping import markdown_line, markdown_table, markdown_text
from benchmark.report.reproduction.claims import AssessedClaim, assess_claims
from benchmark.report.reproduction.figures import (
    AGREEING,
    FEWEST,
    OUTCOMES,
    TOLERANCE,
    Outcome,
    ReproducedFigure,
    is_near,
    mean_distance,
    paper_tables,
    reproduced_figures,
)
from benchmark.report.rounding import BLANK, number

#: Stands beside our figure.
MARKS: Mapping[Outcome, str] = {
    "reproduced": "=",
    "at chance": "c",
    "same order": "~",
    "other data": "d",
    "other training": "t",
    "unexplained": "x",
    "not comparable": "",
}


def reproduction_markdown(tables: Sequence[TableContent]) -> str:
    """Return what holds up of the paper's figures and claims, as Markdown."""
    contents, figures = paper_tables(tables), reproduced_figures(tables)
    blocks = [
        "**What of the paper's tables holds up.**",
        counts(figures),
        _rules(),
        "**Its claims.**",
        claims(assess_claims(contents)),
        _tests(),
        "**Which input comes nearer?** Mean absolute difference to the paper's classical rows, and of the chance level "
        "of our gallery to them: what a random order would reproduce, too, tells little.",
        inputs(figures),
    ]
    for numeral in NUMERALS:
        of_table = [each for each in figures if each.table == numeral]
        where = f"{contents[numeral].data_title} ({contents[numeral].size})" if numeral in contents else "not run"
        blocks += [f"**Table {numeral}: {markdown_text(where)}.**", each_figure(of_table)]
    return "\n\n".join(blocks) + "\n"


def counts(figures: Sequence[ReproducedFigure]) -> str:
    """Return how many figures of each table got which outcome, by input, as a Markdown table."""
    rows = []
    for input_ in INPUTS:
        of_input = [each for each in figures if each.input == input_]
        for numeral in (*NUMERALS, "all"):
            chosen = [each for each in of_input if numeral in (each.table, "all")]
            found = Counter(each.outcome for each in chosen)
            if chosen:
                numbers = [str(found[name]) for name in OUTCOMES]
                rows.append([numeral, input_, str(len(chosen)), *numbers])
    return "\n".join(markdown_table(["Table", "input", "figures", *OUTCOMES], rows, 2))


def claims(judged: Sequence[AssessedClaim]) -> str:
    """Each claim with its decision, as a Markdown table."""
    rows = []
    for each in judged:
        leads = f"{each.leads} of {each.n_comparisons}" if each.n_comparisons else BLANK
        certain = str(each.certain) if each.n_comparisons else BLANK
        decision: str = each.decision
        if each.missing:
            named = ", ".join(each.missing[:3]) + (" ..." if len(each.missing) > 3 else "")
            decision = f"{decision}: no scores of {named}"
        words = [each.claim.words, f"{each.claim.table}, {each.claim.input}", decision]
        rows.append([*map(markdown_line, words), leads, certain])
    return "\n".join(markdown_table(["Claim of the paper", "table", "decision", "leads", "certain"], rows, 3))


def inputs(figures: Sequence[ReproducedFigure]) -> str:
    """Return how far our classical rows by input, and the chance level, are from the paper's, as a Markdown table."""
    head = ["Table", "input", "figures", "all measures", "without NN", f"within {TOLERANCE:.2f}"]
    rows = []
    classical = [each for each in figures if each.ours is not None and not is_learned(each.method)]
    for numeral in NUMERALS:
        of_table = [each for each in classical if each.table == numeral]
        candidates: dict[str, list[ReproducedFigure]] = {
            input_: [each for each in of_table if each.input == input_] for input_ in INPUTS
        }
        longest = max(candidates.values(), key=len)
        candidates |= {"chance level": [replace(each, ours=each.chance) for each in longest]}
        for name, chosen in candidates.items():
            whole, rest = mean_distance(chosen), mean_distance(chosen, without_nn=True)
            if whole is not None and rest is not None:
                near = sum(each.ours is not None and is_near(each.paper, each.ours) for each in chosen)
                rows.append([numeral, name, str(len(chosen)), number(whole, 3), number(rest, 3), str(near)])
    return "\n".join(markdown_table(head, rows, 2))


def each_figure(figures: Sequence[ReproducedFigure]) -> str:
    """The paper's figure, ours and the mark of the outcome, a row for each method and input."""
    rows = []
    for method, title, input_ in dict.fromkeys((each.method, each.title, each.input) for each in figures):
        chosen = [each for each in figures if (each.method, each.input) == (method, input_)]
        rows.append([markdown_text(title), input_, *map(_both, chosen)])
    return "\n".join(markdown_table(["Method", "input", *MEASURES], rows, 2))


def _both(figure: ReproducedFigure) -> str:
    ours = BLANK if figure.ours is None else number(figure.ours)
    return f"{number(figure.paper)} {ours} {MARKS[figure.outcome]}".rstrip()


def _rules() -> str:
    return "\n".join(
        (
            f"- Reproduced (`=`): at most {TOLERANCE:.2f} from the paper. At chance, as in the paper (`c`): so is "
            "ours, and so is a random order.",
            f"- Same order (`~`): further away, and at least {AGREEING:.0%} of the comparisons with the table's other "
            f"rows ({FEWEST} at least) point the paper's way.",
            "- All others differ, and beside the figure something else does: the data are a generated stand-in "
            "(other data, `d`), or a network was trained less than the paper's (other training, `t`). That it is the "
            "reason is not shown. Unexplained (`x`): nothing else that is known differs.",
            "- Not comparable: there is no figure of ours.",
            "- Both inputs are judged, since the paper does not say which its classical forms had; networks see views "
            "alone. On a stand-in an equal figure is an equal effect, not an equal experiment.",
        )
    )


def _tests() -> str:
    return (
        "- Leads: in how many comparisons (rows times measures) the row is ahead. Certain: how many, either way, are "
        "more than chance for other subjects (permutation test over the classes of all folds, Holm's correction over "
        "the claim's comparisons, 5 %; few classes can reach nothing). Supported: all are. Contradicted: some certain "
        "comparison points the other way. Other trainings may decide otherwise."
    )
