"""A table of scores in HTML: complete without a script, and sorted and filtered with one."""

from __future__ import annotations

from collections.abc import Iterable

from benchmark.api.contracts import Input
from benchmark.report.columns import BLANK, Style, cells, groups_of, number
from benchmark.report.content import TableContent
from benchmark.report.escaping import html_line, html_text
from retrieval.measures import MEASURES, PRINTED

_TITLES = {measure.name: measure.title for measure in MEASURES}


def score_table(table: TableContent) -> str:
    """The scores of all methods, and those of chance."""
    groups = groups_of(table)
    lines = ["<table class='sortable'><thead><tr><td></td>"]
    lines += [f"<th colspan='{len(PRINTED)}' scope='colgroup'>{html_text(group.title)}</th>" for group in groups]
    lines += ["</tr><tr>", heading("Method", text=True)]
    for _ in groups:
        lines += [heading(name, title=_TITLES[name], first=number_ == 0) for number_, name in enumerate(PRINTED)]
    lines.append("</tr></thead><tbody>")
    width = len(PRINTED)
    for row, values in zip(table.rows, cells(table, groups, Style("<b>{}</b>", "<i>{}</i>")), strict=True):
        told = "".join(
            f"<td{_classes(k % width == 0, value == BLANK)}{_interval(table, row.method, groups[k // width].input, k)}>"
            f"{value}</td>"
            for k, value in enumerate(values)
        )
        label = f"<th scope='row' data-name='{html_text(row.method)}'>{html_text(row.label)}</th>"
        lines.append(f"<tr data-family='{html_text(row.family)}'>{label}{told}</tr>")
    chance = "".join(
        f"<td{_classes(k == 0)}>{number(table.chance[name])}</td>" for _ in groups for k, name in enumerate(PRINTED)
    )
    lines.append(f"</tbody><tfoot><tr class='chance'><th scope='row'>Chance</th>{chance}</tr></tfoot></table>")
    return "".join(lines)


def plain_table(headings: Iterable[str], rows: Iterable[Iterable[object]], n_text: int = 1) -> str:
    """A sortable table of text and numbers: the first columns are text, numbers are written as they are read."""
    heads = "".join(heading(name, text=k < n_text) for k, name in enumerate(headings))
    lines = [f"<table class='sortable'><thead><tr>{heads}</tr></thead><tbody>"]
    for row in rows:
        first, *others = row
        body = "".join(
            f"<td{' class=text' if k < n_text else ''}>{html_line(value)}</td>" for k, value in enumerate(others, 1)
        )
        lines.append(f"<tr><th scope='row'>{html_text(first)}</th>{body}</tr>")
    return "".join([*lines, "</tbody></table>"])


def heading(name: str, *, title: str = "", text: bool = False, first: bool = False) -> str:
    """A column heading that sorts its column."""
    classes = " ".join(word for word, is_so in (("text", text), ("first", first)) if is_so)
    told = f" title='{html_text(title)}'" if title else ""
    return (
        f"<th scope='col'{f' class={chr(39)}{classes}{chr(39)}' if classes else ''}>"
        f"<button type='button'{told}>{html_text(name)}</button></th>"
    )


def _classes(first: bool, blank: bool = False) -> str:
    words = " ".join(word for word, is_so in (("first", first), ("blank", blank)) if is_so)
    return f" class='{words}'" if words else ""


def _interval(table: TableContent, method: str, input_: Input | None, column: int) -> str:
    """The interval of a figure, told where it is pointed at."""
    judged = table.significance.get((method, input_, PRINTED[column % len(PRINTED)])) if input_ else None
    return f" title='95 %: {number(judged.low)} to {number(judged.high)}'" if judged else ""
