"""Robustness: NN of some methods on changed sets, one line for each change and strength."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROBUST, TITLES
from benchmark.report.frames import changed, chosen_records

if TYPE_CHECKING:
    from pandas import DataFrame

MEASURE = "NN"


def robustness(records: Iterable[Record]) -> DataFrame:
    """Return NN of complete surfaces by (data set, change, strength) and method; strength 0 is the unchanged set."""
    from pandas import DataFrame

    rows = []
    known = [record for record in chosen_records(records) if record.input == "mesh" and record.method in ROBUST]
    bases = {place[0] for record in known if (place := changed(record.data.name))}
    for record in known:
        base, change, strength = changed(record.data.name) or (record.data.name, "unchanged", "0")
        if base in bases and record.gallery.removesuffix(" (quick)") == record.data.name:
            value = record.scores.get(MEASURE, 0.0)
            rows.append({"dataset": base, "change": change, "strength": strength, "method": record.method, "NN": value})
    if not rows:
        return DataFrame()
    wide = DataFrame(rows).pivot_table(index=["dataset", "change", "strength"], columns="method", values=MEASURE)
    order = sorted(wide.index, key=lambda key: (key[0], key[1] != "unchanged", key[1], _number(key[2])))
    return wide.loc[order, [name for name in ROBUST if name in wide.columns]]


def _number(strength: str) -> float:
    try:
        return float(strength)
    except ValueError:
        return 0.0


def robustness_markdown(records: Iterable[Record]) -> str:
    """Return the table of robustness as Markdown; "" without results on changed sets."""
    from benchmark.report.formats import hundredths, markdown_table, markdown_text

    wide = robustness(records)
    if wide.empty:
        return ""
    head = ["Change", "strength", *(TITLES.get(name, name) for name in wide.columns)]
    body = [
        [markdown_text(change), markdown_text(strength), *map(hundredths, values)]
        for (_, change, strength), values in zip(wide.index, wide.to_numpy().tolist(), strict=True)
    ]
    sets = ", ".join(sorted({markdown_text(dataset) for dataset, *_ in wide.index}))
    lines = [f"**Robustness.** {MEASURE} of complete surfaces of {sets}; a destroyed shape counts 0.", ""]
    return "\n".join([*lines, *markdown_table(head, body)]) + "\n"
