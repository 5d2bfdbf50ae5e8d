"""Named configurations of the deformation field: each differs from the plain one in one respect."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

from benchmark.api.contracts import Interval
from benchmark.errors import ConfigurationError
from learned.described import configuration_named, described_by


@dataclass(frozen=True, kw_only=True)
class Field:
    """One field, and what it is trained for.

    Parameters
    ----------
    name
        Name on the command line.
    points
        Points of the surface that the encoder sees.
    tokens
        Neighbourhoods that they are gathered in.
    neighbours
        Points of each neighbourhood.
    width
        Features of a token; a multiple of ``heads``.
    heads
        Heads of an attention.
    encoder_layers
        Attentions among tokens.
    decoder_layers
        Attentions of a position to tokens.
    frequencies
        Octaves in which a position is written [Mildenhall et al. 2020, equation 4].
    edge
        Weight of the error of the predicted rotations, on edges and normals.
    isometry
        Weight of the change of the lengths of edges.
    """

    name: str
    points: Annotated[int, Interval(16, 8192)] = 1024
    tokens: Annotated[int, Interval(8, 1024)] = 128
    neighbours: Annotated[int, Interval(4, 256)] = 32
    width: Annotated[int, Interval(16, 1024)] = 192
    heads: Annotated[int, Interval(1, 16)] = 6
    encoder_layers: Annotated[int, Interval(1, 24)] = 6
    decoder_layers: Annotated[int, Interval(1, 12)] = 2
    frequencies: Annotated[int, Interval(1, 10)] = 5
    edge: Annotated[float, Interval(0)] = 0.1
    isometry: Annotated[float, Interval(0)] = 0.1

    def described(self) -> dict[str, Any]:
        """All fields, for a card."""
        return asdict(self)


PLAIN = Field(name="plain")

FIELDS: dict[str, Field] = {
    preset.name: preset
    for preset in (
        PLAIN,
        replace(PLAIN, name="free", isometry=0.0),
        replace(PLAIN, name="small", width=96, heads=4, encoder_layers=4),
    )
}
"""All configurations by name."""


def field_named(name: str) -> Field:
    """Configuration of this name, or a ``ConfigurationError`` that names the nearest ones."""
    return configuration_named(name, FIELDS)


def from_card(described: object) -> Field:
    """Configuration that a card describes.

    Raises
    ------
    ConfigurationError
        If it is not one.
    """
    configuration = described_by(described, PLAIN)
    check_sizes(configuration)
    return configuration


def check_sizes(configuration: Field) -> None:
    """Raise ``ConfigurationError`` if the sizes of a field do not fit together."""
    if configuration.width % configuration.heads:
        raise ConfigurationError(
            f"field '{configuration.name}' has width {configuration.width} for {configuration.heads} heads",
            "take a multiple",
        )
    if max(configuration.tokens, configuration.neighbours) > configuration.points:
        raise ConfigurationError(
            f"field '{configuration.name}' has only {configuration.points} points",
            "take as many as it has tokens, and as a token has neighbours",
        )
