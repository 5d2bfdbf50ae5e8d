"""One static page with every table and figure; everything that comes from data is escaped."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from urllib.parse import quote

from benchmark.report.columns import BLANK, Style, cells, groups_of, number
from benchmark.report.content import TableContent
from benchmark.report.escaping import html_text
from retrieval.measures import PRINTED

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; margin: 1rem 0 }
th, td { padding: .2rem .6rem; text-align: right } th:first-child, td:first-child { text-align: left }
thead tr:last-child, tr.chance { border-top: 1px solid #999 } thead, tbody { border-bottom: 2px solid #222 }
thead { border-top: 2px solid #222 } b { color: #06c } tr.chance { font-style: italic } img { max-width: 100% }
"""


def page(tables: Sequence[TableContent], figures: Mapping[str, str]) -> str:
    """Render the page.

    Parameters
    ----------
    tables
        The tables.
    figures
        Paths of pictures relative to the page, by the file stem of the table that they belong to.
    """
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>Canonical forms benchmark</title>",
        f"<style>{_STYLE}</style><h1>Canonical forms benchmark</h1>",
    ]
    for table in tables:
        parts.append(_table(table))
        if table.file_stem in figures:
            parts.append(f"<img src='{quote(os.fsencode(figures[table.file_stem]))}' alt='Canonical forms'>")
    return "\n".join(parts) + "</html>\n"


def _table(table: TableContent) -> str:
    groups = groups_of(table)
    heading = f"Table {table.identifier}. {table.table.caption}: {table.data_title} ({table.size})"
    lines = [f"<h2>{html_text(heading)}</h2>", "<table><thead><tr><th></th>"]
    lines += [f"<th colspan='{len(PRINTED)}'>{html_text(group.title)}</th>" for group in groups]
    lines += [
        "</tr><tr><th>Method</th>",
        *(f"<th>{metric}</th>" for _ in groups for metric in PRINTED),
        "</tr></thead><tbody>",
    ]
    for row, values in zip(table.rows, cells(table, groups, Style("<b>{}</b>", "<i>{}</i>")), strict=True):
        lines.append(
            f"<tr><td>{html_text(row.label)}</td>" + "".join(f"<td>{value}</td>" for value in values) + "</tr>"
        )
    chance = "".join(f"<td>{number(table.chance[metric])}</td>" for _ in groups for metric in PRINTED)
    lines.append(f"<tr class='chance'><td>Chance</td>{chance}</tr></tbody></table>")
    notes = table.notes()
    if notes:
        lines += ["<ul>", *(f"<li>{html_text(note)}</li>" for note in notes), "</ul>"]
    lines.append(f"<p>{BLANK}: no result.</p>")
    return "\n".join(lines)
