"""Content of a table, independent of its format: a pure function of records."""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from benchmark.api.contracts import Input
from benchmark.datasets.changes import last_change
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import EXTERNAL, chance_of
from benchmark.plugins.registry import BUILT_IN, MethodSpec
from benchmark.protocols.tables import AS_PRINTED, INPUTS, ONLY_ABLATED, TABLES, Table
from benchmark.reference import paper
from benchmark.report.escaping import number
from benchmark.report.results import MISSING, Figures, Result, line_of, tables_of
from benchmark.report.significance import CONTROL, FigureSignificance, TableSignificance, table_significance
from benchmark.text import LONGEST_NAME, brief

if TYPE_CHECKING:
    from pandas import DataFrame

#: Parameter of learners that distinguishes trainings of one row.
_TRAINING_SEED = "training_seed"

OFFICIAL_TITLES = {"shrec14-synthetic": "SHREC'14 synthetic", "shrec14-real": "SHREC'14 real", "tosca": "TOSCA"}

#: Title of the paper's network, which the paper calls "our".
_NETWORK = "Reconstruction network"

#: Superscript digits for the numbers of notes.
_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

#: Mark of rows with outdated results.
OUTDATED = "†"

#: Mark of rows with ties for the first rank.
TIED = "‡"


@dataclass(frozen=True, eq=False)
class TableContent:
    """One table on one data set.

    Parameters
    ----------
    table
        The table, from the paper or for other data.
    data
        Name, title and size of the data, as in the records.
    inputs
        The inputs shown.
    frame
        A row for each method and input with jobs, or with a row in the paper: the paper's methods in the paper's order,
        then all others. Its columns are ``method``, ``title``, ``family``, ``paper`` (scores in the paper, or None),
        ``departs`` (how the method departs from its source), ``run_under`` (all inputs with a job), ``input``, and
        those of :func:`benchmark.report.results.line_of`.
    chance
        Chance level by measure; the mean over galleries if there are several.
    n_galleries
        Number of galleries averaged in each row.
    scorer, scorer_title
        Name and title of the scorer; "" for the default.
    seed
        Base seed of the runs.
    whole
        The complete table, with more inputs; None for a complete table.
    """

    table: Table
    data: Mapping[str, Any]
    inputs: tuple[Input, ...]
    frame: DataFrame
    chance: Figures
    n_galleries: int
    scorer: str = ""
    scorer_title: str = ""
    seed: int = 0
    whole: TableContent | None = field(default=None, repr=False)

    @cached_property
    def lines(self) -> list[Any]:
        """Rows of the frame as named tuples, with ``label``: the title as printed, with marks."""
        by_method: dict[str, list[Any]] = {}
        for line in self.frame.itertuples(index=False):
            by_method.setdefault(line.method, []).append(line)
        labels = {method: _label(lines) for method, lines in by_method.items()}
        return [*self.frame.assign(label=self.frame["method"].map(labels)).itertuples(index=False, name="Line")]

    @cached_property
    def rows(self) -> list[Any]:
        """First line of each method."""
        return [*{line.method: line for line in reversed(self.lines)}.values()][::-1]

    def line(self, method: str, input_: Input | None) -> Any | None:
        """Return the line of a method for an input; None if there is none."""
        return self._by_place.get((method, input_))

    @cached_property
    def _by_place(self) -> dict[tuple[str, Input | None], Any]:
        return {(line.method, line.input): line for line in self.lines}

    @cached_property
    def significance(self) -> TableSignificance:
        """Confidence intervals of the computed scores, and tests against the best row."""
        if self.whole is None:
            return table_significance(self.lines)
        return {place: judged for place, judged in self.whole.significance.items() if place[1] in self.inputs}

    def judged(self, line: Any) -> Mapping[str, FigureSignificance]:
        """Return the significance of the scores of a line by measure; empty without scores of all its jobs."""
        return self.significance.get((line.method, line.input), {})

    @cached_property
    def departures(self) -> Mapping[str, str]:
        """Departures of rows with scores from their sources, by the superscript number of the note."""
        texts = dict.fromkeys(line.departs for line in self.lines if line.departs and line.scores)
        return {str(number).translate(_RAISED): text for number, text in enumerate(texts, 1)}

    def label(self, line: Any) -> str:
        """Return the label of a row with the number of the note on its departures."""
        return " ".join([line.label, *(number for number, text in self.departures.items() if text == line.departs)])

    @property
    def identifier(self) -> str:
        """Numeral in the paper, or name of the data set."""
        return self.table.identifier

    @property
    def is_own(self) -> bool:
        """Whether it shows private data, which no table of the suite includes."""
        return _known_table(self.identifier, self.data["name"]) is None

    @property
    def caption(self) -> str:
        """Caption without the data."""
        words = [self.table.caption_over(self.n_galleries)]
        words += [f"seed {self.seed}"] if self.seed else []
        words += [f"scored by {self.scorer_title}"] if self.scorer_title else []
        return ", ".join(words)

    @property
    def quick(self) -> bool:
        """Whether poses were omitted to save time."""
        return bool(self.data["quick"])

    @property
    def file_stem(self) -> str:
        """Name of the files of this table: letters, digits, dots, hyphens and underscores."""
        name, seed = self.data["name"], f"seed-{self.seed}" if self.seed else ""
        dataset = name if name != self.identifier else ""
        return stem("table", self.identifier, dataset, "quick" if self.quick else "", self.scorer, seed)

    @property
    def has_paper(self) -> bool:
        """Whether the table is in the paper."""
        return bool(self.frame["paper"].notna().any())

    @property
    def data_title(self) -> str:
        """Title of the data; it always states if they are a stand-in."""
        if official := self.data["stand_in_for"]:
            return f"generated stand-in '{self.data['name']}', not {OFFICIAL_TITLES.get(official, official)}"
        return str(self.data["title"])

    @property
    def size(self) -> str:
        """Number of shapes and classes in words."""
        of_gallery = f"{self.data['n_shapes']} shapes, {self.data['n_classes']} classes"
        return f"{self.n_galleries} x {of_gallery}" if self.n_galleries > 1 else of_gallery

    def of(self, input_: Input, *, paper_only: bool = False) -> TableContent:
        """Return the table for one input: the paper's rows and, unless ``paper_only``, all others that ran with it."""
        frame = self.frame[self.frame["input"] == input_]
        shown = frame["paper"].notna() | ((frame["status"] != MISSING) & (not paper_only))
        return replace(self, inputs=(input_,), frame=frame[shown], whole=None if paper_only else self)


