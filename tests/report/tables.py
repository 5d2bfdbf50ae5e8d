"""Tables from single lines, for what no list of records would bring."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pandas import DataFrame

from benchmark.report.results import Result, line_of


def line(method: str, input_: str, *results: Result, title: str = "", **more: Any) -> dict[str, Any]:
    """Line of a method under an input, of results on one gallery; of none it is missing."""
    heading = {"method": method, "title": title or method.upper(), "family": "extended", "paper": None, "departs": ""}
    return heading | {"run_under": (), "input": input_} | line_of(results, 1) | more


def frame(lines: Iterable[dict[str, Any]]) -> DataFrame:
    """Frame of a table of these lines."""
    return DataFrame(list(lines), dtype=object)
