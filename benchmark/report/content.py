"""Content of a table, before it is LaTeX, Markdown, CSV or JSON: a pure function of records."""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from benchmark.api.contracts import Input
from benchmark.datasets.perturbations.dataset import parsed
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.records import EXTERNAL, chance_of
from benchmark.plugins.registry import BUILT_IN, MethodSpec
from benchmark.protocols.tables import INPUTS, ONLY_ABLATED, TABLES, Table
from benchmark.reference import paper
from benchmark.report.cell import Cell, Figures, cell_of
from benchmark.report.results import Result, tables_of
from benchmark.report.rounding import number
from benchmark.report.statistics.table_significance import SignificanceTable, table_significance
from benchmark.text import brief

#: Parameter of learners that tells trainings of one row apart.
TRAINING_SEED = "training_seed"

OFFICIAL_TITLES = {"shrec14-synthetic": "SHREC'14 synthetic", "shrec14-real": "SHREC'14 real", "tosca": "TOSCA"}

#: What the network of the paper is called where "our" would be somebody else.
_NETWORK = "Reconstruction network"

#: Digits of the numbers of notes.
_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")

#: Marks rows that this code would not make again without running.
OUTDATED = "†"

#: Marks rows with results at the same distance at the first rank of a query.
TIED = "‡"


@dataclass(frozen=True)
class Row:
    """One method: its figures in the paper and ours by input, with inputs that it has other jobs of.

    ``departs`` says how it departs from its source.
    """

    method: str
    title: str
    family: str
    paper: Figures | None
    cells: Mapping[Input, Cell]
    elsewhere: tuple[Input, ...] = ()
    departs: str = ""

    @property
    def models(self) -> list[Mapping[str, Any]]:
        """Trained models behind the row; empty for a method that does not learn."""
        return [model for cell in self.cells.values() for model in cell.models]

    @property
    def label(self) -> str:
        """Title as printed, with training data beyond the paper's, number of models, marks of ties and old records."""
        extra = "extra training data"
        told = [extra] if any(model["extra_data"] for model in self.models) and extra not in self.title else []
        if self.models and any(cell.n_wanted > 1 for cell in self.cells.values()):
            told.append(f"{len(self.models)} model{'' if len(self.models) == 1 else 's'}")
        told += [
            f"{input_}: coverage {number(cell.coverage)}" for input_, cell in self.cells.items() if cell.is_partial
        ]
        told += [EXTERNAL] if self.family == EXTERNAL else []
        marks = [TIED] if any(cell.n_tied for cell in self.cells.values()) else []
        marks += [OUTDATED] if any(cell.outdated for cell in self.cells.values()) else []
        return " ".join([brief(self.title), *([f"({', '.join(told)})"] if told else []), *marks])


@dataclass(frozen=True)
class TableContent:
    """One table on one data set.

    Parameters
    ----------
    table
        What the paper's table, or one's own, shows.
    data
        Name, title and size of the data, as the records tell.
    inputs
        The inputs that are shown.
    rows
        The paper's methods in the paper's order, then all others.
    chance
        Expected scores of a random ranking; the mean over the galleries where there are several.
    n_galleries
        Galleries that a row is the mean over.
    scorer, scorer_title
        Name of what compared the forms, and its title; "" for the default scorer.
    seed
        Base seed of the runs.
    """

    table: Table
    data: Mapping[str, Any]
    inputs: tuple[Input, ...]
    rows: tuple[Row, ...]
    chance: Figures
    n_galleries: int
    scorer: str = ""
    scorer_title: str = ""
    seed: int = 0

    @cached_property
    def significance(self) -> SignificanceTable:
        """Return how sure each of our figures is, and which rows differ from the best."""
        return table_significance(self.rows, self.inputs)

    @cached_property
    def departures(self) -> Mapping[str, str]:
        """How rows with scores depart from their sources, by the raised number of the note that says so."""
        rows = (row for row in self.rows if row.departs and any(cell.scores for cell in row.cells.values()))
        texts = dict.fromkeys(row.departs for row in rows)
        return {str(number).translate(_RAISED): text for number, text in enumerate(texts, 1)}

    def label(self, row: Row) -> str:
        """Return the label of a row with the number of the note on its departures."""
        mark = next((f" {number}" for number, text in self.departures.items() if text == row.departs), "")
        return row.label + mark

    @property
    def identifier(self) -> str:
        """The paper's numeral, or the name of the data set."""
        return self.table.identifier

    @property
    def is_own(self) -> bool:
        """Return whether it shows somebody's own data, which no table of this suite is about."""
        return _is_own(self.identifier, self.data["name"])

    @property
    def caption(self) -> str:
        """Return what the table shows, without naming the data."""
        words = [self.table.caption_over(self.n_galleries)]
        words += [f"seed {self.seed}"] if self.seed else []
        words += [f"scored by {self.scorer_title}"] if self.scorer_title else []
        return ", ".join(words)

    @property
    def quick(self) -> bool:
        """Return whether poses were left out to save time."""
        return bool(self.data["quick"])

    @property
    def file_stem(self) -> str:
        """Name of the files of this table."""
        return file_stem(self.identifier, self.data["name"], quick=self.quick, scorer=self.scorer, seed=self.seed)

    @property
    def has_paper(self) -> bool:
        """Return whether the paper has this table."""
        return any(row.paper for row in self.rows)

    @property
    def data_title(self) -> str:
        """The data in words, never without saying that it is a stand-in."""
        if official := self.data["stand_in_for"]:
            return f"generated stand-in '{self.data['name']}', not {OFFICIAL_TITLES.get(official, official)}"
        return str(self.data["title"])

    @property
    def size(self) -> str:
        """Number of shapes and classes in words."""
        each = f"{self.data['n_shapes']} shapes, {self.data['n_classes']} classes"
        return f"{self.n_galleries} x {each}" if self.n_galleries > 1 else each

    def of(self, input_: Input, *, paper_only: bool = False) -> TableContent:
        """The same for one input: the rows of the paper, and if wanted those others that were run under it."""
        rows = [row for row in self.rows if row.paper or (not paper_only and _is_run(row, input_))]
        alone = [
            replace(
                row,
                cells={name: cell for name, cell in row.cells.items() if name == input_},
                elsewhere=tuple(other for other in self.inputs if other != input_ and _is_run(row, other)),
            )
            for row in rows
        ]
        return replace(self, inputs=(input_,), rows=tuple(alone))


