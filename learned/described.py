"""Named configurations of networks, and how to read them from model cards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from benchmark.api.parameters import checked
from benchmark.errors import ConfigurationError, did_you_mean


class Named(Protocol):
    """A frozen dataclass whose fields, except for the name, declare the values that they accept."""

    @property
    def name(self) -> str:
        """Name on the command line."""
        ...


C = TypeVar("C", bound=Named)


def configuration_named(name: str, known: Mapping[str, C]) -> C:
    """Return the configuration of this name, or raise ``ConfigurationError`` with the closest names."""
    if name not in known:
        raise did_you_mean("configuration", name, known)
    return known[name]


def described_in(card: Mapping[str, Any], kind: str, folder: Path, title: str) -> Mapping[str, Any]:
    """Return the configuration on the card of the model in ``folder``.

    Parameters
    ----------
    card
        The card.
    kind
        Key of the configuration on the cards of this kind of network.
    folder
        Folder of the model.
    title
        This kind of network in words, for messages.

    Raises
    ------
    ConfigurationError
        If the card belongs to another kind of model.
    """
    described = card.get(kind)
    if not isinstance(described, dict):
        raise ConfigurationError(f"the card in {folder} is not that of {title}", "train the model again")
    return described


def without_settled(described: Mapping[str, Any], settled: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a card without those that have a single value now, unless theirs differs."""
    return {name: value for name, value in described.items() if name not in settled or settled[name] != value}


def described_by(described: object, plain: C) -> C:
    """Return the configuration that a card describes.

    Parameters
    ----------
    described
        All fields of the configuration on the card, by name.
    plain
        Any configuration of the same kind.

    Raises
    ------
    ConfigurationError
        If the card describes another kind of network.
    """
    kind: Any = type(plain)
    known = {entry.name for entry in fields(kind)}
    if not isinstance(described, Mapping) or set(described) != known or not isinstance(described["name"], str):
        raise ConfigurationError("the card describes another kind of network", "train the model again")
    values = {name: value for name, value in described.items() if name != "name"}
    configuration: C = replace(plain, name=described["name"], **checked(kind, values, "the network"))  # type: ignore[type-var]
    return configuration
