"""A trained model, from its files to predictions."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from benchmark.api.learning import card_digest, read_card
from learned.paired.card import network_of
from learned.paired.network import build
from learned.weights import with_weights


def load_model(folder: Path) -> tuple[nn.Module, dict[str, Any]]:
    """Network with the weights in a folder, ready to predict, and its card.

    Raises
    ------
    ConfigurationError
        If the weights are not those that the card describes, or belong to another configuration.
    """
    return _load(folder, card_digest(read_card(folder)))


@functools.lru_cache(maxsize=16)
def _load(folder: Path, _digest: str) -> tuple[nn.Module, dict[str, Any]]:
    card = read_card(folder)
    configuration = network_of(card, folder).configuration
    return with_weights(build(configuration), folder, configuration.name), card


@torch.inference_mode()
def predict(network: nn.Module, image: Tensor) -> Tensor:
    """Depth and mask, shape (2, r, r), from one depth image, shape (1, r, r)."""
    prediction: Tensor = network(image[None].contiguous(memory_format=torch.channels_last))[0]
    return prediction
