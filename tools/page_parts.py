"""``python -m tools.page_parts``: write the parts of pages that come from records and measurements.

A page holds such a part between two comments, ``<!-- part: NAME -->`` and ``<!-- end of part -->``.
Tests compare all parts with what their functions return.
"""

from __future__ import annotations

import csv
import importlib.util
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import log
from pathlib import Path
from textwrap import wrap

import numpy as np
import pandas as pd

from benchmark.commands.score import score
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import TITLES
from benchmark.reference.paper import PAPER_MEASURES
from benchmark.registry import select_one
from benchmark.report.figures import MEASURE
from benchmark.report.formats import markdown_table
from benchmark.report.notation import BLANK, hundredths
from benchmark.report.record_facts import seconds_of
from benchmark.report.rows import RowScores
from benchmark.report.tables import table_views
from benchmark.report.verdicts import claims
from benchmark.text import say
from tools.failures import failure_of, means_of_classes, published_forms
from tools.form_costs import COSTS, METHODS, SIZES

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "docs" / "guide"
RESULTS = ROOT / "results"
EXPERIMENTS = RESULTS / "experiments"

#: Characters in a line of a page.
PAGE_WIDTH = 120

PART = re.compile(
    r"(<!-- part: ([\w-]+) -->\n)((?!<!-- part: ).*\n)*?(<!-- end of part -->)", re.MULTILINE
)


def pages_with_parts() -> list[Path]:
    """Return the pages that hold parts."""
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), EXPERIMENTS / "README.md"]
    return [page for page in sorted(pages) if PART.search(page.read_text(encoding="utf-8"))]


def with_parts(text: str) -> str:
    """Return the text of a page with its parts as they are now."""
    return PART.sub(lambda found: f"{found[1]}{PARTS[found[2]]()}\n{found[4]}", text)


def form_costs() -> str:
    """Return a table of the seconds of each form by number of vertices, and of how they grow."""
    seconds: dict[str, dict[int, str]] = {}
    with COSTS.open(encoding="utf-8", newline="") as file:
        for line in csv.DictReader(file):
            seconds.setdefault(line["method"], {})[int(line["vertices"])] = line["seconds"]
    head = ["Form", *(f"{size:,} vertices" for size in SIZES), "grows like"]
    body = []
    for method in METHODS:
        of_method = seconds[method]
        last = SIZES[-1]
        before = SIZES[-2]
        growth = log(float(of_method[last]) / float(of_method[before])) / log(last / before)
        cells = [of_method[size] for size in SIZES]
        body.append([f"`{method}`", *cells, f"n to the {growth:.1f}"])
    return "\n".join(markdown_table(head, body))


def worst_classes() -> str:
    """Return a table of the two classes of TOSCA on which each form has the lowest scores."""
    records = published_forms()
    head = ["Form", "Worst class", f"its {MEASURE}", "taken for", "Second", f"its {MEASURE}"]
    body = []
    for method in METHODS:
        record = records[method]
        means = means_of_classes(record)
        worst, second = sorted(means, key=lambda label: means[label])[:2]
        cells = [worst, hundredths(means[worst]), _taken_for(record, worst)]
        body.append([f"`{method}`", *cells, second, hundredths(means[second])])
    return "\n".join(markdown_table(head, body))


def _taken_for(record: Record, label: str) -> str:
    """Return the other class, or classes, most often the first match of the queries of a class."""
    matrix = read_distances(RESULTS, record)
    if matrix is None:
        return ""
    labels = np.array([record.labels[number] for number in record.answered])
    np.fill_diagonal(matrix, np.inf)
    matches = labels[matrix.argmin(axis=1)][labels == label]
    others = Counter(match for match in matches.tolist() if match != label)
    most = max(others.values(), default=0)
    return ", ".join(sorted(other for other, count in others.items() if count == most))


