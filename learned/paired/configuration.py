"""Named configurations of the network, with all choices that the paper leaves open and all departures from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, Literal

from benchmark.errors import ConfigurationError, did_you_mean
from learned.described import without_settled


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """Architecture and training of a network.

    Parameters
    ----------
    name
        Name on the command line.
    architecture
        ``"progressive"``: short-range features, long-range features, encoder-decoder, as in the paper.
        ``"global-code"``: an encoder to one vector and a decoder from it.
    short_range, long_range
        Whether the network has SRF and LRF.
    width
        Channels of SRF and LRF; the encoder-decoder has 2, 4, 8 and 16 times as many. The paper names no widths.
    code_size
        Length of the vector of ``"global-code"``.
    extra_data
        Whether the network is trained on more data than the paper's.
    crop
        Whether images and targets are cropped to the body, so that its size is unknown.
    schedule
        Fields of :class:`learned.paired.schedule.Schedule` that differ from the paper's schedule.
    """

    name: str
    architecture: Literal["progressive", "global-code"] = "progressive"
    short_range: bool = True
    long_range: bool = True
    width: int = 16
    code_size: int = 256
    extra_data: bool = False
    crop: bool = False
    schedule: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def described(self) -> dict[str, Any]:
        """Return all fields that shape the network, for a card."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: value for name, value in values.items() if name != "schedule"}


LITERAL = Configuration(name="literal")

SETTLED = MappingProxyType({"dilated_deconvolutions": True, "convolutions_per_block": 1, "global_context": False})
"""Fields of cards of version 0.2 that are fixed now, in addition to ``group_norm``, which follows the architecture."""

CONFIGURATIONS: dict[str, Configuration] = {
    configuration.name: configuration
    for configuration in (
        LITERAL,
        replace(LITERAL, name="as_printed"),
        replace(LITERAL, name="without_srf", short_range=False),
        replace(LITERAL, name="without_lrf", long_range=False),
        replace(LITERAL, name="without_weighting", schedule=MappingProxyType({"early_epochs": 0})),
        replace(LITERAL, name="size_free", crop=True),
        Configuration(
            name="wide-extra",
            architecture="global-code",
            extra_data=True,
            schedule=MappingProxyType(
                {
                    "resolution": 128,
                    "epochs": 10,
                    "early_epochs": 0,
                    "batch": 32,
                    "depth_loss": "masked",
                    "cosine": True,
                }
            ),
        ),
    )
}


def configuration(name: str) -> Configuration:
    """Return the configuration of this name, or raise ``ConfigurationError`` with the closest names."""
    if name not in CONFIGURATIONS:
        raise did_you_mean("configuration", name, CONFIGURATIONS)
    return CONFIGURATIONS[name]


def from_card(described: Mapping[str, Any]) -> Configuration:
    """Return the configuration that a card describes.

    Raises
    ------
    ConfigurationError
        If the card lacks a field, or has one that no network has.
    """
    known = {entry.name for entry in fields(Configuration)} - {"schedule"}
    settled = {**SETTLED, "group_norm": described.get("architecture") == "global-code"}
    described = {"crop": False} | without_settled(described, settled)  # missing on cards of version 0.2
    if set(described) != known:
        raise ConfigurationError(
            f"the card describes another kind of network: {', '.join(sorted(set(described) ^ known))}",
            "train the model again",
        )
    return Configuration(**described)


__all__ = ["CONFIGURATIONS", "LITERAL", "Configuration", "configuration", "from_card"]
