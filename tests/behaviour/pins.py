"""Lists of what can be named: options, methods, columns and signatures, written down in ``pinned/``.

What version 0.3 takes away is passed over, so that the lists hold before and after.
"""

from __future__ import annotations

import csv
import importlib
import inspect
import io
import json
import pkgutil
import re
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import benchmark.api
from tests.behaviour.suite import HERE, MEASURES, call

PINNED = HERE / "pinned"

#: Verbs and options that go.
GOING = {"rekey", "gather", "sample", "--neighbours", "compare --power", "compare --digests"}

#: Methods of a plugin in the results of version 0.2, which nobody can tell to be outdated without it.
OWN = ("broken", "flat", "picky")

#: What the contracts of methods name; what else a built-in one has is its own.
CONTRACTS = ("canonicalise", "describe", "distances", "train", "load", "predict")

#: What else authors and programs import: functions behind the methods, and the measures.
IMPORTED = {
    "benchmark.results": ("ResultsFolder", "open_results"),
    "baselines.classic_mds": ("classic_scaling",),
    "baselines.least_squares_mds": ("least_squares_scaling",),
    "baselines.non_metric_mds": ("non_metric_scaling",),
    "retrieval.agreement": ("Agreement", "agreement"),
    "retrieval.chance": ("chance_levels",),
    "retrieval.cmbof": ("CMBOF",),
    "retrieval.measures": ("MEASURES", "PRINTED", "Measure", "RandomOrder", "RankedResults"),
    "retrieval.metrics": ("Scores", "check_distances", "evaluate", "with_missing"),
    "retrieval.spherical_harmonics": ("SphericalHarmonics",),
    "retrieval.splits": ("Range", "all_splits", "ranges", "scores_of_splits"),
}


def options(verb: str = "") -> dict[str, list[str]]:
    """Arguments, options and the words that they take, for each verb, from its ``--help``."""
    text = call(*verb.split(), "--help").out
    usage = " ".join(text.partition("\n\n")[0].split()).removeprefix("Usage: python -m benchmark")
    heads = [line.strip() for line in text.splitlines() if re.match(r"  (-\w, )?-", line)]
    # The short form is that of the group, which click forgets where a verb was asked without it before.
    shown = [re.split(r"  +", head)[0].replace("-h, --help", "--help") for head in heads]
    verbs_options = {verb: [usage.strip(), *(each for each in shown if not _is_going(verb, each))]}
    verbs = text.partition("Show this message and exit.\n")[2]
    for name in sorted(re.findall(r"^  (\w+)  ", verbs, re.MULTILINE)):
        if name not in GOING:
            verbs_options |= options(f"{verb} {name}".strip())
    return verbs_options


def _is_going(verb: str, shown: str) -> bool:
    name = re.findall(r"--[\w-]+", shown)[-1:]
    return any(each in GOING or f"{verb} {each}" in GOING for each in name)


def listed(what: str, *words: str) -> list[dict[str, Any]]:
    """What ``list --json`` says."""
    return json.loads(call("list", what, "--json", *words).out)


def described(name: str) -> dict[str, Any]:
    """What ``describe --json`` says."""
    return json.loads(call("describe", name, "--json").out)


def methods() -> dict[str, dict[str, Any]]:
    """What ``describe --json`` says of each method, without prose."""
    names = [row["name"] for row in listed("methods")]
    facts_of = {name: described(name) for name in names}
    wanted = ("title", "family", "kind", "inputs", "scale", "deterministic", "requires")
    return {
        name: {key: facts[key] for key in wanted}
        | {"parameters": {each["name"]: each["default"] for each in facts["parameters"]}}
        for name, facts in facts_of.items()
    }


def names() -> dict[str, Any]:
    """Methods, scorers, data sets and tables."""
    sizes = ("kind", "shapes", "classes", "use")
    return (
        {f"method {name}": facts for name, facts in methods().items()}
        | {f"scorer {row['name']}": row["title"] for row in listed("scorers")}
        | {f"data set {row['name']}": {key: row[key] for key in sizes} for row in listed("datasets")}
        | {f"table {row['table']}": row["dataset"] for row in listed("tables")}
    )


