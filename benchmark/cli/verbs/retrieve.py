"""``retrieve``: the shapes of a gallery that are nearest to a new one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from benchmark.cli import completion
from benchmark.cli.options import (
    NameOrFolder,
    PathOption,
    RunOptions,
    add_options,
    timeout_option,
    told_what_it_is,
)
from benchmark.text import clean, say


@click.command()
@click.option(
    "-m", "--method", "method", required=True, metavar="METHOD", help="Method; see 'list methods'.",
    shell_complete=completion.methods,
)  # fmt: skip
@click.option(
    "-d", "--dataset", "gallery", required=True, type=NameOrFolder(), metavar="DATASET|FOLDER",
    shell_complete=completion.datasets, help="Data set or folder that was run.",
)  # fmt: skip
@click.argument("query", type=PathOption(), metavar="QUERY")
@click.option("-k", type=click.IntRange(min=1), default=5, show_default=True, help="Number of shapes to show.")
@click.option("--picture", type=PathOption(), metavar="OUT.png", help="Draw the forms that were found.")
@click.option("--intrinsics", default="", metavar="FILE|fx,fy,cx,cy", help="Camera of a depth image.")
@click.option("--mask", type=PathOption(), metavar="FILE", help="Object in a depth image. [found automatically]")
@click.option("--depth-scale", type=float, metavar="N", help="Depth units per metre.")
@add_options("scorer", "plugins", "results", "data_root")
@timeout_option("the search")
@click.option("--seed", type=int, default=0, show_default=True)
def retrieve(
    method: str,
    gallery: str,
    query: Path,
    k: int,
    picture: Path | None,
    intrinsics: str,
    mask: Path | None,
    depth_scale: float | None,
    timeout: float,
    **given: Any,
) -> None:
    """Show the shapes of a gallery that are nearest to a depth image or a mesh."""
    from benchmark.cli.depth_forms import FrameOptions
    from benchmark.cli.retrieval import retrieved
    from benchmark.datasets.catalogue import sources
    from benchmark.execution.processes.calls import Guard, call_apart

    with told_what_it_is(gallery, "data set"):
        datasets = tuple(sources([gallery], given["plugins"]))
    options = RunOptions.of(given | {"methods": (method,), "datasets": datasets})
    frame = FrameOptions(intrinsics, str(mask or ""), depth_scale)
    guard = Guard(f"method '{method}' on {query}", "try another shape, or correct the method", timeout)
    lines: list[str] = call_apart(retrieved, query, k, picture, frame, options, guard=guard)
    for line in lines:
        say(clean(line))
