"""Robustness of methods: NN over the strength of each perturbation as frames, and their formats."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from benchmark.datasets.changes import CHANGES, LEVELS, last_change
from benchmark.pipeline.storage.records import Record, chance_of, coverage_of
from benchmark.protocols.tables import INPUTS
from benchmark.report.content import OUTDATED, stem, usual_place
from benchmark.report.escaping import (
    BLANK,
    csv_text,
    latex_text,
    markdown_document,
    markdown_table,
    markdown_text,
    millionths,
    number,
)
from benchmark.report.latex import Columns, float_of
from benchmark.report.results import Result

if TYPE_CHECKING:
    from pandas import DataFrame

_LEGEND = (
    "Smallest tested amount of each perturbation at which NN is below half of its clean value; a shape that the "
    "perturbation destroys counts as a query without success. > : not up to the largest amount. n/a: half of the clean "
    f"value is not above chance. {BLANK}: not all strengths were run."
)

#: Columns of the files.
_COLUMNS = (
    "dataset", "input", "scorer", "method", "title", "perturbation", "strength", "amount", "clean_NN", "NN",
    "unsupported", "half_at", "outdated",
)  # fmt: skip


def half_at(clean: float, values: Sequence[float | None], chance: float, amounts: Sequence[float]) -> float | str:
    """Return the smallest amount of a perturbation at which NN is below half of its clean value.

    Parameters
    ----------
    clean, values
        NN without the perturbation, and at each amount; None if there is no result.
    chance
        Chance level of NN.
    amounts
        Amounts in increasing order.

    Returns
    -------
    float or str
        The amount, or a symbol if there is none; see the legend of the tables.
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
    """Collect NN for each data set and input with clean and perturbed results.

    Parameters
    ----------
    results
        Results, including those of clean and perturbed galleries.

    Returns
    -------
    list of pandas.DataFrame
        One for each set and input, with a row for each perturbation, method and strength: ``dataset``, ``n_shapes``,
        ``input``, ``scorer`` ("" for the default one), ``method``, ``title``, ``chance``, ``perturbation``,
        ``strength``, ``amount``, ``clean_NN``, ``NN`` (None without a result; destroyed shapes count as failed
        queries), ``unsupported`` (destroyed shapes), ``half`` as printed, ``half_at``, and ``outdated``.
    """
    from pandas import DataFrame

    clean: dict[tuple[str, str, str], Result] = {}
    perturbed: dict[tuple[str, str, str, str], dict[int, Result]] = {}
    for result in results:
        record = result.record
        if place := last_change(record["data"]["name"]):
            base = f"{place[0]} (quick)" if record["data"]["quick"] else place[0]
            by_strength = perturbed.setdefault((base, record["input"], place[1], record["method"]), {})
            by_strength[place[2]] = result
        elif record["status"] == "ok":
            clean[record["gallery"], record["input"], record["method"]] = result

    def order(place: tuple[str, str, str, str]) -> tuple[Any, ...]:
        return place[0], INPUTS.index(place[1]), [*CHANGES].index(place[2]), usual_place(place[3])

    rows = []
    for base, input_, perturbation, method in sorted(perturbed, key=order):
        if whole := clean.get((base, input_, method)):
            curve = [perturbed[base, input_, perturbation, method].get(strength) for strength in LEVELS]
            same = {"dataset": base, "input": input_, "method": method, "perturbation": perturbation}
            rows += [same | row for row in _curve(whole, curve, CHANGES[perturbation].amounts)]
    if not rows:
        return []
    frames = [frame for _, frame in DataFrame(rows, dtype=object).groupby(["dataset", "input"], sort=False)]
    return [frame.assign(n_shapes=frame["n_shapes"].max(), scorer=frame["scorer"].max()) for frame in frames]


def _curve(whole: Result, results: Sequence[Result | None], amounts: Sequence[float]) -> list[dict[str, Any]]:
    """Return the rows of one method for one perturbation, by strength."""
    clean, records = whole.record, [result.record if result else None for result in results]
    outdated = dict.fromkeys(result.outdated for result in (whole, *results) if result and result.outdated)
    nn, values = _counted(clean) or 0.0, [_counted(record) for record in records]
    chance = chance_of(clean)["NN"]
    half = half_at(nn, values, chance, amounts)
    same = {
        "n_shapes": clean["data"]["n_shapes"],
        "scorer": clean["scorer"] if "scorer_title" in clean else "",
        "title": clean["title"],
        "chance": chance,
        "clean_NN": nn,
        "half_at": None if isinstance(half, str) else half,
        "half": half if isinstance(half, str) else f"{half:g}",
        "outdated": "; ".join(outdated) or None,
    }
    refused = [len(record.get("unsupported", ())) if record else None for record in records]
    columns = zip(LEVELS, amounts, values, refused, strict=True)
    return [same | dict(zip(("strength", "amount", "NN", "unsupported"), row, strict=True)) for row in columns]


