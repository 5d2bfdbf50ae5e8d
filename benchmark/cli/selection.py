"""Records and tables selected by command-line options."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from benchmark.cli.options import Selection, name_skipped
from benchmark.cli.plan import scorer_spec
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.datasets.changes import last_change
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.pipeline.storage.records import EXTERNAL, Record
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, select
from benchmark.plugins.scorers import scorers
from benchmark.protocols.tables import TABLES
from benchmark.report.content import TableContent, contents
from benchmark.report.results import Result, Results


def stored(options: Selection, output: Path | None = None) -> Store:
    """Open the results folder for reading.

    Parameters
    ----------
    options
        Options of the command.
    output
        Output folder. For ``RESULTS/tables``, which holds the published tables of the suite, only published records are
        read, if there are any.
    """
    store = Store.open(options.results)
    is_of_suite = output is not None and output.resolve() == (options.results / "tables").resolve()
    return replace(store, published_only=options.published or (is_of_suite and store.published.has_files))


def results_of(options: Selection, store: Store) -> Results:
    """Return the records of a store, compared with the known methods and scorers."""
    return Results(store, methods(options.plugins), options.data_root, scorers(options.plugins))


def is_of_data(record: Record, options: Selection) -> bool:
    """Return whether a record belongs to the selected data sets (names or paths) and inputs."""
    datasets = {*options.datasets, *map(os.path.realpath, options.datasets)}
    is_of_set = not datasets or bool(datasets & _names(record["data"]))
    return is_of_set and (not options.input or record["input"] == options.input)


def recorded(options: Selection, store: Store) -> list[Result]:
    """Return the selected records, whether or not their data and models exist here.

    Parameters
    ----------
    options
        The selection.
    store
        Store of the records.

    Raises
    ------
    ConfigurationError
        If there is no record, or a method, data set or table is unknown.
    """
    results = results_of(options, store).all(options.seed, scorer=scorer_spec(options).name)
    names: set[str] = set()
    if options.is_narrow:
        names = {result.record["method"] for result in results if result.record["family"] == EXTERNAL}
        names &= set(options.methods)
        others = [name for name in options.methods if name not in names]
        names |= {spec.name for spec in select(others, methods(options.plugins))} if others else set()
    name_skipped(store)
    _check_names(options, results)
    chosen = [
        result
        for result in results
        if bool(result.record["data"]["quick"]) == options.quick
        and (not names or result.record["method"] in names)
        and is_of_data(result.record, options)
    ]
    if not chosen:
        hint = "run it first, select less, or drop --quick" if options.quick else "run it first, or select less"
        raise ConfigurationError(f"no finished job under {options.results} fits the selection", hint)
    return chosen


def recorded_tables(options: Selection, store: Store) -> list[TableContent]:
    """Return the tables of the selected records; raise ``ConfigurationError`` if there is none."""
    tables = tables_of(options, recorded(options, store))
    if not tables:
        raise no_table(options)
    return tables


def tables_of(options: Selection, results: list[Result]) -> list[TableContent]:
    """Return the tables of results, with the selected methods only."""
    return contents(results, options.tables, blanks=not options.is_narrow, named=options.is_narrow)


def no_table(options: Selection) -> ConfigurationError:
    """Return the error for a selection without a finished job of a table."""
    what = f"table {', '.join(options.tables)}" if options.tables else "any table"
    return ConfigurationError(
        f"no finished job under {options.results} belongs to {what}", "run it first, or select less"
    )


def _check_names(options: Selection, results: list[Result]) -> None:
    """Raise ``ConfigurationError`` for a data set or table known neither to the suite nor to a record."""
    recorded_sets = {result.record["data"]["name"] for result in results}
    places = set().union(*(_names(result.record["data"]) for result in results))
    for name in options.datasets:
        if results and not {name, os.path.realpath(name)} & places and not (is_known(name) or is_path(name)):
            raise did_you_mean("data set", name, {known for known in recorded_sets if not last_change(known)})
    tables = {table.identifier for table in TABLES} | recorded_sets
    for name in options.tables:
        if name not in tables:
            raise did_you_mean("table", name, {known for known in tables if not last_change(known)})


def _names(data: Mapping[str, str]) -> set[str]:
    """Return what a data set may be called; under a perturbation, also what the clean set may be."""
    names = {data["name"], data["source"]}
    names |= {parts[0] for name in names if (parts := last_change(name))}
    return names | set(map(os.path.realpath, names))
