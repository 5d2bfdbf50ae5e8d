"""``submit``: a bundle of results that others can verify."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from benchmark.cli import completion
from benchmark.cli.options import (
    PathOption,
    RunOptions,
    add_options,
    name_skipped,
    told_what_it_is,
)
from benchmark.text import say


@click.command()
@click.argument("method", metavar="METHOD", shell_complete=completion.methods)
@click.option("-o", "--output", "path", required=True, type=PathOption(), metavar="BUNDLE.zip", help="File to write.")
@add_options("datasets", "inputs", "scorer", "plugins", "results", "data_root")
@click.option("--seed", type=int, default=0, show_default=True, help="Base seed of the runs.")
@click.option("--quick", is_flag=True, help="Take the results of --quick.")
@click.option("--author", default="", metavar="NAME", help="Author of the row.")
@click.option("--licence", default="", metavar="NAME", help="Licence, such as MIT. [the source's SPDX line]")
@click.option("--forms", "with_forms", is_flag=True, help="Include the forms of your own data.")
def submit(method: str, path: Path, author: str, licence: str, with_forms: bool, **given: Any) -> None:
    """Write the finished jobs of a method into a bundle that anyone can verify."""
    from benchmark.bundles.writing import Offer, write_bundle
    from benchmark.pipeline.storage.store import Store
    from benchmark.plugins.registry import methods, variant
    from benchmark.report.artefact_reader import ArtefactReader

    options = RunOptions.of(given)
    known = methods(options.plugins)
    with told_what_it_is(method, "method"):
        spec = variant(method, known)
    options = RunOptions.of(given | {"methods": (spec.name,)})
    store = Store.open(options.results)
    records = [result.record for result in options.recorded(store)]
    name_skipped(store)
    artefacts = ArtefactReader(store, known, options.data_root)
    offer = Offer(author, licence, with_forms)
    written = write_bundle(path, records, spec, artefacts, offer, lambda line: say(line, err=True))
    for line in written.left_out:
        say(f"omitted {line}", err=True)
    for name, holds, withheld in written.entries:
        say(f"{name}: {holds}{f' and distances alone; {withheld}' if withheld else ''}")
    if any(withheld and "nobody has said" in withheld for *_, withheld in written.entries):
        say("pass --forms if results of your own data may be shared", err=True)
    if not written.licence:
        say("without a licence nobody else may use the source; pass --licence", err=True)
    say(f"{path}: {written.size / 2**20:.1f} MiB; 'verify {path}' says what it proves")
