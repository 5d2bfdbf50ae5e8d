"""``score``: distances of other programs."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Literal

from benchmark.api.contracts import Input
from benchmark.scoring.evaluation import Evaluation, evaluate_labelled, with_labels
from benchmark.scoring.rows import keep_distances
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
