"""Robustness of methods: curves over the strength of each perturbation, and how they are written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmark.api.contracts import Input
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS, parsed
from benchmark.pipeline.storage.records import Record, chance_of, coverage_of
from benchmark.plugins.registry import BUILT_IN
from benchmark.protocols.tables import INPUTS
from benchmark.report.content import stem
from benchmark.report.escaping import csv_text, latex_text, markdown_table, markdown_text
from benchmark.report.latex import Columns, float_of
from benchmark.report.results import Result
from benchmark.report.rounding import BLANK, millionths, number

_LEGEND = (
    "Smallest tested amount of each perturbation at which NN is below half of its clean value; a shape that the "
    "perturbation destroys counts as a query without success. > : not up to the largest amount. n/a: half of the clean "
    f"value is not above chance. {BLANK}: not all strengths were run."
)


@dataclass(frozen=True)
class Curve:
    """A method under one perturbation.

    Parameters
    ----------
    clean
        Its NN without the perturbation.
    values
        Its NN at each strength; None where there is no result. A shape that was destroyed counts as a query without
        success.
    unsupported
        Shapes that were destroyed, at each strength.
    chance
        NN of a random ranking.
    amounts
        What the strengths are.
    """

    clean: float
    values: tuple[float | None, ...]
    unsupported: tuple[int | None, ...]
    chance: float
    amounts: tuple[float, ...]

    @property
    def can_halve(self) -> bool:
        """Return whether half of the clean value is above chance, so that falling below it means something."""
        return millionths(self.clean / 2 - self.chance) > 0

    @property
    def half_at(self) -> float | None:
        """Amount of the weakest strength at which NN is below half of its clean value.

        None where there is none, or a weaker strength has no result.
        """
        for amount, value in zip(self.amounts, self.values, strict=True):
            if value is None or not self.can_halve:
                return None
            if millionths(value - self.clean / 2) < 0:
                return amount
        return None

    @property
    def is_complete(self) -> bool:
        """Return whether there is a result at each strength."""
        return None not in self.values


@dataclass(frozen=True)
class Robustness:
    """All methods on one data set under one input.

    Parameters
    ----------
    data
        Name of the clean set.
    input
        What the methods were given.
    n_shapes
        Shapes of the clean set.
    scorer
        What compared the forms; "" for the default scorer.
    titles
        Title of each method by its name, in the order of the tables.
    curves
        By perturbation and method.
    """

    data: str
    input: Input
    n_shapes: int
    scorer: str
    titles: Mapping[str, str]
    curves: Mapping[str, Mapping[str, Curve]]

    @property
    def file_stem(self) -> str:
        """Name of its files."""
        return stem("robustness", self.data, self.input, self.scorer)


def robustness(results: Iterable[Result]) -> list[Robustness]:
    """Collect the curves of each data set and input that has results under some perturbation, and clean ones.

    Parameters
    ----------
    results
        Records of clean and perturbed galleries, among others.
    """
    clean: dict[tuple[str, str, str], Record] = {}
    perturbed: dict[tuple[str, str], dict[tuple[str, int, str], Record]] = {}
    for result in results:
        record = result.record
        if found := parsed(record["data"]["name"]):
            base, perturbation, strength = found
            if record["data"]["quick"]:
                base += " (quick)"
            perturbed.setdefault((base, record["input"]), {})[perturbation, strength, record["method"]] = record
        else:
            clean[record["gallery"], record["input"], record["method"]] = record
    made = (
        _of_set(base, input_, perturbed[base, input_], clean)
        for base, input_ in sorted(perturbed, key=lambda place: (place[0], INPUTS.index(place[1])))
    )
    return [found for found in made if found.curves]


def _of_set(
    base: str,
    input_: str,
    records: Mapping[tuple[str, int, str], Record],
    clean: Mapping[tuple[str, str, str], Record],
) -> Robustness:
    of_methods = {method: clean[base, input_, method] for _, _, method in records if (base, input_, method) in clean}
    ok = {name: of_methods[name] for name in sorted(of_methods, key=_table_order) if of_methods[name]["status"] == "ok"}
    curves: dict[str, dict[str, Curve]] = {}
    for perturbation, known in PERTURBATIONS.items():
        for method, record in ok.items():
            found = [records.get((perturbation, strength, method)) for strength in STRENGTHS]
            if any(found):
                curves.setdefault(perturbation, {})[method] = Curve(
                    _counted(record) or 0.0,
                    tuple(_counted(each) for each in found),
                    tuple(len(each.get("unsupported", ())) if each else None for each in found),
                    chance_of(record)["NN"],
                    known.amounts,
                )
    n_shapes = max((record["data"]["n_shapes"] for record in ok.values()), default=0)
    scorer = next((record["scorer"] for record in ok.values() if "scorer_title" in record), "")
    return Robustness(base, input_, n_shapes, scorer, {m: r["title"] for m, r in ok.items()}, curves)  # type: ignore[arg-type]


def _table_order(method: str) -> tuple[int, str]:
    """Built-in methods in the order of the tables, then all others by name."""
    names = list(BUILT_IN)
    base = method.partition("[")[0]
    return (names.index(base) if base in BUILT_IN else len(names)), method


def _counted(record: Record | None) -> float | None:
    """NN over all shapes: one that was destroyed finds nothing."""
    if record is None:
        return None
    if record["status"] == "unsupported":
        return 0.0  # no shape was left to rank
    if record["status"] != "ok":
        return None
    # Records of before did not count what was refused.
    return float(record["scores"]["NN"]) * (1.0 if "coverage" in record else coverage_of(record))


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
    halves = [[markdown_text(title), *_halves(found, method)] for method, title in found.titles.items()]
    lines = [f"**What breaks the methods: {markdown_text(_title(found))}.**", "", _LEGEND, ""]
    lines += markdown_table(header, halves)
    for perturbation, curves in found.curves.items():
        known = PERTURBATIONS[perturbation]
        header = ["Method", "clean", *(f"{amount:g}" for amount in known.amounts)]
        rows = [
            [markdown_text(found.titles[method]), *map(number, (curve.clean, *curve.values))]
            for method, curve in curves.items()
        ]
        lost = [max(curve.unsupported[k] or 0 for curve in curves.values()) for k in range(len(STRENGTHS))]
        if any(lost):
            rows.append(["*Shapes destroyed, at most*", "0", *map(str, lost)])
        lines += ["", f"NN under {known.title} ({known.unit}):", "", *markdown_table(header, rows)]
    return "\n".join(lines) + "\n"


def latex(found: Robustness) -> str:
    r"""The amounts at which each method fails, for ``\input``."""
    header = ["clean NN", *(PERTURBATIONS[perturbation].title for perturbation in found.curves)]
    rows = zip(*(_halves(found, method) for method in found.titles), strict=True)
    columns = [_column(head, cells) for head, cells in zip(header, rows, strict=True)]
    caption = latex_text(f"What breaks the methods: {_title(found)}. {_LEGEND}")
    return float_of(found.file_stem, caption, [latex_text(title) for title in found.titles.values()], columns)


def _column(head: str, cells: Sequence[str]) -> Columns:
    """A column; each word of its heading has a line."""
    words = r"\\".join(latex_text(word) for word in head.split())
    return Columns("", (rf"\shortstack[r]{{{words}}}",), [latex_text(cell) for cell in cells], 2)


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
