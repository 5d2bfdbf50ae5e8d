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
    found: dict[tuple[str, str], list[Sequence[float]]] = {}
    labels: dict[tuple[str, str], str] = {}
    for record in records:
        columns = [record["per_query"][measure] for measure in wanted]
        for shape, label, *values in zip(record["shapes"], record["labels"], *columns, strict=True):
            if None not in values:
                name = (record["gallery"], shape)
                found.setdefault(name, []).append(values)
                labels[name] = label
    means = [each[0] if len(each) == 1 else np.mean(each, axis=0) for each in found.values()]
    table = np.rint(np.array(means).reshape(len(means), len(wanted)) / UNIT)
    return Queries(tuple(found), tuple(labels.values()), dict(zip(wanted, table.T, strict=True)))