def five_shapes() -> str:
    """Return the ranking of each of five shapes, and its scores."""
    evaluation = score(GUIDE / "five-shapes.csv", GUIDE / "five-shapes.txt")
    names = [str(name) for name in evaluation.queries.index]
    labels = evaluation.queries["class"].tolist()
    body = []
    for query, distances in enumerate(evaluation.distances):
        order = [int(place) for place in np.argsort(distances, kind="stable") if place != query]
        signs = ["✓" if labels[place] == labels[query] else "✗" for place in order]
        ranked = [f"{names[place]} {sign}" for place, sign in zip(order, signs, strict=True)]
        scores = [hundredths(evaluation.queries[name].iloc[query]) for name in PAPER_MEASURES]
        body.append([names[query], *ranked, *scores])
    means = [hundredths(evaluation.scores.loc[name, "score"]) for name in PAPER_MEASURES]
    body.append(["**mean**", "", "", "", "", *means])
    return "\n".join(markdown_table(["Query", "1st", "2nd", "3rd", "4th", *PAPER_MEASURES], body))


def fails(method: str) -> str:
    """Return the picture of a query that a form does not find, and what was found instead."""
    record = published_forms()[method]
    failure = failure_of(record)
    title = select_one(method).info.title
    picture = (
        f"![A query of the worst class of {title}, what was found instead, and the right match]"
        f"(../../results/figures/fails-{method}.png)"
    )
    words = (
        f"*The worst class of TOSCA for this form is `{failure.label}` ({MEASURE} "
        f"{hundredths(failure.score)}). Left: the query `{failure.query}`. Middle: "
        f"`{failure.found}`, whose form is most like that of the query. Right: "
        f"`{failure.right}`, the first shape of the right class, at rank {failure.rank}. Below "
        f"each shape is its form.*"
    )
    return "\n".join([picture, "", *wrap(words, PAGE_WIDTH)])


def departs(method: str) -> str:
    """Return how a form departs from its source."""
    return f"*Departs from its source:* {select_one(method).info.departs}"


def claims_of_paper() -> str:
    """Return a table of the paper's claims, the row and table that are judged, and the verdicts."""
    judged = claims(table_views(read_records(RESULTS, local=False)))
    body = []
    for one in judged:
        claim = one.claim
        body.append([claim.words, TITLES.get(claim.better, ""), claim.table, one.decision])
    lines = markdown_table(["The paper claims", "Tested row", "Table", "Verdict"], body)
    return "\n".join(lines).replace("---:", "---")  # words, not numbers


#: Tables of one depth view: heading, identifier, data set and column.
VIEWS = (
    ("people, five in a gallery", "I-view", "people[draw=0]", "5 subjects"),
    ("scans", "II-view", "humans-scanlike", "ours"),
    ("real people (FAUST)", "faust", "faust", "view"),
    ("TOSCA", "III-view", "tosca", "all shapes"),
)

#: Networks that see one depth view, as the page on networks calls them, each with its rows.
NETWORKS = {
    "`learned`, 500 pixels": ("learned[configuration=as_printed]",),
    "`learned`, 500 pixels, trained on generated animals": (
        "learned[configuration=as_printed,training=animals-III]",
    ),
    "`learned`, 128 pixels": ("learned",),
    "`learned-wide-extra`, trained on people": ("learned-wide-extra",),
    "`learned-wide-extra`, trained on animals": ("learned-wide-extra[training=animals-sampled]",),
    "`learned-streamed`": ("learned-streamed",),
}

#: Methods of one number or of an outline, as the page on networks calls them.
CONTROLS = {
    "`learned-average`: average body in the predicted outline": ("learned-average",),
    "`learned-flat`: flat body in the predicted outline": ("learned-flat",),
    "`surface-area`: the visible area": ("surface-area",),
}

#: Tables of complete surfaces: heading, identifier, data set and column.
COMPLETE = (
    ("generated people", "I", "people[draw=0]", "15 subjects"),
    ("generated scans of people", "II", "humans-scanlike", "ours"),
    ("real people (FAUST)", "faust", "faust", "mesh"),
    ("animals and people (TOSCA)", "III", "tosca", "ours"),
)