def _label(lines: Sequence[Any]) -> str:
    """Return the title with additional training data, number of models, coverage, and marks."""
    first, models = lines[0], [model for line in lines for model in line.models]
    extra = "extra training data"
    facts = [extra] if any(model["extra_data"] for model in models) and extra not in first.title else []
    if models and any(line.n_wanted > 1 for line in lines):
        facts.append(f"{len(models)} model{'' if len(models) == 1 else 's'}")
    facts += [f"{line.input}: coverage {number(line.coverage)}" for line in lines if line.scores and line.coverage < 1]
    facts += [EXTERNAL] if first.family == EXTERNAL else []
    marks = [TIED] if any(line.n_tied for line in lines) else []
    marks += [OUTDATED] if any(line.outdated for line in lines) else []
    return " ".join([brief(first.title), *([f"({', '.join(facts)})"] if facts else []), *marks])


def stem(*parts: str) -> str:
    """Return a file name from non-empty parts.

    A modified name ends with a digest, so that two tables never share a file.
    """
    whole = "-".join(filter(None, parts))
    name = re.sub(r"[^\w.-]", "-", whole)[:LONGEST_NAME]
    return name if name == whole else f"{name}-{digest(whole)[:8]}"


def contents(
    results: Iterable[Result], tables: Iterable[str] = (), *, blanks: bool = True, named: bool = False
) -> list[TableContent]:
    """Return the contents of tables.

    Parameters
    ----------
    results
        The results to show.
    tables
        Identifiers of tables; their companion tables are added. Empty for all tables of the results.
    blanks
        Whether the paper's methods have rows even without results.
    named
        Whether the methods were selected by name. If so, methods of the ablation and additional seeds of a training
        also have rows in other tables.
    """
    chosen = set(tables)
    with_parts = chosen | {table.identifier for table in TABLES if table.part_of in chosen}
    grouped: dict[tuple[Table, str, bool], list[Result]] = {}
    for result in results:
        dataset, quick = result.record["data"]["name"], bool(result.record["data"]["quick"])
        for identifier in tables_of(result.record["gallery"], dataset, quick=quick):
            if identifier in with_parts or not (with_parts or last_change(dataset)):  # summarised under robustness
                table = _known_table(identifier, dataset) or own_table(dataset)
                name = table.dataset if table.mean_over_sets else dataset
                grouped.setdefault((table, name, quick), []).append(result)

    def place(key: tuple[Table, str, bool]) -> tuple[int, bool, str, bool]:
        table, name, quick = key
        return TABLES.index(table) if table in TABLES else len(TABLES), table.stand_in == name, name, quick

    filled = (_content(*key[:2], grouped[key], blanks=blanks, named=named) for key in sorted(grouped, key=place))
    return [table for table in filled if len(table.frame)]


def _known_table(identifier: str, dataset: str) -> Table | None:
    """Return the suite's table of a data set; None for private data, even for a folder called "I"."""
    return next((table for table in TABLES if table.identifier == identifier and dataset in table.datasets), None)


@cache
def own_table(dataset: str) -> Table:
    """Return the table of a data set that no table of the suite uses."""
    name = Path(dataset).name
    return Table(name, f"Retrieval on {name}", dataset, all_unseen=False)


