"""The template, a signed distance field, and the deformations into it, each known by a code."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn

from learned.template.configuration import Template

_FIRST_CODES = 0.1
"""Spread of the codes before training; .01 in DIF-Net, whose codes weigh more."""


class SineField(nn.Module):
    """A perceptron with sines [Sitzmann et al. 2020, SIREN], with the derivatives by its input beside its values.

    What goes through it is a *jet*, shape (..., 1 + t, width): the value and, in the other rows, its derivatives by t
    variables, carried forwards by the chain rule. That costs as much as t further points and spares the second backward
    pass that a loss of derivatives would take. t is 0 where none are wanted.

    Parameters
    ----------
    width, layers
        Hidden units, and hidden layers.
    outputs
        Numbers at each point.
    frequency
        Factor inside of the sines.
    """

    def __init__(self, width: int, layers: int, outputs: int, frequency: float) -> None:
        super().__init__()
        self.frequency = frequency
        sizes = [3] + [width] * layers
        self.hidden = nn.ModuleList(nn.Linear(before, after) for before, after in itertools.pairwise(sizes))
        self.last = nn.Linear(width, outputs)
        for number, layer in enumerate(self.hidden):
            # SIREN, section 3.2: the arguments of all sines are then spread alike.
            bound = math.sqrt(6 / width) / frequency if number else 1 / 3
            nn.init.uniform_(layer.weight, -bound, bound)
        bound = math.sqrt(6 / width) / frequency
        nn.init.uniform_(self.last.weight, -bound, bound)

    def forward(self, jet: Tensor, gains: Tensor | None = None, shifts: Tensor | None = None) -> Tensor:
        """Jet of the outputs, shape (..., 1 + t, outputs).

        Parameters
        ----------
        jet
            Positions and their derivatives, shape (n, p, 1 + t, 3).
        gains, shifts
            What the arguments of the sines of each shape are multiplied by, and what is added, shape (n, layers,
            width); None for none.
        """
        for number, layer in enumerate(self.hidden):
            jet = self.frequency * _affine(jet, layer)
            if gains is not None and shifts is not None:
                jet = jet * gains[:, None, number, None]
                jet = torch.cat([jet[..., :1, :] + shifts[:, None, number, None], jet[..., 1:, :]], dim=-2)
            value = jet[..., :1, :]
            jet = torch.cat([torch.sin(value), torch.cos(value) * jet[..., 1:, :]], dim=-2)
        return _affine(jet, self.last)


class TemplateNetwork(nn.Module):
    """Template field, and the deformation and correction that a code stands for.

    In DIF-Net the distance of a shape at p is T(p + D(p)) + C(p), with T shared by all shapes. There the code chooses
    all weights of D and C by a hyper-network of 10^7 weights. Here it chooses gain and shift of each sine [Chan et al.
    2021, pi-GAN], which takes a hundredth of them and serves a CPU. D and C are zero before training.

    Parameters
    ----------
    configuration
        Sizes.
    """

    def __init__(self, configuration: Template) -> None:
        super().__init__()
        width, layers = configuration.width, configuration.deformation_layers
        self.code_size = configuration.code_size
        self.template = SineField(width, configuration.template_layers, 1, configuration.template_frequency)
        self.deformation = SineField(width, layers, 4, configuration.deformation_frequency)
        nn.init.zeros_(self.deformation.last.weight)
        nn.init.zeros_(self.deformation.last.bias)
        self.mapping = nn.Sequential(
            nn.Linear(configuration.code_size, width), nn.LeakyReLU(0.2), nn.Linear(width, 2 * layers * width)
        )
        self._layers, self._width = layers, width

    def deformed(self, points: Tensor, codes: Tensor, *, derivatives: bool = False) -> tuple[Tensor, Tensor]:
        """Return where points lie in the space of the template, and the correction of the distance there.

        Parameters
        ----------
        points
            Shape (n, p, 3).
        codes
            Shape (n, code_size).
        derivatives
            Whether to carry the derivatives by the three coordinates of the points.

        Returns
        -------
        torch.Tensor
            Jet of the positions, shape (n, p, 1 + t, 3), with t = 3 or 0.
        torch.Tensor
            Jet of the correction, shape (n, p, 1 + t, 1).
        """
        gains, shifts = self.mapping(codes).view(-1, 2, self._layers, self._width).unbind(1)
        jet = _jet(points, derivatives)
        moved = self.deformation(jet, 1 + gains, shifts)
        return jet + moved[..., :3], moved[..., 3:]

    def distances(self, points: Tensor, codes: Tensor) -> Tensor:
        """Signed distances of the shapes of some codes, shape (n, p), at points of shape (n, p, 3)."""
        places, correction = self.deformed(points, codes)
        return (self.template(places) + correction)[..., 0, 0]

    def template_distances(self, points: Tensor, *, derivatives: bool = False) -> Tensor:
        """Jet of the template at positions of shape (n, p, 3): shape (n, p, 1 + t, 1), with t = 3 or 0."""
        jet: Tensor = self.template(_jet(points, derivatives))
        return jet


class AutoDecoder(nn.Module):
    """The fields, and the code of each shape that they are trained on.

    Parameters
    ----------
    configuration
        Sizes.
    n_shapes
        Number of codes.
    """

    def __init__(self, configuration: Template, n_shapes: int) -> None:
        super().__init__()
        self.fields = TemplateNetwork(configuration)
        self.codes = nn.Embedding(n_shapes, configuration.code_size)
        nn.init.normal_(self.codes.weight, std=_FIRST_CODES)


def build_auto_decoder(configuration: Template, n_shapes: int, seed: int) -> AutoDecoder:
    """An untrained network whose weights depend on the seed alone."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return AutoDecoder(configuration, n_shapes)


def _jet(points: Tensor, derivatives: bool) -> Tensor:
    """Positions as a jet, with the unit vectors as derivatives if any are wanted."""
    value = points[..., None, :]
    if not derivatives:
        return value
    axes = torch.eye(3, dtype=points.dtype, device=points.device).expand(*points.shape[:-1], 3, 3)
    return torch.cat([value, axes], dim=-2)


def _affine(jet: Tensor, layer: nn.Linear) -> Tensor:
    """The layer on the value, its linear part on the derivatives."""
    product = nn.functional.linear(jet, layer.weight)
    return torch.cat([product[..., :1, :] + layer.bias, product[..., 1:, :]], dim=-2)
