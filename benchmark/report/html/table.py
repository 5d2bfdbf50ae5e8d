"""A table of scores in HTML: complete without a script, and sorted and filtered with one."""

from __future__ import annotations

from collections.abc import Iterable

from benchmark.report.content import TableContent
from benchmark.report.escaping import html_line, html_text
from benchmark.report.grid import BLANK, Figure, Style, grid_of
from retrieval.measures import MEASURES

_TITLES = {measure.name: measure.title for measure in MEASURES}

_STYLE = Style("<b>{}</b>", "<i>{}</i>")


def score_table(table: TableContent) -> str:
    """The scores of all methods, and those of chance."""
    grid = grid_of(table)
    lines = ["<table class='sortable'><thead><tr><td></td>"]
    lines += [
        f"<th colspan='{len(group.names)}' scope='colgroup'>{html_text(group.title)}</th>" for group in grid.groups
    ]
    lines += ["</tr><tr>", heading("Method", text=True)]
    for group in grid.groups:
        lines += [heading(name, title=_TITLES.get(name, ""), first=not k) for k, name in enumerate(group.names)]
    lines.append("</tr></thead><tbody>")
    for line in grid.lines:
        told = "".join(_cell(figure, is_first=not k) for group in line.groups for k, figure in enumerate(group))
        if line.row is None:
            lines.append(f"</tbody><tfoot><tr class='chance'><th scope='row'>{line.label}</th>{told}</tr></tfoot>")
        else:
            label = f"<th scope='row' data-name='{html_text(line.row.method)}'>{html_text(line.label)}</th>"
            lines.append(f"<tr data-family='{html_text(line.row.family)}'>{label}{told}</tr>")
    return "".join([*lines, "</table>"])


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


def _cell(figure: Figure, is_first: bool) -> str:
    """A figure, with its interval where it is pointed at."""
    words = " ".join(word for word, is_so in (("first", is_first), ("blank", figure.text == BLANK)) if is_so)
    interval = f" title='95 %: {figure.interval}'" if figure.interval else ""
    return f"<td{f' class={chr(39)}{words}{chr(39)}' if words else ''}{interval}>{_STYLE.write(figure)}</td>"
