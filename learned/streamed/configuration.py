"""Named configurations of the streamed networks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any, Literal

from benchmark.api.contracts import Interval
from benchmark.errors import ConfigurationError
from learned.described import configuration_named, described_by


@dataclass(frozen=True, kw_only=True)
class Streamed:
    """Architecture, loss weights and stream of a network.

    Parameters
    ----------
    name
        Name on the command line.
    resolution
        Pixels per side of input and prediction; a multiple of 32.
    width
        Channels of the outermost block.
    code_size
        Length of the code of a body.
    decoder
        ``"plain"``: a transposed convolution in each block. ``"residual"``: upsampling by interpolation, then two
        convolutions with a skip connection. ``"shuffle"``: as plain, but the last two doublings rearrange 16 channels
        into 16 pixels.
    sides
        1: depth of the front of the canonical pose. 2: also of its back, and the form is a closed surface.
    crop
        Whether the network sees only the foreground, centred and scaled, so that the frame does not matter.
    one_code
        Weight of the distance between codes of two poses of a body, relative to that between bodies.
    gradient
        Weight of the error of depth differences between neighbouring pixels.
    norm
        ``"group"``: group normalisation with eight groups of channels. ``"sample"``: with one group of all channels,
        whose gradient costs a tenth. ``"none"``: standardised weights instead.
    encoder
        ``"plain"``: five strided convolutions. ``"residual"``: with a residual block after the second and the third.
    attention
        Self-attention layers over the penultimate features, which see the whole image.
    average
        Whether the output of the decoder is added to learned images of the average body.
    one_form
        Weight of the variance of the predicted forms of a body, relative to that of all forms.
    places
        Weight of the error of the canonical positions of visible points, predicted from the penultimate features. Forms
        do not use them; they make the encoder locate the parts of the body.
    points
        Weight of the error of the canonical positions of points of the body, a linear function of the code. Forms do
        not use them; they make the code describe the body.
    stream
        Training bodies: ``"varied"``, or ``"wide"`` with harder poses and several views of each.
    """

    name: str
    resolution: Annotated[int, Interval(32, 512)] = 128
    width: Annotated[int, Interval(8, 64)] = 16
    code_size: Annotated[int, Interval(8, 4096)] = 256
    decoder: Literal["plain", "residual", "shuffle"] = "plain"
    sides: Annotated[int, Interval(1, 2)] = 1
    crop: bool = True
    one_code: Annotated[float, Interval(0)] = 0.0
    gradient: Annotated[float, Interval(0)] = 0.0
    norm: Literal["group", "sample", "none"] = "group"
    encoder: Literal["plain", "residual"] = "plain"
    attention: Annotated[int, Interval(0, 8)] = 0
    average: bool = False
    one_form: Annotated[float, Interval(0)] = 0.0
    places: Annotated[float, Interval(0)] = 0.0
    points: Annotated[float, Interval(0)] = 0.0
    stream: Literal["varied", "wide"] = "varied"

    @property
    def channels(self) -> int:
        """Number of predicted images: one depth per side, and the mask."""
        return self.sides + 1

    def described(self) -> dict[str, Any]:
        """Return all fields, for a card."""
        return asdict(self)


PLAIN = Streamed(name="plain")

STREAMED: dict[str, Streamed] = {
    "people": replace(
        PLAIN,
        name="people",
        sides=2,
        norm="none",
        encoder="residual",
        decoder="shuffle",
        average=True,
        places=1.0,
        points=0.1,
        stream="wide",
    ),
}
"""All configurations by name. Their weights make all loss terms about equally large early in a training."""


def streamed(name: str) -> Streamed:
    """Return the configuration of this name, or raise ``ConfigurationError`` with the closest names."""
    return configuration_named(name, STREAMED)


def from_card(described: object) -> Streamed:
    """Return the configuration that a card describes; fields that an older card lacks get their defaults.

    Raises
    ------
    ConfigurationError
        If the card describes another kind of network, or a resolution that does not fit.
    """
    # Only an older card of a streamed network lacks fields, whose defaults are the values that were fixed before.
    whole = {**PLAIN.described(), **described} if isinstance(described, Mapping) and "name" in described else described
    configuration = described_by(whole, PLAIN)
    check_resolution(configuration)
    return configuration


def check_resolution(configuration: Streamed) -> None:
    """Raise ``ConfigurationError`` if the resolution is not a multiple of 32."""
    if configuration.resolution % 32:
        raise ConfigurationError(
            f"network '{configuration.name}' has no resolution {configuration.resolution}", "take a multiple of 32"
        )