def _content(table: Table, name: str, results: Sequence[Result], *, blanks: bool, named: bool) -> TableContent:
    from pandas import DataFrame

    by_row: dict[str, dict[Input, list[Result]]] = {}
    for result in results:
        if _belongs(table, result, everything=named or table not in TABLES):
            of_row = by_row.setdefault(row_of(table, result.record), {})
            of_row.setdefault(cast(Input, result.record["input"]), []).append(result)
    # The last record with scores of each gallery, if any.
    by_gallery = {r.record["gallery"]: r.record for r in sorted(results, key=lambda r: bool(r.record.get("scores")))}
    samples = [by_gallery[gallery] for gallery in sorted(by_gallery)]
    quick = bool(samples[0]["data"]["quick"])
    n_folds = len(samples) if table.mean_over_sets else 1 if quick else max(1, len(table.folds))
    inputs = tuple(input_ for input_ in INPUTS if any(input_ in of_row for of_row in by_row.values()))
    printed = paper.rows(table.identifier) if table in TABLES else {}
    names = [method for method in printed if blanks or method in by_row] + _others(by_row, printed)
    lines: list[dict[str, Any]] = []
    for method in names if by_row else ():
        of_row = by_row.get(method, {})
        row = {"method": method, "departs": departs_of(method), "run_under": tuple(of_row)}
        row |= _heading(method, of_row, printed.get(method), table)
        shown = inputs if method in printed else tuple(of_row)
        lines += [row | {"input": input_} | line_of(of_row.get(input_, ()), n_folds) for input_ in shown]
    chance = [chance_of(record) if record.get("scores") else record["data"]["chance"] for record in samples]
    scored = next((result.record for result in results if "scorer_title" in result.record), None)
    return TableContent(
        table,
        {**samples[0]["data"], "name": name},
        inputs,
        DataFrame(lines, dtype=object),
        {measure: statistics.fmean(levels[measure] for levels in chance) for measure in min(chance, key=len)},
        max(len(samples), n_folds),
        scored["scorer"] if scored is not None else "",
        brief(scored["scorer_title"]) if scored is not None else "",
        int(results[0].record["recipe"].get("seed", 0)),
    )


def _belongs(table: Table, result: Result, *, everything: bool) -> bool:
    """Return whether a table shows a record; an ablation shows only learners.

    Records that belong only to an ablation, such as seeds of a training, or to a table that names them, appear
    elsewhere only if everything does.
    """
    base, parameters = result.record["method"].partition("[")[0], result.record["parameters"]
    is_named = not parameters.items() >= AS_PRINTED.items() or AS_PRINTED in table.rows.models.get(base, ())
    is_seed = _TRAINING_SEED in parameters
    if table.ablation:
        return base in table.rows.names and is_named and (not is_seed or bool(table.rows.averaged))
    return everything or (is_named and not is_seed and base not in ONLY_ABLATED)


def row_of(table: Table, record: Mapping[str, Any]) -> str:
    """Return the row of a record; in some tables, trainings of a learner share one."""
    base, _, parameters = str(record["method"]).partition("[")
    if not (table.rows.averaged and parameters):
        return str(record["method"])
    rest = [part for part in parameters.removesuffix("]").split(",") if not part.startswith(f"{table.rows.averaged}=")]
    return f"{base}[{','.join(rest)}]" if any(rest) else base


def _heading(
    method: str, by_input: Mapping[Input, Sequence[Result]], printed: paper.PaperRow | None, table: Table
) -> dict[str, Any]:
    """Return title, family and the paper's scores of a row; records supply those of methods outside the paper."""
    if printed is not None:
        return {"title": printed.title, "family": "paper", "paper": printed.values[table.identifier]}
    records = [result.record for results in by_input.values() for result in results]
    record = next((record for record in records if record["method"] == method), records[0])
    title = str(record["title"])
    if table not in TABLES and method.partition("[")[0] in BUILT_IN:
        title = re.sub(r"^Our\b", _NETWORK, title)
    return {"title": title, "family": str(record["family"]), "paper": None}


def departs_of(method: str) -> str:
    """Return the departures of a method of the suite from its source; "" for plugins."""
    base = method.partition("[")[0]
    return MethodSpec(base, BUILT_IN[base]).info.departs if base in BUILT_IN else ""


def _others(by_row: Mapping[str, Mapping[Input, Sequence[Result]]], printed: Iterable[str]) -> list[str]:
    """Return the methods without a row in the paper: variants and others in the usual order, controls last."""

    def place(method: str) -> tuple[bool, tuple[int, str]]:
        return next(iter(by_row[method].values()))[0].record["family"] == CONTROL, usual_place(method)

    return sorted(by_row.keys() - set(printed), key=place)


def usual_place(method: str) -> tuple[int, str]:
    """Return a sort key: built-in methods in their order, then all others by name."""
    base = method.partition("[")[0]
    return list(BUILT_IN).index(base) if base in BUILT_IN else len(BUILT_IN), method