#: Methods that the page on choosing compares.
CHOICES = ("si-hks", "shape-dna", "gps", "mesh-unfolding", "surface-area", "identity")


def _scores_of_columns(
    columns: Sequence[tuple[str, str, str, str]],
) -> tuple[list[dict[str, RowScores]], list[str]]:
    """Return the published scores in some columns of tables, by method, and those of chance.

    Parameters
    ----------
    columns
        For each column: its heading on the page, its table, the data set, and its title there.
    """
    views = {
        (view.table.identifier, view.dataset): view
        for view in table_views(read_records(RESULTS, local=False))
    }
    scores = []
    chances = []
    for _, table, data, column in columns:
        view = views[table, data]
        scores.append({row.method: row.scored[column] for row in view.rows if column in row.scored})
        chances.append(hundredths(view.chance[column][MEASURE]))
    return scores, chances


def networks() -> str:
    """Return a table of the scores of networks on one view, beside controls, forms and no form."""
    scores, chances = _scores_of_columns(VIEWS)
    body = []
    for title, methods in NETWORKS.items():
        body.append([title, *(_score_of_network(of_table, methods) for of_table in scores)])
    for title, methods in CONTROLS.items():
        body.append([title, *(_score_of_network(of_table, methods) for of_table in scores)])
    best = []
    for of_table in scores:
        forms = [of_table[name].means[MEASURE] for name in METHODS if name in of_table]
        best.append(hundredths(max(forms)))
    none = [hundredths(of_table["identity"].means[MEASURE]) for of_table in scores]
    body += [["best classical form", *best], ["no form", *none], ["random order", *chances]]
    return "\n".join(markdown_table(["", *(heading for heading, *_ in VIEWS)], body))


def _score_of_network(of_table: Mapping[str, RowScores], methods: Sequence[str]) -> str:
    """Return the score of a network by the first of its rows, or why there is none to compare."""
    for method in methods:
        row = of_table.get(method)
        if row is not None:
            return "seen" if row.seen_classes else hundredths(row.means[MEASURE])
    return BLANK


def choices() -> str:
    """Return a table of scores on complete surfaces, and of the seconds a shape takes."""
    scores, chances = _scores_of_columns(COMPLETE)
    on_tosca = scores[-1]
    body = []
    for method in CHOICES:
        cells = [hundredths(of_table[method].means[MEASURE]) for of_table in scores]
        (record,) = on_tosca[method].all_records
        seconds = seconds_of(record)
        assert seconds is not None
        body.append([f"`{method}`", *cells, hundredths(seconds)])
    body.append(["random order", *chances, BLANK])
    head = ["Method", *(heading for heading, *_ in COMPLETE), "seconds a shape"]
    return "\n".join(markdown_table(head, body))


def experiment(name: str) -> str:
    """Return the table of an experiment, made by its module from its file."""
    place = importlib.util.spec_from_file_location(name, EXPERIMENTS / f"{name}.py")
    assert place is not None and place.loader is not None
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return "\n".join(module.lines(pd.read_csv(module.TABLE)))


#: What a part holds, by its name.
PARTS: Mapping[str, Callable[[], str]] = {
    "sensitivity": partial(experiment, "sensitivity"),
    "other-meshes": partial(experiment, "other_meshes"),
    "form-costs": form_costs,
    "worst-classes": worst_classes,
    "five-shapes": five_shapes,
    "claims-of-the-paper": claims_of_paper,
    "networks": networks,
    "choices": choices,
    **{f"fails-{method}": partial(fails, method) for method in METHODS},
    **{f"departs-{method}": partial(departs, method) for method in METHODS},
}


def main() -> None:
    """Write the parts of all pages."""
    for page in pages_with_parts():
        before = page.read_text(encoding="utf-8")
        after = with_parts(before)
        if after != before:
            page.write_text(after, encoding="utf-8")
            say(f"wrote {page.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