#: Characters of a file name, which has room for 255 bytes.
_LONGEST_NAME = 60


def _is_run(row: Row, input_: Input) -> bool:
    return input_ in row.cells and row.cells[input_].status != "missing"


def file_stem(table: str, dataset: str, *, quick: bool, scorer: str = "", seed: int = 0) -> str:
    """Name of the files of a table on a data set: letters, digits, dots, hyphens and underscores.

    A name that had to be changed gets a digest, so that two tables never share a file.
    """
    parts = (dataset if dataset != table else "", "quick" if quick else "", scorer, f"seed-{seed}" if seed else "")
    return stem("table", table, *parts)


def stem(*parts: str) -> str:
    """Name of a file from parts, empty ones left out; see :func:`file_stem`."""
    whole = "-".join(filter(None, parts))
    name = re.sub(r"[^\w.-]", "-", whole)[:_LONGEST_NAME]
    return name if name == whole else f"{name}-{digest(whole)[:8]}"


def contents(
    results: Iterable[Result], tables: Iterable[str] = (), *, blanks: bool = True, named: bool = False
) -> list[TableContent]:
    """Fill tables with results.

    Parameters
    ----------
    results
        The records to show.
    tables
        Identifiers of the tables to make, with those that go with them; empty for all that the results belong to.
    blanks
        Whether the paper's methods have rows where there is no result of them.
    named
        Whether the methods were asked for by name, so that those that the paper has in its ablation alone, and further
        seeds of a training, have rows in other tables, too.
    """
    chosen = set(tables)
    wanted = chosen | {table.identifier for table in TABLES if table.part_of in chosen}
    grouped: dict[tuple[str, str, bool], list[Result]] = {}
    for result in results:
        data = result.record["data"]
        for table in tables_of(result.record["gallery"], data["name"], quick=bool(data["quick"])):
            if table in wanted or not (wanted or parsed(data["name"])):  # the table of robustness sums these up
                place = (table, _shown_as(table, data["name"]), bool(data["quick"]))
                grouped.setdefault(place, []).append(result)
    order = {table.identifier: number for number, table in enumerate(TABLES)}
    places = sorted(grouped, key=lambda place: (order.get(place[0], len(order)), place[0], _is_stand_in(place), place))
    made = (_content(_table(*place[:2]), grouped[place], blanks=blanks, named=named) for place in places)
    return [table for table in made if table.rows]


def _table(identifier: str, dataset: str) -> Table:
    """The paper's table of a data set; for all other sets one of its own, even for a folder that is called "I"."""
    known = (t for t in TABLES if t.identifier == identifier and dataset in t.datasets)
    return next(known, None) or own_table(dataset)


def _shown_as(identifier: str, dataset: str) -> str:
    """Name of the data of a table: that of all of its sets where rows are means over them, else the set's own."""
    tables = (t for t in TABLES if t.identifier == identifier and t.mean_over_sets and dataset in t.datasets)
    return next((table.dataset for table in tables), dataset)


def _is_own(identifier: str, dataset: str) -> bool:
    return not any(table.identifier == identifier and dataset in table.datasets for table in TABLES)


def own_table(dataset: str) -> Table:
    """Table of a set that no table of the paper uses."""
    name = Path(dataset).name
    return Table(name, f"Retrieval on {name}", dataset, all_unseen=False)


