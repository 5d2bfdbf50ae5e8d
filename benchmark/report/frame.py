"""Printed values of a table as a tidy frame: a row for each method, group of columns and measure.

Each format writes these values in its own style. Columns that are not measures form separate groups.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from benchmark.api.contracts import Input
from benchmark.report.content import TableContent
from benchmark.report.escaping import BLANK, number
from benchmark.report.significance import CONTROL
from retrieval.measures import PRINTED

if TYPE_CHECKING:
    from pandas import DataFrame

Extra = Literal["difference", "interval"]
"""Additional groups: our scores minus the paper's, and intervals of our scores."""

_TITLES: Mapping[Extra, str] = {"difference": "{} minus paper", "interval": "95 % interval"}


@dataclass(frozen=True)
class Style:
    """Style of values in a format.

    Parameters
    ----------
    best, inseparable
        Patterns of the best value of a column, and of one that does not differ significantly.
    spread
        Pattern of the standard deviation after a mean.
    minus
        Sign of a negative difference.
    """

    best: str
    inseparable: str
    spread: str = " ± {}"
    minus: str = "-"

    def write(self, figure: Mapping[str, str]) -> str:
        """Return a row of the frame as text, with its mark and its spread."""
        text, spread = figure["text"], figure["spread"]
        if text.startswith("-") and text != BLANK:
            text = self.minus + text[1:]
        patterns = {"best": self.best, "inseparable": self.inseparable, "": "{}"}
        return patterns[figure["mark"]].format(text) + (self.spread.format(spread) if spread else "")


def figures(table: TableContent, extra: Extra | None = None) -> DataFrame:
    """Return the values of a table: the paper's if it has the table, then ours, then extra ones.

    Values are compared after rounding, so all values printed as the best are marked. Controls and incomplete rows are
    excluded.

    Returns
    -------
    pandas.DataFrame
        ``row`` (its index; the last is chance), ``group``, ``kind`` (paper, ours or the extra one), ``input``,
        ``measure``, ``text``, ``mark`` ("best", "inseparable" or ""), ``spread`` (standard deviation of an averaged
        score, or "") and ``interval``.
    """
    from pandas import DataFrame

    groups: list[tuple[str, str, Input | None]] = [("paper", "paper", None)] if table.has_paper else []
    groups += [(input_, "ours", input_) for input_ in table.inputs]
    groups += [(_TITLES[extra].format(input_), extra, input_) for input_ in table.inputs if extra]
    frame = DataFrame(
        {"row": place, "group": group, "kind": kind, "input": input_, "measure": name}
        | {"text": BLANK, "mark": "", "spread": "", "interval": "", "competes": False}
        | _figure(table, row, kind, input_, name)
        for place, row in enumerate([*table.rows, None])
        for group, kind, input_ in groups
        for name in PRINTED
    )
    contest = frame["text"].where(frame["competes"] & (frame["text"] != BLANK), "")
    best = contest.groupby([frame["group"], frame["measure"]]).transform("max")
    return frame.assign(mark=frame["mark"].mask((contest != "") & (contest == best), "best"))


def _figure(table: TableContent, row: Any | None, kind: str, input_: Input | None, measure: str) -> dict[str, object]:
    """Return text, mark, spread and interval of one value, as available; without a row, those of the chance level."""
    if row is None:
        return {"text": number(table.chance[measure])} if kind in ("paper", "ours") else {}
    theirs = row.paper[measure] if row.paper else None
    if kind == "paper" or input_ is None:
        return {"text": number(theirs)}
    line = table.line(row.method, input_)
    if line is None or not line.scores:
        return {}
    judged, ours = table.judged(line).get(measure), number(line.scores.get(measure))
    interval = f"{number(judged.low)} to {number(judged.high)}" if judged else ""
    if kind == "difference":
        return {"text": _difference(ours, number(theirs)), "interval": interval}
    if kind == "interval":
        return {"text": interval.replace(" to ", "\u2013") or BLANK, "interval": interval}
    return {
        "text": ours,
        "mark": "inseparable" if judged and judged.is_inseparable else "",
        "spread": number(line.deviation[measure]) if line.deviation and measure in line.deviation else "",
        "interval": interval,
        "competes": row.family != CONTROL and line.coverage >= 1,
    }


def _difference(ours: str, theirs: str) -> str:
    """Return our score minus the paper's, both as printed, so that readers get the same difference."""
    if BLANK in (ours, theirs):
        return BLANK
    hundredths = round(float(ours) * 100) - round(float(theirs) * 100)
    return f"{'-' if hundredths < 0 else '+' if hundredths else ''}{number(abs(hundredths) / 100)}"


def printed(frame: DataFrame, style: Style) -> DataFrame:
    """Return the values as text: a row for each method and one for chance, columns by group and measure."""
    texts = [style.write(figure) for figure in frame.to_dict("records")]
    wide = frame.assign(text=texts).pivot(index="row", columns=["group", "measure"], values="text")
    return wide[[*dict.fromkeys(zip(frame["group"], frame["measure"], strict=True))]]


def labels(table: TableContent) -> list[str]:
    """Return the label of each row of the frame."""
    return [*(table.label(row) for row in table.rows), "Chance"]


def lines(table: TableContent) -> list[tuple[Any | None, str, list[dict[Any, Any]]]]:
    """Return row, label and values of each line of a table; the row of the chance level is None."""
    by_row = [of_row.to_dict("records") for _, of_row in figures(table).groupby("row")]
    return list(zip([*table.rows, None], labels(table), by_row, strict=True))
