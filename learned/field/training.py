"""The field learns where the points of fresh bodies lie in the canonical pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from benchmark.api.contracts import Interval
from benchmark.api.streaming import MakesSurfaces
from learned.field.batches import MakesSurfaceBatches, SurfaceBatch
from learned.field.configuration import Field
from learned.field.losses import NAMES, losses, weighted
from learned.field.network import FieldNetwork, Unbent, build_field
from learned.training.loop import Objective, Plan, Trained, TrainingLoop, TrainingRun, fresh_bodies

LOOKED_AT = 16
"""Validation bodies that are looked at."""


@dataclass(frozen=True, kw_only=True)
class FieldPlan(Plan):
    """Plan of the training of a field; see :class:`learned.training.loop.Plan`."""

    steps: Annotated[int, Interval(1)] = 12_000
    bodies: Annotated[int, Interval(2)] = 8
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 5e-4


def train_field(
    configuration: Field,
    plan: Plan,
    make: MakesSurfaces,
    validation: MakesSurfaces | None,
    run: TrainingRun,
) -> Trained[FieldNetwork]:
    """Train a field, going on from a checkpoint; see :class:`learned.training.loop.TrainingLoop`.

    Parameters
    ----------
    configuration, plan
        What is trained, and how.
    make
        Makes the bodies.
    validation
        Makes bodies for the curves; None for no curves.
    run
        Where; its seed is that of the weights.

    Raises
    ------
    TrainingError
        If a body cannot be made, a loss is not a number, or the checkpoint does not fit. The checkpoint then stands at
        the last step that was done.
    """
    network = build_field(configuration, run.seed).to(run.device)
    looked = MakesSurfaceBatches(validation, configuration, LOOKED_AT, perturbed=False)(0) if validation else None
    objective = _Objective(network, configuration, run.device, looked)
    batches = MakesSurfaceBatches(make, configuration, plan.bodies)
    progress, precision = TrainingLoop(network, objective, batches, plan, run).train()
    return Trained(network, progress, precision, fresh_bodies(plan, progress))


@dataclass
class _Objective(Objective[SurfaceBatch]):
    network: FieldNetwork
    configuration: Field
    device: torch.device
    looked: SurfaceBatch | None
    terms = NAMES
    watched = "position error"

    def losses(self, batch: SurfaceBatch, half: bool) -> Tensor:
        return self._terms(self._found(batch, half), batch)

    def total(self, losses: Tensor, batch: SurfaceBatch) -> Tensor:
        return weighted(losses, self.configuration)

    def measured(self, half: bool) -> Mapping[str, float]:
        """Mean distance to the true position as a share of the body's height, and the terms of the loss."""
        if self.looked is None:
            return {}
        found = self._found(self.looked, half)
        distances = (found.positions.cpu() - self.looked.targets).norm(dim=-1).mean(dim=1)
        terms = self._terms(found, self.looked).tolist()
        error = float((distances / self.looked.heights).mean())
        return {"position error": error, **dict(zip(self.terms[1:], terms[1:], strict=True))}

    def _found(self, batch: SurfaceBatch, half: bool) -> Unbent:
        seen = (batch.points, batch.normals, batch.positions, batch.position_normals)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=half):
            found: Unbent = self.network(*(each.to(self.device) for each in seen))
        return found

    def _terms(self, found: Unbent, batch: SurfaceBatch) -> Tensor:
        told = (batch.positions, batch.targets, batch.position_normals, batch.target_normals)
        return losses(found, *(each.to(self.device) for each in told))
