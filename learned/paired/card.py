"""Check of the card of a model before its network is built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

from benchmark.errors import ConfigurationError
from learned.paired.configuration import Configuration, from_card

LARGEST = 4096
"""Largest resolution in pixels per side, width in channels and code size of a network."""

HINT = "train the model again"

_KINDS: Mapping[str, type | tuple[type, ...]] = {
    "digest": str, "configuration": dict, "parameters": int, "data": str, "data_title": str, "data_digest": str,
    "pairs": int, "subjects": list, "identifiers": list, "extra_data": bool, "seed": int, "schedule": dict,
    "departures_from_the_paper": list, "schedule_in_words": str, "hardware": str, "precision": str,
    "weights_stored_as": str, "torch": str, "seconds": (int, float), "images_per_second": (int, float),
    "final_losses": dict, "final": dict, "recipe": dict, "finished": str,
}  # fmt: skip


@dataclass(frozen=True)
class Network:
    """Network that is built from a card.

    Parameters
    ----------
    configuration
        The network.
    resolution
        Pixels per side of its images.
    """

    configuration: Configuration
    resolution: int


def network_of(card: Mapping[str, Any], folder: Path) -> Network:
    """Return the network of a card, after checking every field that :func:`learned.paired.fitting.fit` writes.

    A missing or unknown field is an error, because the meaning of a card of another version is unknown.

    Parameters
    ----------
    card
        The card, as returned by :func:`benchmark.api.learning.read_card`.
    folder
        Folder of the model, for messages.

    Raises
    ------
    ConfigurationError
        If the card is not that of such a model; the message names the field.
    """
    # The card of an older model lacks the clearance.
    if odd := sorted((card.keys() - {"clearance"}) ^ _KINDS.keys()):
        verb = "lacks" if odd[0] in _KINDS else "has an unknown field"
        raise ConfigurationError(f"the card in {folder} {verb} '{odd[0]}'", HINT)
    for name, kind in _KINDS.items():
        if not isinstance(card[name], kind) or (isinstance(card[name], bool) and kind is not bool):
            raise _wrong(name, card[name], folder)
    resolution = card["schedule"].get("resolution")
    if type(resolution) is not int or not 1 <= resolution <= LARGEST:
        raise _wrong("schedule.resolution", resolution, folder)
    for name in ("parameters", "pairs"):
        if card[name] < 1:
            raise _wrong(name, card[name], folder)
    return Network(_configuration(card["configuration"], folder), resolution)


def _configuration(described: Mapping[str, Any], folder: Path) -> Configuration:
    configuration = from_card(described)
    for name, hint in get_type_hints(Configuration).items():
        if name not in described:  # the schedule has an entry of its own; other fields have their usual value
            continue
        value = described[name]
        choices = get_args(hint)
        fits = value in choices if choices else type(value) is hint
        if not fits or (type(value) is int and not 1 <= value <= LARGEST):
            raise _wrong(f"configuration.{name}", value, folder)
    return configuration


def _wrong(name: str, value: object, folder: Path) -> ConfigurationError:
    return ConfigurationError(f"the card in {folder} says '{name}' is {str(value)[:50]!r}, which no model has", HINT)
