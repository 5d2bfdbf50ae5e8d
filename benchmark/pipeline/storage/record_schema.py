"""Schema of the record of a job: its parts, their consistency, and its line in a file where records share parts."""

from __future__ import annotations

import hashlib
import json
import re
import string
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import cache, lru_cache
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, UnsetType

from benchmark.api.contracts import Input
from benchmark.errors import ConfigurationError
from benchmark.pipeline.storage.keys import bare_key, digest
from retrieval.chance import chance_levels
from retrieval.measures import PRINTED

#: Largest accepted difference between a mean in a record and the mean of its queries, which are rounded to six
#: decimals.
_ROUNDING = 1e-6

Amount = Annotated[float, Meta(ge=0, le=1e15)]
Share = Annotated[float, Meta(ge=0, le=1 + 1e-9)]  # rounding may push a mean slightly above 1
Count = Annotated[int, Meta(ge=0, le=10**15)]
Texts = dict[str, str]
Shares = dict[str, Share]

#: Parts with one value or a list of values for each measure.
_BY_MEASURE = ("scores", "chance", "per_query", "supported", "codebook_deviation")

#: Required parts of a record with status ``ok``.
_SCORED = ("scores", "chance", "per_query", "shapes", "labels", "n_shapes", "n_classes", "unsupported", "cost")


class _Stage(msgspec.Struct):
    code: Texts | UnsetType = UNSET
    packages: Texts | UnsetType = UNSET


class _Recipe(msgspec.Struct):
    seed: int | UnsetType = UNSET
    unavailable: str | UnsetType = UNSET
    parameters: dict[str, Any] | UnsetType = UNSET
    models: Texts | UnsetType = UNSET
    versions: Texts | UnsetType = UNSET
    plugin: Texts | UnsetType = UNSET
    code: dict[str, _Stage] | UnsetType = UNSET


class _Data(msgspec.Struct):
    name: str
    title: str
    stand_in_for: str
    source: str
    module: str
    quick: bool
    n_shapes: Count
    n_classes: Count
    chance: Shares


class _Model(msgspec.Struct):
    training: str
    data: str
    digest: str
    schedule: str
    extra_data: bool


class _Environment(msgspec.Struct):
    environment: str | dict[str, Any] = ""
    artefacts: Count = 0


class _Cost(msgspec.Struct):
    seconds_per_shape: dict[str, Amount]


class _Record(msgspec.Struct, kw_only=True):
    key: str
    gallery: str
    input: Input
    method: str
    title: str
    family: str
    parameters: dict[str, Any]
    target: str
    status: str
    recipe: _Recipe
    data: _Data
    reason: str | UnsetType = UNSET
    traceback: str | UnsetType = UNSET
    finished: str | UnsetType = UNSET
    scorer: str | UnsetType = UNSET
    scorer_title: str | UnsetType = UNSET
    scores: Shares | UnsetType = UNSET
    chance: Shares | UnsetType = UNSET
    supported: Shares | UnsetType = UNSET
    codebook_deviation: dict[str, Amount] | UnsetType | None = UNSET
    per_query: dict[str, list[Share | None]] | UnsetType = UNSET
    shapes: list[str] | UnsetType = UNSET
    labels: list[str] | UnsetType = UNSET
    n_shapes: Count | UnsetType = UNSET
    n_classes: Count | UnsetType = UNSET
    tied_queries: Count | UnsetType = UNSET
    lone_queries: Count | UnsetType = UNSET
    unsupported: list[tuple[str, str]] | UnsetType = UNSET
    unprepared: list[str] | UnsetType = UNSET
    coverage: Share | UnsetType = UNSET
    cost: _Cost | UnsetType = UNSET
    peak_mib: Amount | UnsetType | None = UNSET
    wall_seconds: Amount | UnsetType = UNSET
    environments: list[_Environment] | UnsetType = UNSET
    artefacts: list[str] | UnsetType = UNSET
    models: list[_Model] | UnsetType = UNSET
    digests: Texts | UnsetType = UNSET
    files: Texts | UnsetType = UNSET
    commit: str | UnsetType = UNSET
    seen: list[str] | UnsetType = UNSET
    notes: dict[str, dict[str, Any] | None] | UnsetType = UNSET


def fault_of(content: Any) -> str:
    """Return the reason why data from a file is not the record of a job; "" if it is one."""
    try:
        msgspec.convert(content, _Record)
        return next(_faults(content), "")
    except msgspec.ValidationError as error:
        return f"it is not a record: {error}"
    except RecursionError:
        return "it is nested too deeply"


