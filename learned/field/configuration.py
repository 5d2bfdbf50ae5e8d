"""Named configurations of the deformation field: the plain one and its variants."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

from benchmark.api.contracts import Interval
from benchmark.errors import ConfigurationError
from learned.described import configuration_named, described_by


@dataclass(frozen=True, kw_only=True)
class Field:
    """Architecture and loss weights of a field.

    Parameters
    ----------
    name
        Name on the command line.
    points
        Surface points that the encoder sees.
    tokens
        Neighbourhoods into which the points are grouped.
    neighbours
        Points per neighbourhood.
    width
        Features per token; a multiple of ``heads``.
    heads
        Heads per attention layer.
    encoder_layers
        Self-attention layers of the tokens.
    decoder_layers
        Attention layers from positions to tokens.
    frequencies
        Octaves of the positional encoding [Mildenhall et al. 2020, equation 4].
    edge
        Weight of the error of the predicted rotations, on edges and normals.
    isometry
        Weight of the change in edge length.
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
        """Return all fields, for a card."""
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
    """Return the configuration of this name, or raise ``ConfigurationError`` with the closest names."""
    return configuration_named(name, FIELDS)


def from_card(described: object) -> Field:
    """Return the configuration that a card describes.

    Raises
    ------
    ConfigurationError
        If the card describes another kind of network, or sizes that do not fit together.
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
