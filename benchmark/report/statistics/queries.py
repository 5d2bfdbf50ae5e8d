"""Measures of each query behind a figure of a table, as whole numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Records keep six decimals. Sums of whole numbers are the same in any order, so on every machine.
UNIT = 1e-6


@dataclass(frozen=True, eq=False)
class Queries:
    """Measures of a method for each query.

    Parameters
    ----------
    names
        Gallery and shape of each query.
    labels
        Class of each query.
    values
        By measure, shape (N,): values of the queries in units of 1e-6, whole numbers in double precision.
    """

    names: tuple[tuple[str, str], ...]
    labels: tuple[str, ...]
    values: Mapping[str, NDArray[np.float64]]

    def among(self, names: Iterable[tuple[str, str]]) -> Queries:
        """Those of some names, in the order of the names; raises ``KeyError`` for a name that is not there."""
        place = {name: k for k, name in enumerate(self.names)}
        chosen = [place[name] for name in names]
        return Queries(
            tuple(self.names[k] for k in chosen),
            tuple(self.labels[k] for k in chosen),
            {measure: values[chosen] for measure, values in self.values.items()},
        )


def queries_of(records: Sequence[Mapping[str, Any]], measures: Iterable[str]) -> Queries:
    """Collect the queries of some records: those of several galleries, the mean over several trainings on one.

    A query without a relevant shape counts in no mean and is left out.

    Parameters
    ----------
    records
        Records with scores, of one method under one input.
    measures
        Names of measures.
    """
    wanted = tuple(measures)
    labels: dict[tuple[str, str], str] = {}
    found: list[NDArray[np.float64]] = []
    names: list[tuple[str, str]] = []
    for record in records:
        columns = [record["per_query"][measure] for measure in wanted]
        table = np.array(columns, dtype=np.float64).reshape(len(wanted), len(record["shapes"])).T
        rows = np.flatnonzero(np.isfinite(table).all(axis=1)).tolist()
        here = [(record["gallery"], record["shapes"][k]) for k in rows]
        labels |= zip(here, (record["labels"][k] for k in rows), strict=True)
        found.append(table[rows])
        names += here
    place = {name: k for k, name in enumerate(labels)}
    places = [place[name] for name in names]
    means = np.zeros((len(place), len(wanted)))
    np.add.at(means, places, np.concatenate(found))
    means /= np.bincount(places, minlength=len(place))[:, None]
    return Queries(tuple(labels), tuple(labels.values()), dict(zip(wanted, np.rint(means / UNIT).T, strict=True)))
