"""Finished jobs that a study reads."""

from __future__ import annotations

import click

from benchmark.results import ResultsFolder


def newest(folder: ResultsFolder, gallery: str, method: str, input_: str) -> str:
    """Key of the newest record with scores of a job by CM-BOF; an error on the command line if there is none."""
    records = folder.records()
    chosen = records[
        (records["gallery"] == gallery) & (records["method"] == method) & (records["input"] == input_)
        & (records["scorer"] == "cm-bof") & (records["status"] == "ok")
    ]  # fmt: skip
    if chosen.empty:
        raise click.ClickException(
            f"no scores of {method} on {gallery}, {input_}; run 'python -m benchmark run' with its table first"
        )
    return str(chosen.sort_values("finished").index[-1])
