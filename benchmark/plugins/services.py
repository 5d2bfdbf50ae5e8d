"""Processes of plugins that do the work of this process: one for each plugin and kind, which share no knowledge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from benchmark.execution.processes.process import Process, Serve

#: Kind and plugin, and the name of one that leaves threads or processes behind.
Place = tuple[str, ...]

#: Processes that have been started.
services: dict[Place, Process] = {}

_starting: Callable[[bool], object] = bool


def watch_starts(starting: Callable[[bool], object]) -> None:
    """Have a function called with True before a process starts and imports its plugin, and with False after that."""
    global _starting
    _starting = starting


def service(place: Place, serve: Serve, first: Mapping[str, Any]) -> Process:
    """Return the process of a plugin; one that starts is asked something, which takes no time of a job.

    Parameters
    ----------
    place
        Its place among the others.
    serve
        What it answers requests with.
    first
        A request for which it imports the plugin.
    """
    if place not in services:
        _starting(True)
        try:
            services[place] = Process(serve, is_plugin=True)
            services[place].request_or_end_alike(first)
        finally:
            _starting(False)
    return services[place]
