"""Joint training of the template, the deformations and the codes of the shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from benchmark.api.contracts import Interval
from learned.template.configuration import Template
from learned.template.losses import NAMES, losses, weighted
from learned.template.network import AutoDecoder, TemplateNetwork, build_auto_decoder
from learned.template.samples import DrawsPoints, PointBatch, Shapes
from learned.template.search import Found, descended
from learned.training.loop import Objective, Plan, Trained, TrainingLoop, TrainingRun
from learned.training.machine import Precision

LOOKED_AT = 4
"""Validation shapes that are looked at: poses of bodies that are not trained on."""

LOOK_RAYS, LOOK_STEPS = 256, 60
"""Points around each of them, and steps to find its code."""


@dataclass(frozen=True, kw_only=True)
class TemplatePlan(Plan):
    """Plan of the training of a template; see :class:`learned.training.loop.Plan`. ``bodies``: shapes of a step.

    Parameters
    ----------
    code_rate
        Step size of the codes as a multiple of that of the weights. A code learns only in the steps that its shape is
        in; at the rate of the weights it stays where it began, and all shapes become one average.
    """

    steps: Annotated[int, Interval(1)] = 14_000
    bodies: Annotated[int, Interval(2)] = 8
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 1e-4
    code_rate: Annotated[float, Interval(0, closed="neither")] = 100.0
    precision: Precision = "float32"


def train_template(
    configuration: Template,
    plan: TemplatePlan,
    shapes: Shapes,
    validation: Shapes | None,
    run: TrainingRun,
) -> Trained[TemplateNetwork]:
    """Train a template, going on from a checkpoint; see :class:`learned.training.loop.TrainingLoop`.

    Parameters
    ----------
    configuration, plan
        What is trained, and how.
    shapes
        What it is trained on; each has a code.
    validation
        Shapes for the curves; None for no curves.
    run
        Where; its seed is that of the weights, of the first codes and of the points that are drawn.

    Raises
    ------
    TrainingError
        If a loss is not a number, or the checkpoint does not fit.
    """
    network = build_auto_decoder(configuration, len(shapes), run.seed).to(run.device)
    objective = _Objective(network, configuration, run.device, validation)
    draws = DrawsPoints(shapes, plan.bodies, configuration.rays, run.seed)
    rates = {"codes": plan.code_rate}
    progress, precision = TrainingLoop(network, objective, draws, plan, run, rates).train()
    seen = {"bodies": configuration.bodies, "shapes": len(shapes)}
    return Trained(network.fields, progress, precision, seen)


@dataclass
class _Objective(Objective[PointBatch]):
    network: AutoDecoder
    configuration: Template
    device: torch.device
    validation: Shapes | None
    terms = NAMES
    watched = "distance error"

    def losses(self, batch: PointBatch, half: bool) -> Tensor:
        codes = self.network.codes(batch.shapes.to(self.device))
        points, directions, distances = (
            values.to(self.device) for values in (batch.points, batch.directions, batch.distances)
        )
        return losses(self.network.fields, codes, points, directions, distances)

    def total(self, losses: Tensor, batch: PointBatch) -> Tensor:
        return weighted(losses, self.configuration)

    def measured(self, half: bool) -> Mapping[str, float]:
        if self.validation is None:
            return {}
        chosen = DrawsPoints(self.validation, min(LOOKED_AT, len(self.validation)), LOOK_RAYS, 0)(0)
        points, distances = chosen.points.to(self.device), chosen.distances.to(self.device)
        codes = points.new_zeros(len(points), self.configuration.code_size)
        standing = torch.eye(3, device=self.device).expand(len(points), 3, 3)
        start = Found(codes, standing, codes.new_zeros(len(codes)))
        around = points, distances
        found = descended(self.network.fields, around, start, self.configuration.code, LOOK_STEPS, turning=False)
        return {self.watched: float(found.errors.mean())}
