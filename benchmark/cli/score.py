"""``score`` and ``run --forms``: results of other programs."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from benchmark.api.contracts import Input
from benchmark.cli.options import Selection
from benchmark.datasets.catalogue import sources
from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.protocols.galleries import galleries
from benchmark.registry import select_one
from benchmark.scoring.evaluation import Evaluation, evaluate_labelled, with_labels
from benchmark.scoring.rows import keep_distances, score_forms
from benchmark.text import say, say_lines

Format = Literal["text", "latex", "csv", "json"]


def score(
    distances: Path, labels: Path, format: Format, title: str, results: Path | None, dataset: str, input_: Input
) -> None:
    """Print the measures of a distance matrix, and store them as an external row if a folder is given."""
    labelled = with_labels(distances, labels)
    say_lines(_written(title, evaluate_labelled(labelled), format))
    if results is not None:
        record = keep_distances(results, labelled, title, dataset, input_)
        chosen = shlex.join(["-d", record.data.name, "--results", str(results)])
        say(f"kept as {record.method}: 'tables {chosen}' and 'report {chosen}' show it", err=True)


def _written(title: str, evaluation: Evaluation, format: Format) -> str:
    scores = evaluation.scores.rename_axis(title)
    if format == "csv":
        return str(scores.to_csv(float_format="%.6f", lineterminator="\n"))
    if format == "json":
        content = {"title": title, "n_shapes": len(evaluation.queries), **scores.round(6).T.to_dict()}
        return json.dumps(content, indent=1) + "\n"
    if format == "latex":
        return str(scores.style.format(precision=2, escape="latex").to_latex(hrules=True))
    return str(scores.to_string(float_format="{:.2f}".format)) + "\n"


def score_other_forms(selection: Selection, forms: Sequence[str]) -> list[Record]:
    """Score folders of forms, each given as ``NAME=DIR``, as rows of the selected data sets."""
    pairs = [form.split("=", 1) for form in forms if form.partition("=")[0] and "=" in form]
    if len(pairs) < len(forms) or not selection.datasets or selection.methods:
        hint = "pass -d FOLDER --forms NAME=DIR, without -m"
        raise ConfigurationError("--forms scores the meshes of a folder as forms of a data set", hint)
    names = sources(selection.datasets, selection.plugins)
    scorer = select_one(selection.scorer, selection.plugins, "scorer")
    records = []
    for gallery in galleries((), names, selection.data_root, selection.quick):
        for input_ in gallery.inputs if not selection.input else (selection.input,):
            for title, folder in pairs:
                record = score_forms(gallery, input_, title, Path(folder), scorer, selection.results)
                say(f"{record.place}: NN {record.scores['NN']:.2f}", err=True)
                records.append(record)
    return records