def _faults(record: Mapping[str, Any]) -> Iterator[str]:
    """Yield the faults of a record whose parts have the right types; each check relies on the earlier ones."""
    parts = {name: record[name] for name in _BY_MEASURE if record.get(name) is not None}
    for name, part in {**parts, "data.chance": record["data"]["chance"]}.items():
        yield from (f"it has no '{name}.{measure}'" for measure in PRINTED if measure not in part)
    if "scorer_title" in record and "scorer" not in record:
        yield "it has the title of a scorer and no 'scorer'"
    if record["status"] == "ok":
        yield from (f"it has no '{name}'" for name in _SCORED if name not in record)
        yield from _faults_of_shapes(record)
        yield from _faults_of_scores(record)
    elif "scores" in record:
        yield "it has scores, and is not ok"
    yield from _faults_of_names(record)
    if digest(record["recipe"]) != bare_key(record["key"]):
        yield "its key is not that of its recipe"


def _faults_of_names(record: Mapping[str, Any]) -> Iterator[str]:
    """Yield the reasons why names in a record cannot be names of files or shapes."""
    data = record["data"]
    names = [record["gallery"], record["method"], record.get("scorer", ""), data["name"], data["source"]]
    text = "".join([*names, *record.get("shapes", ()), *record.get("labels", ())])
    try:
        text.encode("utf-8", "surrogateescape")  # as Python reads file names that are not UTF-8
    except UnicodeEncodeError:
        yield "a name in it is not valid Unicode"
    if "\0" in text:
        yield "a name in it contains NUL"


def _faults_of_shapes(record: Mapping[str, Any]) -> Iterator[str]:
    shapes, refused = record["shapes"], [name for name, _ in record["unsupported"]]
    if record["n_shapes"] != len(shapes) or record["n_classes"] != len(set(record["labels"])):
        yield "'n_shapes' or 'n_classes' is not the number of its shapes or classes"
    if len(record["labels"]) != len(shapes):
        yield "'labels' has another length than 'shapes'"
    unprepared, seen, known = record.get("unprepared", []), record.get("seen", []), set(shapes)
    for part, names in (("shapes", shapes), ("unsupported", refused), ("unprepared", unprepared), ("seen", seen)):
        if len(set(names)) != len(names):
            yield f"'{part}' names a shape twice"
    if not known.issuperset(seen) or not set(refused).issuperset(unprepared):
        yield "'seen' or 'unprepared' names other shapes than 'shapes' or 'unsupported'"
    answered = (len(shapes) - len(refused)) / max(len(shapes) - len(unprepared), 1)
    if "coverage" not in record:  # older records do not count refused shapes
        if not known.isdisjoint(refused):
            yield "it has no 'coverage', and lacks shapes"
    elif not known.issuperset(refused) or not _agree(record["coverage"], answered):
        yield "'coverage' is not the share of its shapes that have a result"


def _faults_of_scores(record: Mapping[str, Any]) -> Iterator[str]:
    labels, scores = record["labels"], record["scores"]
    members = Counter(labels)
    is_alone = [members[label] == 1 for label in labels]
    if scores.keys() != record["per_query"].keys():
        yield "'scores' and 'per_query' name different measures"
    for name, values in record["per_query"].items():
        if len(values) != len(labels):
            yield f"'per_query.{name}' has another length than 'shapes'"
        if (None in values or True in is_alone) and [value is None for value in values] != is_alone:
            yield f"'per_query.{name}' has an invalid value"
        known = [value for value in values if value is not None]
        if not known or not _agree(scores[name], sum(known) / len(known)):
            yield f"'scores.{name}' is not the mean of its queries"
    try:
        chance = chance_of_labels(tuple(labels))
    except ConfigurationError:
        yield "no class of its labels has two members"
    for name, value in record["chance"].items():
        if not _agree(value, chance.get(name)):
            yield f"'chance.{name}' is not that of its labels"


def _agree(one: float | None, other: float | None) -> bool:
    """Return whether two values are equal up to the rounding of single queries."""
    return one is not None and other is not None and abs(one - other) <= _ROUNDING


@cache
def chance_of_labels(labels: tuple[str, ...]) -> Mapping[str, float]:
    """Return the chance level of a gallery by measure; see :func:`retrieval.chance.chance_levels`."""
    return chance_levels(labels)


def read_json(text: bytes) -> Any:
    """Parse JSON; raise ``ValueError`` for invalid text and for numbers that are too large."""
    try:
        return msgspec.json.decode(text)
    except msgspec.DecodeError:  # lone surrogates stand for file names that are not UTF-8
        content = json.loads(text)
        json.dumps(content, allow_nan=False)
        return content


