"""Weights of a network: stored in half precision, and loaded for prediction."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import nn

from benchmark.api.learning import checked_weights
from benchmark.errors import ConfigurationError

Network = TypeVar("Network", bound=nn.Module)


def as_stored(network: nn.Module) -> None:
    """Round the weights to half precision, which halves the file, so that tests use the weights on disk."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(parameter.half().float())


def stored(network: nn.Module) -> bytes:
    """Return the content of the weights file."""
    halves = {name: tensor.detach().cpu().half().contiguous() for name, tensor in network.state_dict().items()}
    content: bytes = save(halves)
    return content


def with_weights(network: Network, folder: Path, name: str) -> Network:
    """Load the weights in a folder into a network, in double precision.

    In single precision, the last bits of sums depend on the processor and would decide pixels of a mask.

    Parameters
    ----------
    network
        Network of the configuration, modified in place.
    folder
        Folder of the model.
    name
        Name of its configuration, for messages.

    Returns
    -------
    Network
        The same network, channels last, in evaluation mode.

    Raises
    ------
    ConfigurationError
        If the weights do not match the card, or belong to another configuration.
    """
    try:
        tensors = {key: tensor.double() for key, tensor in load(checked_weights(folder)).items()}
    except (KeyError, TypeError, SafetensorError) as error:
        raise ConfigurationError(f"the model in {folder} is damaged: {error}", "train it again") from error
    if {key: tensor.shape for key, tensor in tensors.items()} != {
        key: tensor.shape for key, tensor in network.state_dict().items()
    }:
        raise ConfigurationError(
            f"the weights in {folder} belong to another configuration than '{name}'", "train the model again"
        )
    network.to(dtype=torch.float64, memory_format=torch.channels_last)
    network.load_state_dict(tensors)
    network.eval()
    return network


def n_parameters(network: nn.Module) -> int:
    """Return the number of trainable parameters."""
    return sum(parameter.numel() for parameter in network.parameters())
