"""``new``: plugin files to start from."""

from __future__ import annotations

import click

from benchmark.text import say


@click.group()
def new() -> None:
    """Write a plugin to start from, with a test."""


def _add_new(kind: str, what: str) -> None:
    """Add the command that writes a plugin of one kind."""

    @new.command(kind, help=f"Write a working plugin file with {what} called NAME, and its test, into this folder.")
    @click.argument("name")
    def write(name: str) -> None:
        from benchmark.plugins.scaffold import new_plugin

        paths = new_plugin(kind, name)
        for path in paths:
            say(path)
        build = f"'g++ -O2 -o {paths[0].stem} {paths[2]}' and " if kind == "external" else ""
        say(f"next: edit it, then {build}'python -m benchmark check {paths[0]}'", err=True)


for _kind, _what in {
    "method": "a method that makes canonical forms",
    "external": "a method that calls a program with mesh files",
    "descriptor": "a descriptor that compares shapes without a form",
    "learner": "a method that is trained",
    "scorer": "a scorer that compares forms",
    "dataset": "a data set",
}.items():
    _add_new(_kind, _what)