#: Parts of a record that are shared as a whole, with the file that stores them.
_WHOLE = {"data": "galleries", "shapes": "galleries", "labels": "galleries", "chance": "galleries", "notes": "notes"}

#: Files of shared parts.
KINDS = ("code", "environments", "galleries", "notes")

_SHARED = re.compile(rb'\{"digest":"([0-9a-f]{16})","content":(.*)\}')

#: Characters that stand for the values of a measure, if there are few enough.
_CHARACTERS = string.digits + string.ascii_letters

#: Part of the records of version 0.2 that explains their keys.
_MOVES = "rekeyed"


class SharedParts:
    """Parts shared by records, by kind and digest; a part with a wrong digest counts as missing."""

    def __init__(self) -> None:
        self.lines: dict[str, dict[bytes, bytes]] = {kind: {} for kind in KINDS}

    def add(self, kind: str, content: Any) -> str:
        """Add a part and return its digest."""
        text = _compact(content)
        digest = _digest(text)
        self.lines[kind][digest.encode()] = b'{"digest":"%s","content":%s}' % (digest.encode(), text)
        return digest

    def content(self, kind: str, digest: str) -> Any:
        """Return the part with a digest; raise ``KeyError`` if there is none."""
        return _decoded(self.lines[kind][digest.encode()])["content"]

    def read(self, kind: str, text: bytes) -> None:
        """Add the lines of a file, including damaged ones, which are written back unchanged."""
        for line in text.splitlines():
            match = _SHARED.fullmatch(line)
            is_whole = match is not None and _digest(match[2]).encode() == match[1]
            self.lines[kind][match[1] if match and is_whole else b"~" + line] = line

    def update(self, other: SharedParts) -> None:
        """Add the parts of another object."""
        for kind, lines in other.lines.items():
            self.lines[kind].update(lines)


@lru_cache(maxsize=2**14)
def _decoded(line: bytes) -> Any:
    return msgspec.json.decode(line)


def as_line(record: Mapping[str, Any], parts: SharedParts) -> bytes:
    """Return a record as a line, key first, with digests in place of shared parts.

    Raises
    ------
    ValueError
        If it holds a number that JSON cannot represent.
    """
    line = _with_parts(record, parts.add)
    if "per_query" in line:
        line["per_query"] = {name: _packed_values(values) for name, values in line["per_query"].items()}
    return b'{"key":%s,%s' % (_compact(line.pop("key")), _compact(line)[1:])


def unpacked(line: Mapping[str, Any], parts: SharedParts) -> dict[str, Any]:
    """Return the record of a line; raise ``LookupError``, ``TypeError`` or ``AttributeError`` if it is not one."""
    record = _with_parts(line, parts.content)
    record.pop(_MOVES, None)
    if "per_query" in line:
        record["per_query"] = {name: _unpacked_values(values) for name, values in line["per_query"].items()}
    return record


def _with_parts(record: Mapping[str, Any], other: Callable[[str, Any], Any]) -> dict[str, Any]:
    """Return a record with each shared part replaced by the result of a function."""
    changed = dict(record)
    changed |= {name: other(kind, record[name]) for name, kind in _WHOLE.items() if name in record}
    if "code" in record["recipe"]:
        code = {stage: other("code", part) for stage, part in record["recipe"]["code"].items()}
        changed["recipe"] = {**record["recipe"], "code": code}
    if "environments" in record:
        changed["environments"] = [
            {name: other("environments", part) if name == "environment" else part for name, part in origin.items()}
            for origin in record["environments"]
        ]
    return changed


def _packed_values(values: list[float | None]) -> Any:
    """Return the distinct values and a character for each query, if the values are few; otherwise the list itself."""
    texts = list(map(repr, values))
    distinct = dict(zip(texts, values, strict=True))  # by text, because 1 and 1.0 are written differently
    if len(distinct) > len(_CHARACTERS):
        return values
    ranked = sorted(distinct, key=lambda text: (distinct[text] is None, distinct[text] or 0, text))
    character = dict(zip(ranked, _CHARACTERS, strict=False))
    return {"values": [distinct[text] for text in ranked], "queries": "".join(map(character.__getitem__, texts))}


def _unpacked_values(values: Any) -> Any:
    if not isinstance(values, dict):
        return values
    value_of = dict(zip(_CHARACTERS, values["values"], strict=False))
    return [value_of[character] for character in values["queries"]]


def _digest(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()[:16]


def _compact(content: Any) -> bytes:
    return json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":")).encode()
