"""Robustness: NN of some methods on changed sets, one line for each change and strength."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROBUST, TITLES, gallery_name
from benchmark.report.formats import hundredths, markdown_table, markdown_text
from benchmark.report.frames import changed, scored_by

MEASURE = "NN"


def robustness_markdown(records: Iterable[Record]) -> str:
    """Return the table of robustness as Markdown; "" without results on changed sets."""
    known = [record for record in records if record.input == "mesh" and record.method in ROBUST]
    bases = {place[0] for record in known if (place := changed(record.data.name))}
    scores: dict[tuple[str, str, str], dict[str, float]] = defaultdict(dict)
    for record in known:
        place = changed(record.data.name) or (record.data.name, "unchanged", "0")
        if place[0] in bases and record.gallery == gallery_name(record.data.name, "", quick=record.data.quick):
            scores[place][record.method] = record.scores.get(MEASURE, 0.0)
    if not scores:
        return ""
    methods = [name for name in ROBUST if any(name in of for of in scores.values())]
    body = [
        [markdown_text(place[1]), markdown_text(place[2]), *(hundredths(scores[place].get(name)) for name in methods)]
        for place in sorted(scores, key=lambda place: (place[0], place[1] != "unchanged", place))
    ]
    titles = {record.method: TITLES.get(record.method, record.title) for record in known}
    set_titles = {record.data.name: record.data.title for record in known}
    head = ["Change", "strength", *(titles[name] for name in methods)]
    sets = ", ".join(markdown_text(set_titles.get(base, base)) for base in sorted(bases))
    words = f"**Robustness.** {MEASURE} of complete surfaces of {sets}; a destroyed shape counts 0. "
    return "\n".join([words + scored_by(known).note, "", *markdown_table(head, body)]) + "\n"
