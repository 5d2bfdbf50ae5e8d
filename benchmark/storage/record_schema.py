"""Schema of the record of a job: its parts, their kinds, and that its key is its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, get_args

from benchmark.api.contracts import Input
from benchmark.errors import ConfigurationError
from benchmark.storage.keys import digest
from retrieval.chance import chance_levels
from retrieval.measures import PRINTED

#: A type; a list of one kind; a mapping from names to one kind (``{...: kind}``) or to the kinds of its parts, of which
#: those whose names end in ``?`` may be missing; or a question to be answered with yes.
Kind = type | list[Any] | dict[Any, Any] | Callable[[Any], bool]

_LARGEST_NUMBER = 1e15

#: Largest difference between a mean in a record and the one that its queries, of six decimals, give.
_ROUNDING = 1e-6

#: Largest share: means of many hang over 1 by their rounding.
_ONE = 1 + 1e-9


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= _LARGEST_NUMBER


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value <= _LARGEST_NUMBER


def _is_duration(value: Any) -> bool:
    return _is_number(value) and value >= 0


def _is_share(value: Any) -> bool:
    return _is_number(value) and 0 <= value <= _ONE


def _are_shares(values: Any) -> bool:
    """Return whether a list holds a share for each query; there is none for the only one of its class."""
    if not isinstance(values, list) or not set(map(type, values)) <= {float, int, type(None)}:
        return False
    found = [value for value in values if value is not None]
    return not found or (min(found) >= 0 and max(found) <= _ONE)


def _are_named_texts(values: Any) -> bool:
    return isinstance(values, dict) and set(map(type, values.values())) <= {str}


def _are_texts(values: Any) -> bool:
    return isinstance(values, list) and set(map(type, values)) <= {str}


def _is_pair(value: Any) -> bool:
    return _are_texts(value) and len(value) == 2


def _is_input(value: Any) -> bool:
    return value in get_args(Input)


def _is_seed(value: Any) -> bool:
    return type(value) is int


def _is_number_or_none(value: Any) -> bool:
    return value is None or _is_number(value)


def _is_mapping_or_none(value: Any) -> bool:
    return value is None or isinstance(value, dict)


def _quantiles(values: Any) -> bool:
    return _are_shares(values) and len(values) == 3 and None not in values


_PRINTED = dict.fromkeys(PRINTED, object)
_STAGE = {"code?": _are_named_texts, "packages?": _are_named_texts}
_MODEL = {"training": str, "data": str, "digest": str, "schedule": str, "extra_data": bool}

#: What every record has, and what it may have.
_RECORD: Kind = {
    "key": str, "gallery": str, "input": _is_input, "method": str, "title": str, "family": str, "parameters": dict,
    "target": str, "status": str, "reason?": str, "traceback?": str, "finished?": str,
    "scorer?": str, "scorer_title?": str,
    "recipe": {
        "seed?": _is_seed, "unavailable?": str, "parameters?": dict, "models?": _are_named_texts,
        "versions?": _are_named_texts, "plugin?": _are_named_texts, "code?": {...: _STAGE},
    },
    "data": {
        "name": str, "title": str, "stand_in_for": str, "source": str, "module": str, "quick": bool,
        "n_shapes": _is_count, "n_classes": _is_count, "chance": {...: _is_share} | _PRINTED,
    },
    "unsupported?": [_is_pair], "environments?": [dict], "artefacts?": _are_texts, "models?": [_MODEL],
    "digests?": _are_named_texts, "files?": _are_named_texts, "commit?": str,
    "seen?": _are_texts, "notes?": {...: _is_mapping_or_none}, "peak_mib?": _is_number_or_none,
}  # fmt: skip

#: What it has besides if the job was ok.
_SCORED: dict[Any, Any] = {
    "scores": {...: _is_share} | _PRINTED, "chance": {...: _is_share} | _PRINTED,
    "per_query": {...: _are_shares} | _PRINTED,
    "shapes": _are_texts, "labels": _are_texts, "n_shapes": _is_count, "n_classes": _is_count,
    "unsupported": [_is_pair], "unprepared?": _are_texts, "coverage?": _is_share,
    "supported?": {...: _is_share} | _PRINTED,
    "cost": {"seconds_per_shape": {...: _is_duration}},
    "splits?": {"count": _is_count, "size": _is_count, "quantiles": {...: _quantiles}},
}  # fmt: skip

#: Large parts whose every number was looked at.
_CHECKED = ("per_query", "shapes", "labels")


def fault_of(content: Any) -> str:
    """Return why something read from a file is not the record of a job; "" if it is one."""
    try:
        fault = _fault(content, _RECORD, "")
        if not fault and content["status"] == "ok":
            fault = _fault(content, _SCORED, "") or _miscount(content)
        if not fault and digest(content["recipe"]) != content["key"].rpartition("-")[2]:
            fault = "its key is not that of its recipe"
        if not fault:
            json.dumps({name: part for name, part in content.items() if name not in _CHECKED}, allow_nan=False)
    except RecursionError:
        return "it is nested too deeply"
    except ValueError:
        return "it holds a number beyond all bounds"
    return fault


def _miscount(content: Mapping[str, Any]) -> str:
    n_queries = len(content["shapes"])
    if content["n_shapes"] != n_queries or content["n_classes"] != len(set(content["labels"])):
        return "'n_shapes' or 'n_classes' is not the number of its shapes or classes"
    if len(content["labels"]) != n_queries:
        return "'labels' has another length than 'shapes'"
    for name, values in content["per_query"].items():
        if len(values) != n_queries:
            return f"'per_query.{name}' has another length than 'shapes'"
        known = [value for value in values if value is not None]
        if known and not _agree(content["scores"].get(name), sum(known) / len(known)):
            return f"'scores.{name}' is not the mean of its queries"
    try:
        chance = chance_of_labels(tuple(content["labels"]))
    except ConfigurationError:
        return "no class of its labels has two members"
    wrong = next((name for name, value in content["chance"].items() if not _agree(value, chance.get(name))), None)
    return f"'chance.{wrong}' is not that of its labels" if wrong is not None else ""


def _agree(one: float | None, other: float | None) -> bool:
    """Return whether two figures are the same but for the rounding of single queries."""
    return one is not None and other is not None and abs(one - other) <= _ROUNDING


@cache
def chance_of_labels(labels: tuple[str, ...]) -> Mapping[str, float]:
    """Return what a random ranking of a gallery reaches, by measure; see :func:`retrieval.chance.chance_levels`."""
    return chance_levels(labels)


def _fault(content: Any, kind: Kind, where: str) -> str:
    if isinstance(kind, type):
        return "" if isinstance(content, kind) else _wrong(where)
    if isinstance(kind, list):
        if not isinstance(content, list):
            return _wrong(where)
        return next((fault for each in content if (fault := _fault(each, kind[0], where))), "")
    if isinstance(kind, dict):
        return _fault_of_parts(content, kind, where)
    return "" if kind(content) else _wrong(where)


def _fault_of_parts(content: Any, kinds: Mapping[Any, Kind], where: str) -> str:
    if not isinstance(content, dict):
        return _wrong(where)
    for name, kind in kinds.items():
        if name is ...:
            parts = list(content)
        else:
            parts = [name.removesuffix("?")]
            if parts[0] not in content:
                if name.endswith("?"):
                    continue
                return f"it has no '{where}{parts[0]}'"
        for part in parts:
            if fault := _fault(content[part], kind, f"{where}{part}."):
                return fault
    return ""


def _wrong(where: str) -> str:
    return f"'{where.removesuffix('.')}' is not what a record has there" if where else "it is no JSON object"


def not_a_number(name: str) -> float:
    """Refuse what JSON does not have and Python reads all the same: ``NaN`` and ``Infinity``."""
    raise ValueError(f"{name} is not JSON")
