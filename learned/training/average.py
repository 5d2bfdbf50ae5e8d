"""Weights averaged over the steps of a training, which are steadier than the newest ones."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn


class Average:
    """Exponential moving average of the weights of a network.

    Parameters
    ----------
    network
        As it begins.
    """

    def __init__(self, network: nn.Module) -> None:
        self._network = network
        self.weights: dict[str, Tensor] = {
            name: parameter.detach().clone() for name, parameter in network.named_parameters()
        }

    def add(self, kept: float, step: int) -> None:
        """Take in the weights after a step.

        Parameters
        ----------
        kept
            Share of the average that is kept; less in the first steps, so that the beginning is forgotten soon.
        step
            Which step, counted from 0.
        """
        share = 1 - min(kept, (1 + step) / (10 + step))
        newest = [parameter.detach() for parameter in self._network.parameters()]
        torch._foreach_lerp_(list(self.weights.values()), newest, share)

    def swap(self) -> None:
        """Exchange the weights of the network and the average."""
        with torch.no_grad():
            for name, parameter in self._network.named_parameters():
                newest = parameter.clone()
                parameter.copy_(self.weights[name])
                self.weights[name].copy_(newest)

    @contextmanager
    def used(self) -> Iterator[None]:
        """Let the network have the averaged weights for a while."""
        self.swap()
        try:
            yield
        finally:
            self.swap()