def _counted(record: Record | None) -> float | None:
    """Return NN over all shapes, with 0 for destroyed ones."""
    if record is not None and record["status"] == "unsupported":
        return 0.0  # no shape left
    if record is None or record["status"] != "ok":
        return None
    # Older records do not count refused shapes.
    return float(record["scores"]["NN"]) * (1.0 if "coverage" in record else coverage_of(record))


def file_stem(frame: DataFrame) -> str:
    """Return the prefix of file names for a data set and an input."""
    return stem("robustness", *frame.iloc[0][["dataset", "input", "scorer"]])


def titles(frame: DataFrame) -> dict[str, str]:
    """Return titles by method, in the order of the tables."""
    by_name = dict(zip(frame["method"], frame["title"], strict=True))
    outdated = set(frame.loc[frame["outdated"].notna(), "method"])
    marked = {name: f"{title} {OUTDATED}" if name in outdated else title for name, title in by_name.items()}
    return {name: marked[name] for name in sorted(marked, key=usual_place)}


def rendered(frames: Sequence[DataFrame], formats: Iterable[str]) -> dict[str, str]:
    """Return texts by file name, like :func:`benchmark.report.formats.render` for other tables."""
    files: dict[str, str] = {}
    for name in formats if frames else ():
        if name == "markdown":
            files |= {f"{file_stem(frame)}.md": markdown(frame) for frame in frames}
        elif name == "latex":
            files |= {f"{file_stem(frame)}.tex": latex(frame) for frame in frames}
        elif name == "csv":
            files["robustness.csv"] = as_csv(frames)
        else:
            files["robustness.json"] = json.dumps(_rows(frames), indent=1) + "\n"
    return files


def markdown(frame: DataFrame) -> str:
    """Return the amounts at which each method fails, then NN at each strength, as Markdown."""
    titled, halves = titles(frame), _halves(frame)
    rows = zip(map(markdown_text, titled.values()), *halves.values(), strict=True)
    parts = []
    for perturbation, part in frame.groupby("perturbation", sort=False):
        known = CHANGES[str(perturbation)]
        body = [
            [markdown_text(titled[method]), *map(number, (curve["clean_NN"].iloc[0], *curve["NN"]))]
            for method, curve in part.groupby("method", sort=False)
        ]
        lost = part.fillna({"unsupported": 0}).groupby("strength")["unsupported"].max()
        body += [["*Shapes destroyed, at most*", "0", *map(str, lost)]] if any(lost) else []
        head = ["Method", "clean", *(f"{amount:g}" for amount in known.amounts)]
        parts.append((known, markdown_table(head, body)))
    shown = markdown_table(["Method", *halves], map(list, rows))
    return markdown_document("robustness", title=_title(frame), legend=_legend(frame), halves=shown, parts=parts)


def latex(frame: DataFrame) -> str:
    r"""Return the amounts at which each method fails, for ``\input``."""
    columns = []
    for head, cells in _halves(frame).items():
        words = r"\\".join(map(latex_text, head.split()))  # one line for each word of a heading
        columns.append(Columns("", (rf"\shortstack[r]{{{words}}}",), [latex_text(cell) for cell in cells], 2))
    caption = latex_text(f"What breaks the methods: {_title(frame)}. {_legend(frame)}")
    return float_of(file_stem(frame), caption, [latex_text(title) for title in titles(frame).values()], columns)


def as_csv(frames: Sequence[DataFrame]) -> str:
    """Return CSV with one line per data set, input, method, perturbation and strength."""
    return csv_text([name for name in _COLUMNS if name != "title"], _rows(frames))


def _rows(frames: Sequence[DataFrame]) -> list[dict[str, Any]]:
    rows = [row for frame in frames for row in frame[[*_COLUMNS]].to_dict("records")]
    for row in rows:
        row["scorer"] = row["scorer"] or None
        row |= {name: None if row[name] is None else round(row[name], 6) for name in ("clean_NN", "NN")}
    return rows


def _halves(frame: DataFrame) -> dict[str, list[str]]:
    """Return clean NN, and the amount at which each perturbation halves it, by heading, as text for each method."""
    names, by_method = list(titles(frame)), frame.drop_duplicates("method").set_index("method")
    columns = {"clean NN": [number(value) for value in by_method.loc[names, "clean_NN"]]}
    for perturbation, part in frame.groupby("perturbation", sort=False):
        half = dict(zip(part["method"], part["half"], strict=True))
        columns[CHANGES[str(perturbation)].title] = [half.get(name, BLANK) for name in names]
    return columns


def _legend(frame: DataFrame) -> str:
    return f"{_LEGEND} {OUTDATED}: made before the last change." if frame["outdated"].notna().any() else _LEGEND


def _title(frame: DataFrame) -> str:
    first = frame.iloc[0]
    by = f", scored by {first['scorer']}" if first["scorer"] else ""
    return f"{first['dataset']}, {first['n_shapes']} shapes, {first['input']} input{by}"
