"""Named configurations of networks, and how a card tells the one of its model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from benchmark.api.parameters import checked
from benchmark.errors import ConfigurationError, did_you_mean


class Named(Protocol):
    """A frozen dataclass whose fields, but for the name, declare what they take."""

    @property
    def name(self) -> str:
        """Name on the command line."""
        ...


C = TypeVar("C", bound=Named)


def configuration_named(name: str, known: Mapping[str, C]) -> C:
    """Configuration of this name, or a ``ConfigurationError`` that names the nearest ones."""
    if name not in known:
        raise did_you_mean("configuration", name, known)
    return known[name]


def described_in(card: Mapping[str, Any], kind: str, folder: Path, title: str) -> Mapping[str, Any]:
    """Return what the card of the model in ``folder`` tells of its configuration.

    Parameters
    ----------
    card
        The card.
    kind
        What it calls the configurations of this kind of network.
    folder
        Folder of the model.
    title
        This kind of network in words.

    Raises
    ------
    ConfigurationError
        If it is the card of another kind of model.
    """
    described = card.get(kind)
    if not isinstance(described, dict):
        raise ConfigurationError(f"the card in {folder} is not that of {title}", "train the model again")
    return described


def without_settled(described: Mapping[str, Any], settled: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a card describes without the fields that have one value now, where it has that value."""
    return {name: value for name, value in described.items() if name not in settled or settled[name] != value}


def described_by(described: object, plain: C) -> C:
    """Configuration that a card describes.

    Parameters
    ----------
    described
        All fields by name, as the card has them.
    plain
        Some configuration of the same kind.

    Raises
    ------
    ConfigurationError
        If it is not one.
    """
    kind: Any = type(plain)
    known = {entry.name for entry in fields(kind)}
    if not isinstance(described, Mapping) or set(described) != known or not isinstance(described["name"], str):
        raise ConfigurationError("the card describes another kind of network", "train the model again")
    values = {name: value for name, value in described.items() if name != "name"}
    configuration: C = replace(plain, name=described["name"], **checked(kind, values, "the network"))  # type: ignore[type-var]
    return configuration