def columns(old: Path) -> dict[str, str]:
    """Columns of CSV in their order, of data frames and keys of JSON in none, of the results folder of version 0.2."""
    from benchmark.results import open_results

    results = open_results(old / "old")
    rows = json.loads(call("tables", "--results", old / "old", "--format", "json").out)
    lines = list(csv.reader(io.StringIO(call("tables", "--results", old / "old", "--format", "csv").out)))
    outcome = json.loads(call("verify", old / "bundle.zip", "--json").out)
    method = described("least-squares-mds")
    keys = {
        "tables --format json": rows[0],
        "tables --format json: paper": next(row["paper"] for row in rows if row["paper"]),
        "tables --format json: chance": rows[0]["chance"],
        **{f"list {what} --json": listed(what)[0] for what in ("methods", "scorers", "datasets", "tables", "models")},
        "data list --json": json.loads(call("data", "list", "--json").out)[0],
        "describe --json": method,
        "describe --json: parameters": method["parameters"][0],
        "verify --json": outcome,
        "verify --json: rows": outcome["rows"][0],
        "results.records()": results.records().reset_index(),
        "results.queries()": results.queries(),
    }
    return {"tables --format csv": " ".join(lines[0])} | {name: " ".join(sorted(found)) for name, found in keys.items()}


def scores(old: Path) -> list[str]:
    """Place, status, scores and mark of each record of the results folder of version 0.2."""
    from benchmark.results import open_results

    lines = []
    for row in open_results(old / "old").records().itertuples():
        figures = "" if row.status != "ok" else " ".join(f"{getattr(row, name):.6f}" for name in MEASURES)
        place = f"{row.gallery}, {row.input}, {row.method}, {row.scorer or 'descriptor'}"
        mark = ", marked" if row.outdated and row.method not in OWN else ""
        lines.append(f"{place}: {row.status} {figures} {row.unsupported} of {row.n_shapes} refused{mark}")
    return sorted(lines)


def signatures() -> list[str]:
    """Signatures of public names, one a line; of classes with their methods and properties."""
    lines = []
    for name in sorted(_api_names()):
        lines += _lines(f"benchmark.api.{name}", getattr(benchmark.api, name))
    for module, wanted in IMPORTED.items():
        for name in wanted:
            lines += _lines(f"{module}.{name}", getattr(importlib.import_module(module), name))
    for target in sorted({described(name)["defined_in"] for name in methods()}):
        module, _, name = target.partition(":")
        value = getattr(importlib.import_module(module), name)
        lines += _lines(f"{module.partition('.')[0]}: {name}", value, CONTRACTS)
    return lines


def _api_names() -> set[str]:
    names = {"DepthForm", "canonical_form_of_depth", "form_of_object", "method_of_depth"}
    for module in pkgutil.walk_packages(benchmark.api.__path__, "benchmark.api."):
        names.update(getattr(importlib.import_module(module.name), "__all__", ()))
    return {name for name in names if hasattr(benchmark.api, name)}


def _lines(name: str, value: Any, wanted: Collection[str] = ()) -> Iterator[str]:
    """Signature of a name and, of a class, of its members: the wanted ones, or all that are public."""
    if not (inspect.isclass(value) or inspect.isroutine(value)):
        texts = isinstance(value, tuple) and all(isinstance(each, str) for each in value)
        yield f"{name} = {value!r}" if texts or isinstance(value, (str, int, float)) else name
        return
    yield name if getattr(value, "_is_protocol", False) else f"{name}{_signature(value)}"
    fields = getattr(value, "__dataclass_fields__", {})
    for member in dir(value) if inspect.isclass(value) else ():
        held = inspect.getattr_static(value, member, None)
        if member.startswith("_") or member in {*fields, *dir(Exception)} or (wanted and member not in wanted):
            continue
        if inspect.isroutine(getattr(value, member)):
            yield f"{name}.{member}{_signature(getattr(value, member))}"
        elif isinstance(held, (property, cached_property)):
            yield f"{name}.{member}"


class _Bare(str):
    """An annotation that is shown without quotes."""

    __slots__ = ()
    __repr__ = str.__str__


def _signature(value: Any) -> str:
    signature = inspect.signature(value)
    parameters = [each.replace(annotation=_bare(each.annotation)) for each in signature.parameters.values()]
    text = str(signature.replace(parameters=parameters, return_annotation=_bare(signature.return_annotation)))
    return text.replace(", rre]", "]")


def _bare(annotation: Any) -> Any:
    return (
        _Bare(annotation.strip("\"'").replace("'", "").replace('"', "")) if isinstance(annotation, str) else annotation
    )


def current(old: Path) -> dict[str, str]:
    """The text of each file in ``pinned/`` as it would be written now."""
    lists: dict[str, dict[str, Any]] = {"names": names(), "columns": columns(old)}
    texts = {
        f"{name}.json": "{\n" + ",\n".join(_line(*each) for each in found.items()) + "\n}\n"
        for name, found in lists.items()
    }
    return texts | {
        "options.json": json.dumps(options(), indent=1) + "\n",
        "scores-0.2.txt": "\n".join(scores(old)) + "\n",
        "signatures.txt": "\n".join(signatures()) + "\n",
    }


def _line(name: str, value: Any) -> str:
    return f"{json.dumps(name)}: {json.dumps(value, ensure_ascii=False)}"