def _is_stand_in(place: tuple[str, str, bool]) -> bool:
    return any(table.identifier == place[0] and table.stand_in == place[1] for table in TABLES)


def _content(table: Table, results: Sequence[Result], *, blanks: bool, named: bool) -> TableContent:
    is_own = _is_own(table.identifier, results[0].record["data"]["name"])
    galleries = sorted({result.record["gallery"] for result in results})
    by_row: dict[str, dict[Input, list[Result]]] = {}
    for result in results:
        if _belongs(table, result, everything=named or is_own):
            row = row_of(table, result.record)
            by_row.setdefault(row, {}).setdefault(cast(Input, result.record["input"]), []).append(result)
    inputs = tuple(i for i in INPUTS if any(i in cells for cells in by_row.values()))
    printed = paper.rows(table.identifier) if table in TABLES else {}
    quick = bool(results[0].record["data"]["quick"])
    n_folds = len(galleries) if table.mean_over_sets else 1 if quick else max(1, len(table.folds))
    cells: dict[str, dict[Input, Cell]] = {
        name: {i: cell_of(found, n_folds) for i, found in by_input.items()} for name, by_input in by_row.items()
    }
    blank: dict[Input, Cell] = {input_: Cell() for input_ in inputs}
    rows = [
        Row(
            name,
            row.title,
            "paper",
            row.values[table.identifier],
            blank | cells.get(name, {}),
            departs=departs_of(name),
        )
        for name, row in printed.items()
        if blanks or name in cells
    ]
    rows += [_further_row(name, by_row[name], cells[name], is_own) for name in _others(by_row, printed)]
    one_each = {result.record["gallery"]: result.record for result in results}
    scored_each = {result.record["gallery"]: result.record for result in results if result.record.get("scores")}
    chance = [
        chance_of(scored_each[name]) if name in scored_each else one_each[name]["data"]["chance"] for name in galleries
    ]
    data = one_each[galleries[0]]["data"]
    scored = next((r.record for r in results if "scorer_title" in r.record), None)
    return TableContent(
        table,
        {**data, "name": _shown_as(table.identifier, data["name"])},
        inputs,
        tuple(rows) if by_row else (),
        {name: statistics.fmean(levels[name] for levels in chance) for name in min(chance, key=len)},
        len(galleries),
        scored["scorer"] if scored is not None else "",
        brief(scored["scorer_title"]) if scored is not None else "",
        int(results[0].record["recipe"].get("seed", 0)),
    )


def _belongs(table: Table, result: Result, *, everything: bool) -> bool:
    """Return whether a record is shown in a table: those of learners alone in an ablation.

    What belongs to an ablation alone, as the seeds of a training do, is shown elsewhere only where everything is.
    """
    record = result.record
    base = record["method"].partition("[")[0]
    if table.ablation:
        return base in {row.method for row in paper.ABLATION}
    return everything or (TRAINING_SEED not in record["parameters"] and base not in ONLY_ABLATED)


def row_of(table: Table, record: Mapping[str, Any]) -> str:
    """Row that a record belongs to: in some tables, trainings of a learner share it."""
    name = str(record["method"])
    return without(name, table.rows.averaged) if table.rows.averaged else name


def without(method: str, parameter: str) -> str:
    """Return the name that a method has without one of its parameters."""
    base, _, rest = method.partition("[")
    kept = [part for part in rest.removesuffix("]").split(",") if part and not part.startswith(f"{parameter}=")]
    return f"{base}[{','.join(kept)}]" if kept else base


def _further_row(
    name: str, by_input: Mapping[Input, Sequence[Result]], cells: Mapping[Input, Cell], is_own: bool
) -> Row:
    records = [result.record for results in by_input.values() for result in results]
    titled = next((r for r in records if r["method"] == name), records[0])
    title = str(titled["title"])
    if is_own and name.partition("[")[0] in BUILT_IN:
        title = re.sub(r"^Our\b", _NETWORK, title)
    return Row(name, title, str(titled["family"]), None, cells, departs=departs_of(name))


def departs_of(method: str) -> str:
    """Return how a method of the suite departs from its source; what a plugin says of itself is in no record."""
    base = method.partition("[")[0]
    return MethodSpec(base, BUILT_IN[base]).info.departs if base in BUILT_IN else ""


def _others(by_row: Mapping[str, Mapping[Input, Sequence[Result]]], printed: Iterable[str]) -> list[str]:
    """Methods without a row in the paper: variants and further forms in the order of the methods, controls last."""
    order = {name: place for place, name in enumerate(BUILT_IN)}

    def place(name: str) -> tuple[bool, int, str]:
        record = next(iter(by_row[name].values()))[0].record
        return record["family"] == "control", order.get(name.partition("[")[0], len(order)), name

    return sorted((name for name in by_row if name not in set(printed)), key=place)
