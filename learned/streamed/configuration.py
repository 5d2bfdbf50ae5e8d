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
    """One network, and what it is trained for.

    Parameters
    ----------
    name
        Name on the command line.
    resolution
        Pixels per side of what it sees and predicts; a multiple of 32.
    width
        Channels of the outermost block.
    code_size
        Numbers that a body is reduced to.
    decoder
        ``"plain"``: a transposed convolution in each block. ``"residual"``: enlarging by interpolation, then two
        convolutions around which the block's input is led. ``"shuffle"``: as plain, but for the last two doublings 16
        channels are rearranged into 16 pixels.
    sides
        1: depth of the front of the canonical pose. 2: of its back as well, and the form is a closed surface.
    crop
        Whether the network sees the foreground alone, centred and scaled, so that the frame is of no account.
    one_code
        Weight of the distance between the codes of two poses of one body, relative to that between bodies.
    gradient
        Weight of the error of the depth's differences between neighbouring pixels.
    norm
        ``"group"``: each sample in eight groups of channels. ``"sample"``: all channels of a sample at once, of which
        the derivative costs a tenth. ``"none"``: standardised weights instead.
    encoder
        ``"plain"``: five strided convolutions. ``"residual"``: with a residual block after the second and the third.
    attention
        Layers of self-attention over the last features but one, which see the whole image.
    average
        Whether what the decoder predicts is added to images of the average body, which are learned too.
    one_form
        Weight of the variance of the forms that are predicted for one body, relative to that of all forms.
    places
        Weight of the error of the canonical positions of what the image shows, predicted from the last features but
        one; no form needs them, they make the encoder tell which part of the body is where.
    points
        Weight of the error of the places of points of the body in the canonical pose, a linear function of the code; no
        form needs them, they make the code tell what a body is.
    stream
        Bodies it is trained on: ``"varied"``, or ``"wide"`` with harder poses and several views of each.
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
        """Predicted images: a depth for each side, and the mask."""
        return self.sides + 1

    def described(self) -> dict[str, Any]:
        """All fields, for a card."""
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
"""All configurations by name. The weights are those that make each term as large as the others early in a training."""


def streamed(name: str) -> Streamed:
    """Configuration of this name, or a ``ConfigurationError`` that names the nearest ones."""
    return configuration_named(name, STREAMED)


def from_card(described: object) -> Streamed:
    """Configuration that a card describes; an older card lacks some fields, which then have their default.

    Raises
    ------
    ConfigurationError
        If it is not one.
    """
    # Only an older card of a streamed network lacks fields: their defaults are those that were fixed before.
    whole = {**PLAIN.described(), **described} if isinstance(described, Mapping) and "name" in described else described
    configuration = described_by(whole, PLAIN)
    check_resolution(configuration)
    return configuration


def check_resolution(configuration: Streamed) -> None:
    """Raise ``ConfigurationError`` if the network cannot have its resolution."""
    if configuration.resolution % 32:
        raise ConfigurationError(
            f"network '{configuration.name}' has no resolution {configuration.resolution}", "take a multiple of 32"
        )
