"""The code of a new shape, and how it stands, by descent with the fields fixed [Park et al. 2019, DeepSDF, eq. 10]."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learned.template.distances import Rays
from learned.template.losses import FARTHEST
from learned.template.network import TemplateNetwork

CODE_STEP, TURN_STEP = 5e-2, 2e-2
"""Largest step sizes of Adam for a number of the code and for a component of the rotation, in radians."""

_GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Round:
    """A round of the search, from which the best candidates go on to the next one.

    Parameters
    ----------
    candidates
        How many ways of standing are tried.
    rays
        Points around the shape.
    steps
        Steps of Adam.
    """

    candidates: int
    rays: int
    steps: int


ROUNDS = (Round(24, 96, 30), Round(3, 384, 50), Round(1, 1024, 100))
"""All quarter turns of the principal axes shortly, then what is left at length."""


@dataclass(frozen=True, eq=False)
class Found:
    """Codes, and how the shapes stand.

    Parameters
    ----------
    codes
        Shape (n, code_size).
    turns
        Rotations into the frame of the template, shape (n, 3, 3).
    errors
        Mean absolute error of the signed distance, shape (n,).
    """

    codes: Tensor
    turns: Tensor
    errors: Tensor


def search(network: TemplateNetwork, rays: Rays, code_weight: float, rounds: tuple[Round, ...]) -> Found:
    """Code and standing of one shape whose frame is known up to quarter turns; the answer has n = 1.

    Nothing is drawn at random: the points are the first of the rays, and the code begins at zero.

    Parameters
    ----------
    network
        The fields; they are not changed. Its precision is that of the search: with float64 the answer does not hang on
        the last bits of the coordinates.
    rays
        As many as the rounds ask for, or fewer.
    code_weight
        Weight of the mean square of a code, relative to the error of the distance.
    rounds
        How long to search.
    """
    kind = next(network.parameters()).dtype
    turns = torch.from_numpy(quarter_turns()).to(kind)
    found = Found(turns.new_zeros(len(turns), network.code_size), turns, turns.new_zeros(len(turns)))
    for each in rounds:
        best = torch.argsort(found.errors, stable=True)[: each.candidates]
        points, distances = (values.to(kind).expand(len(best), *values.shape) for values in points_on(rays, each.rays))
        start = Found(found.codes[best], found.turns[best], found.errors[best])
        found = descended(network, (points, distances), start, code_weight, each.steps)
    best = torch.argsort(found.errors, stable=True)[:1]
    return Found(found.codes[best], found.turns[best], found.errors[best])


def quarter_turns() -> NDArray[np.float64]:
    """The 24 rotations that bring a cube onto itself, shape (24, 3, 3)."""
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return np.stack(found)


def points_on(rays: Rays, count: int) -> tuple[Tensor, Tensor]:
    """Positions on the first rays, shape (count, 3), and their signed distances, shape (count,).

    Every other one is on the surface; the others crowd near it.
    """
    count = min(count, len(rays.lengths))
    share = np.where(np.arange(count) % 2, (np.arange(count) * _GOLDEN % 1) ** 2, 0)
    lengths = (rays.lengths[:count] * share).astype(np.float32)
    positions = rays.feet[:count] + lengths[:, None] * rays.directions[:count]
    return torch.from_numpy(positions), torch.from_numpy(lengths)


def descended(
    network: TemplateNetwork,
    around: tuple[Tensor, Tensor],
    start: Found,
    code_weight: float,
    steps: int,
    *,
    turning: bool = True,
) -> Found:
    """Codes and rotations after some steps of Adam, whose size falls to zero along half a cosine.

    Parameters
    ----------
    network
        The fields; they are not changed.
    around
        Positions around each shape, shape (n, p, 3), and the signed distances there, shape (n, p).
    start
        Where to begin.
    code_weight
        Weight of the mean square of a code.
    steps
        How many steps.
    turning
        Whether the rotations change.
    """
    points, distances = around
    wanted = distances.clamp(-FARTHEST, FARTHEST)
    codes, turns = start.codes.detach().clone().requires_grad_(), start.turns
    angles = codes.new_zeros(len(codes), 3, requires_grad=True)
    groups = [{"params": [codes], "lr": CODE_STEP}, {"params": [angles], "lr": TURN_STEP}]
    optimiser = torch.optim.Adam(groups[: 1 + turning])
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, lambda step: 0.5 * (1 + math.cos(math.pi * step / steps)))
    changed = [codes, angles][: 1 + turning]
    with torch.enable_grad():
        for _ in range(steps):
            errors = _errors(network, points, wanted, codes, _turned(angles, turns))
            # A sum, so that no shape's step depends on the others.
            total = (errors + code_weight * codes.square().mean(dim=1)).sum()
            for value, slope in zip(changed, torch.autograd.grad(total, changed), strict=True):
                value.grad = slope
            optimiser.step()
            schedule.step()
    with torch.no_grad():
        standing = _turned(angles, turns)
        return Found(codes.detach(), standing, _errors(network, points, wanted, codes, standing))


def _errors(network: TemplateNetwork, points: Tensor, wanted: Tensor, codes: Tensor, turns: Tensor) -> Tensor:
    found = network.distances(points @ turns.transpose(1, 2), codes)
    return (found.clamp(-FARTHEST, FARTHEST) - wanted).abs().mean(dim=1)


def _turned(angles: Tensor, turns: Tensor) -> Tensor:
    """Rotations after further ones by rotation vectors, shapes (n, 3) and (n, 3, 3)."""
    zero = torch.zeros_like(angles[:, 0])
    x, y, z = angles.unbind(dim=1)
    crossed = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).view(-1, 3, 3)
    return torch.matrix_exp(crossed) @ turns
