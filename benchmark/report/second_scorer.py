"""Ranks of rows on TOSCA by the suite's scorer and by a second one, from published scores."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.record_files import SUITE_RESULTS
from benchmark.reference.paper import PAPER_MEASURES

#: Name of the second scorer in the published scores.
SECOND_SCORER = "spherical-harmonics"

#: Scores that differ by less are those of the same forms: records have six decimals.
_SAME = 1e-6

_FILE = SUITE_RESULTS / "figures" / "two-scorers.csv"


class Ranks(NamedTuple):
    """Ranks of a row among all others in one measure, counted from 1."""

    by_default: int
    by_second: int


def ranks_by_both(
    scores: Mapping[str, Mapping[str, float]], input_: str
) -> dict[str, dict[str, Ranks]]:
    """Return the ranks of methods by the default scorer and by a second one, by method and measure.

    Scores by the second scorer are published with the suite. They are used only for methods whose
    score by the default scorer is the published one, so that both scorers judged the same forms.

    Parameters
    ----------
    scores
        Scores of methods by the default scorer, by method and measure.
    input_
        ``"mesh"`` or ``"view"``.
    """
    ranks: dict[str, dict[str, Ranks]] = {}
    for measure in PAPER_MEASURES:
        default = _published_scores().get((input_, DEFAULT_SCORER, measure), {})
        second = _published_scores().get((input_, SECOND_SCORER, measure), {})
        for method, scores_of_method in scores.items():
            if measure not in scores_of_method or method not in default:
                continue
            if abs(scores_of_method[measure] - default[method]) < _SAME:
                both = Ranks(_rank(method, default), _rank(method, second))
                ranks.setdefault(method, {})[measure] = both
    return ranks


def _rank(method: str, scores: Mapping[str, float]) -> int:
    """Return the rank of a method among all that have a score."""
    return 1 + sum(scores[method] < score for score in scores.values())


@cache
def _published_scores() -> dict[tuple[str, str, str], dict[str, float]]:
    """Return published scores of methods on TOSCA by input, scorer and measure.

    It is empty if the file is missing.
    """
    if not _FILE.is_file():
        return {}
    scores: dict[tuple[str, str, str], dict[str, float]] = {}
    for line in csv.DictReader(_FILE.read_text(encoding="utf-8").splitlines()):
        place = line.get("input", "mesh"), line["scorer"], line["measure"]
        scores.setdefault(place, {})[line["method"]] = float(line["value"])
    return scores
