"""What is tried, by section."""

from __future__ import annotations

import random
from collections.abc import Callable

from tools.faults.cases import Case
from tools.faults.sections import arguments, damage, disks, folders, kills, plugins, readers

#: Cases of each section, given the number of kills to try at least.
SECTIONS: dict[str, Callable[[int], list[Case]]] = {
    "kills": kills.cases,
    "plugins": lambda _: plugins.cases(),
    "folders": lambda _: folders.cases(),
    "disks": lambda _: disks.cases(),
    "damage": lambda _: damage.cases(),
    "arguments": lambda _: arguments.cases(),
    "readers": lambda _: readers.cases(),
}


def all_cases(n_kills: int, seed: int = 0, *, shuffled: bool = False) -> list[Case]:
    """All cases, section after section; or one of each section, then all mixed evenly, so that any part has of each.

    Parameters
    ----------
    n_kills
        Kills to try at least.
    seed
        Determines the order.
    shuffled
        Whether to mix them.
    """
    found = {name: make(n_kills) for name, make in SECTIONS.items()}
    if not shuffled:
        return [case for cases in found.values() for case in cases]
    placed = []
    for cases in found.values():
        random.Random(seed).shuffle(cases)
        placed += [((place + 0.5) / len(cases) * bool(place), case.name, case) for place, case in enumerate(cases)]
    return [case for _, _, case in sorted(placed, key=lambda item: item[:2])]
