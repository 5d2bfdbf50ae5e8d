"""Robustness as Markdown, LaTeX, CSV and JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

from benchmark.datasets.perturbations.dataset import PERTURBATIONS
from benchmark.report.escaping import csv_text, latex_text, markdown_row, markdown_rule, markdown_text
from benchmark.report.floats import SEPARATION, Block, Line, points, table_floats
from benchmark.report.grid import BLANK, number
from benchmark.report.robustness.curves import Curve, Robustness, worst

_LEGEND = (
    "Smallest tested amount of each perturbation at which NN is below half of its clean value; a shape that the "
    "perturbation destroys counts as a query without success. > : not up to the largest amount. n/a: half of the clean "
    f"value is not above chance. {BLANK}: not all strengths were run."
)


def rendered(found: Sequence[Robustness], formats: Iterable[str]) -> dict[str, str]:
    """Texts by file name, as :func:`benchmark.report.files.render` makes those of the other tables."""
    files: dict[str, str] = {}
    for name in formats if found else ():
        if name == "markdown":
            files |= {f"{each.file_stem}.md": markdown(each) for each in found}
        elif name == "latex":
            files |= {f"{each.file_stem}.tex": latex(each) for each in found}
        elif name == "csv":
            files["robustness.csv"] = as_csv(found)
        else:
            files["robustness.json"] = json.dumps(_rows(found), indent=1) + "\n"
    return files


def markdown(found: Robustness) -> str:
    """The amounts at which each method fails, then NN at each strength."""
    header = ["Method", "clean NN", *(PERTURBATIONS[perturbation].title for perturbation in found.curves)]
    lines = [
        f"**What breaks the methods: {markdown_text(_title(found))}.**",
        "",
        _LEGEND,
        "",
        markdown_row(header),
        markdown_rule(len(header)),
    ]
    lines += [markdown_row([markdown_text(title), *_halves(found, method)]) for method, title in found.titles.items()]
    for perturbation, curves in found.curves.items():
        known = PERTURBATIONS[perturbation]
        header = ["Method", "clean", *(f"{amount:g}" for amount in known.amounts)]
        lines += ["", f"NN under {known.title} ({known.unit}):", "", markdown_row(header), markdown_rule(len(header))]
        for method, curve in curves.items():
            values = [number(value) for value in (curve.clean, *curve.values)]
            lines.append(markdown_row([markdown_text(found.titles[method]), *values]))
        lost = worst(found, perturbation)
        if any(lost):
            lines.append(markdown_row(["*Shapes destroyed, at most*", "0", *map(str, lost)]))
    return "\n".join(lines) + "\n"


def latex(found: Robustness) -> str:
    r"""The amounts at which each method fails, for ``\input``."""
    header = ["clean NN", *(PERTURBATIONS[perturbation].title for perturbation in found.curves)]
    rows = {title: _halves(found, method) for method, title in found.titles.items()}
    columns = zip(*rows.values(), strict=True)
    blocks = [_block(head, column) for head, column in zip(header, columns, strict=True)]
    lines = [Line(latex_text(t), points(t), tuple((latex_text(c),) for c in cells)) for t, cells in rows.items()]
    caption = latex_text(f"What breaks the methods: {_title(found)}. {_LEGEND}")
    return table_floats(found.file_stem, caption, blocks, lines)


def _block(head: str, column: Iterable[str]) -> Block:
    """A column; each word of its heading has a line."""
    width = max(map(points, (*head.split(), *column)))
    words = r"\\".join(latex_text(word) for word in head.split())
    return Block("", (rf"\shortstack[r]{{{words}}}",), width + SEPARATION)


def as_csv(found: Sequence[Robustness]) -> str:
    """One line per data set, input, method, perturbation and strength."""
    names = ["dataset", "input", "scorer", "method", "perturbation", "strength", "amount"]
    names += ["clean_NN", "NN", "unsupported", "half_at"]
    return csv_text(names, _rows(found))


def _rows(found: Sequence[Robustness]) -> list[dict[str, Any]]:
    return [
        {
            "dataset": each.data,
            "input": each.input,
            "scorer": each.scorer or None,
            "method": method,
            "title": each.titles[method],
            "perturbation": perturbation,
            "strength": strength,
            "amount": amount,
            "clean_NN": round(curve.clean, 6),
            "NN": None if value is None else round(value, 6),
            "unsupported": lost,
            "half_at": curve.half_at,
        }
        for each in found
        for perturbation, curves in each.curves.items()
        for method, curve in curves.items()
        for strength, (amount, value, lost) in enumerate(
            zip(curve.amounts, curve.values, curve.unsupported, strict=True), start=1
        )
    ]


def _halves(found: Robustness, method: str) -> list[str]:
    curves = [of_methods.get(method) for of_methods in found.curves.values()]
    clean = next((curve.clean for curve in curves if curve), None)
    return [number(clean), *(_half(curve) for curve in curves)]


def _half(curve: Curve | None) -> str:
    if curve is None:
        return BLANK
    if not curve.can_halve:
        return "n/a"
    if curve.half_at is not None:
        return f"{curve.half_at:g}"
    beyond = "<" if curve.amounts[-1] < curve.amounts[0] else ">"
    return f"{beyond} {curve.amounts[-1]:g}" if curve.is_complete else BLANK


def _title(found: Robustness) -> str:
    by = f", scored by {found.scorer}" if found.scorer else ""
    return f"{found.data}, {found.n_shapes} shapes, {found.input} input{by}"
