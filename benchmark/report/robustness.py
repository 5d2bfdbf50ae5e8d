"""Robustness of methods: NN over the strength of each perturbation as frames, and how they are written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS, parsed
from benchmark.pipeline.storage.records import Record, chance_of, coverage_of
from benchmark.plugins.registry import BUILT_IN
from benchmark.protocols.tables import INPUTS
from benchmark.report.content import stem
from benchmark.report.escaping import csv_text, latex_text, markdown_table, markdown_text
from benchmark.report.latex import Columns, float_of
from benchmark.report.results import Result
from benchmark.report.rounding import BLANK, millionths, number

if TYPE_CHECKING:
    from pandas import DataFrame

_LEGEND = (
    "Smallest tested amount of each perturbation at which NN is below half of its clean value; a shape that the "
    "perturbation destroys counts as a query without success. > : not up to the largest amount. n/a: half of the clean "
    f"value is not above chance. {BLANK}: not all strengths were run."
)


def half_at(clean: float, values: Sequence[float | None], chance: float, amounts: Sequence[float]) -> float | str:
    """Return the weakest amount of a perturbation at which NN is below half of its clean value.

    Parameters
    ----------
    clean, values
        NN without the perturbation, and at each amount; None where there is no result.
    chance
        NN of a random ranking.
    amounts
        From the weakest on.

    Returns
    -------
    float or str
        The amount, or what is printed where there is none: see the legend of the tables.
    """
    if millionths(clean / 2 - chance) <= 0:
        return "n/a"
    for amount, value in zip(amounts, values, strict=True):
        if value is None:
            return BLANK
        if millionths(value - clean / 2) < 0:
            return amount
    return f"{'<' if amounts[-1] < amounts[0] else '>'} {amounts[-1]:g}"


def robustness(results: Iterable[Result]) -> list[DataFrame]:
    """Collect NN of each data set and input that has results under some perturbation, and clean ones.

    Parameters
    ----------
    results
        Records of clean and perturbed galleries, among others.

    Returns
    -------
    list of pandas.DataFrame
        One for each set and input, with a row for each perturbation, method and strength: ``dataset``, ``n_shapes``,
        ``input``, ``scorer`` ("" for the default one), ``method``, ``title``, ``chance``, ``perturbation``,
        ``strength``, ``amount``, ``clean_NN``, ``NN`` (None where there is no result; a shape that was destroyed is a
        query without success), ``unsupported`` (shapes that were destroyed), ``half`` as printed, and ``half_at``.
    """
    from pandas import DataFrame

    clean: dict[tuple[str, str, str], Record] = {}
    perturbed: dict[tuple[str, str, str, str], dict[int, Record]] = {}
    for record in (result.record for result in results):
        if place := parsed(record["data"]["name"]):
            base = f"{place[0]} (quick)" if record["data"]["quick"] else place[0]
            by_strength = perturbed.setdefault((base, record["input"], place[1], record["method"]), {})
            by_strength[place[2]] = record
        else:
            clean[record["gallery"], record["input"], record["method"]] = record

    def order(place: tuple[str, str, str, str]) -> tuple[Any, ...]:
        return place[0], INPUTS.index(place[1]), [*PERTURBATIONS].index(place[2]), _table_order(place[3])

    sets: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for base, input_, perturbation, method in sorted(perturbed, key=order):
        whole = clean.get((base, input_, method))
        if whole is None or whole["status"] != "ok":
            continue
        found = [perturbed[base, input_, perturbation, method].get(strength) for strength in STRENGTHS]
        values, amounts = [_counted(each) for each in found], PERTURBATIONS[perturbation].amounts
        nn, chance = _counted(whole) or 0.0, chance_of(whole)["NN"]
        half = half_at(nn, values, chance, amounts)
        sets.setdefault((base, input_), []).extend(
            {
                "dataset": base,
                "n_shapes": whole["data"]["n_shapes"],
                "input": input_,
                "scorer": whole["scorer"] if "scorer_title" in whole else "",
                "method": method,
                "title": whole["title"],
                "perturbation": perturbation,
                "strength": strength,
                "amount": amount,
                "clean_NN": nn,
                "NN": value,
                "unsupported": len(record.get("unsupported", ())) if record else None,
                "half_at": None if isinstance(half, str) else half,
                "half": half if isinstance(half, str) else f"{half:g}",
                "chance": chance,
            }
            for strength, amount, value, record in zip(STRENGTHS, amounts, values, found, strict=True)
        )
    frames = [DataFrame(rows, dtype=object) for rows in sets.values()]
    return [frame.assign(n_shapes=frame["n_shapes"].max(), scorer=frame["scorer"].max()) for frame in frames]


def file_stem(found: DataFrame) -> str:
    """Name of the files of a set under an input."""
    return stem("robustness", *found.iloc[0][["dataset", "input", "scorer"]])


def titles(found: DataFrame) -> dict[str, str]:
    """Title of each method by its name, in the order of the tables."""
    named = dict(zip(found["method"], found["title"], strict=True))
    return {name: named[name] for name in sorted(named, key=_table_order)}


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


def rendered(found: Sequence[DataFrame], formats: Iterable[str]) -> dict[str, str]:
    """Texts by file name, as :func:`benchmark.report.files.render` makes those of the other tables."""
    files: dict[str, str] = {}
    for name in formats if found else ():
        if name == "markdown":
            files |= {f"{file_stem(each)}.md": markdown(each) for each in found}
        elif name == "latex":
            files |= {f"{file_stem(each)}.tex": latex(each) for each in found}
        elif name == "csv":
            files["robustness.csv"] = as_csv(found)
        else:
            files["robustness.json"] = json.dumps(_rows(found), indent=1) + "\n"
    return files


def markdown(found: DataFrame) -> str:
    """The amounts at which each method fails, then NN at each strength."""
    named, halves = titles(found), _halves(found)
    rows = zip(map(markdown_text, named.values()), *halves.values(), strict=True)
    lines = [f"**What breaks the methods: {markdown_text(_title(found))}.**", "", _LEGEND, ""]
    lines += markdown_table(["Method", *halves], [[*row] for row in rows])
    for perturbation, part in found.groupby("perturbation", sort=False):
        known = PERTURBATIONS[str(perturbation)]
        body = [
            [markdown_text(named[method]), *map(number, (curve["clean_NN"].iloc[0], *curve["NN"]))]
            for method, curve in part.groupby("method", sort=False)
        ]
        lost = part.fillna({"unsupported": 0}).groupby("strength")["unsupported"].max()
        if any(lost):
            body.append(["*Shapes destroyed, at most*", "0", *map(str, lost)])
        header = ["Method", "clean", *(f"{amount:g}" for amount in known.amounts)]
        lines += ["", f"NN under {known.title} ({known.unit}):", "", *markdown_table(header, body)]
    return "\n".join(lines) + "\n"


def latex(found: DataFrame) -> str:
    r"""The amounts at which each method fails, for ``\input``."""
    columns = []
    for head, cells in _halves(found).items():
        words = r"\\".join(map(latex_text, head.split()))  # each word of a heading has a line
        columns.append(Columns("", (rf"\shortstack[r]{{{words}}}",), [latex_text(cell) for cell in cells], 2))
    caption = latex_text(f"What breaks the methods: {_title(found)}. {_LEGEND}")
    return float_of(file_stem(found), caption, [latex_text(title) for title in titles(found).values()], columns)


def as_csv(found: Sequence[DataFrame]) -> str:
    """One line per data set, input, method, perturbation and strength."""
    names = ["dataset", "input", "scorer", "method", "perturbation", "strength", "amount"]
    names += ["clean_NN", "NN", "unsupported", "half_at"]
    return csv_text(names, _rows(found))


def _rows(found: Sequence[DataFrame]) -> list[dict[str, Any]]:
    return [
        {
            **{str(name): value for name, value in row.items() if name not in ("n_shapes", "half", "chance")},
            "scorer": row["scorer"] or None,
            "clean_NN": round(row["clean_NN"], 6),
            "NN": None if row["NN"] is None else round(row["NN"], 6),
        }
        for frame in found
        for row in frame.to_dict("records")
    ]


def _halves(found: DataFrame) -> Mapping[str, list[str]]:
    """Clean NN, and where each perturbation halves it, by heading: a text for each method."""
    names, clean = [*titles(found)], found.drop_duplicates("method").set_index("method")["clean_NN"]
    columns = {"clean NN": [number(clean[name]) for name in names]}
    for perturbation, part in found.groupby("perturbation", sort=False):
        half = dict(zip(part["method"], part["half"], strict=True))
        columns[PERTURBATIONS[str(perturbation)].title] = [half.get(name, BLANK) for name in names]
    return columns


def _title(found: DataFrame) -> str:
    first = found.iloc[0]
    by = f", scored by {first['scorer']}" if first["scorer"] else ""
    return f"{first['dataset']}, {first['n_shapes']} shapes, {first['input']} input{by}"
