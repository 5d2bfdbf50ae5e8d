"""Train the field to predict canonical positions of points of new bodies or scans."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, cast

import torch
from torch import Tensor

from benchmark.api.contracts import Interval
from benchmark.api.learning import read_card
from benchmark.api.streaming import MakesScans, MakesSurfaces
from benchmark.errors import ConfigurationError
from learned.field.batches import MakesSurfaceBatches, SurfaceBatch
from learned.field.configuration import Field
from learned.field.methods import DeformationField
from learned.field.model import load_field
from learned.field.network import FieldNetwork, Unbent, build_field
from learned.field.scans import MakesScanBatches, bodies_made
from learned.training.loop import Objective, Plan, Trained, TrainingLoop, TrainingRun, fresh_bodies

NAMES = ("position loss", "edge loss", "isometry loss")
"""Columns of the history."""

_LEAST = 1e-8
"""Added to squared distances, lest their root have no gradient at zero."""


def losses(unbent: Unbent, positions: Tensor, targets: Tensor, normals: Tensor, target_normals: Tensor) -> Tensor:
    """All terms, unweighted.

    Parameters
    ----------
    unbent
        What the field says of the positions.
    positions, targets
        In the pose and in the canonical pose, shape (n, 2 p, 3): the first p are the starts of p edges along the
        surface, the others their ends.
    normals, target_normals
        Unit normals there, shape (n, 2 p, 3).

    Returns
    -------
    torch.Tensor
        Shape (3,), in the order of :data:`NAMES`. Mean distance to the true positions, in roots of the area; mean
        squared error of turned edges, relative to their lengths, and of turned normals; mean squared relative change
        of the lengths of edges.
    """
    edges, true_edges, unbent_edges = _edges(positions), _edges(targets), _edges(unbent.positions)
    lengths = _lengths(edges)
    starts, ends = unbent.rotations.chunk(2, dim=1)
    turned = ((starts + ends) / 2 @ edges[..., None])[..., 0]
    facing = (unbent.rotations @ normals[..., None])[..., 0]
    return torch.stack(
        [
            _lengths(unbent.positions - targets).mean(),
            ((turned - true_edges) / lengths[..., None]).square().sum(-1).mean()
            + (facing - target_normals).square().sum(-1).mean(),
            (_lengths(unbent_edges) / lengths - 1).square().mean(),
        ]
    )


def weighted(terms: Tensor, configuration: Field) -> Tensor:
    """The loss that is minimised, a scalar."""
    return terms[0] + configuration.edge * terms[1] + configuration.isometry * terms[2]


def _edges(points: Tensor) -> Tensor:
    starts, ends = points.chunk(2, dim=1)
    return ends - starts


def _lengths(vectors: Tensor) -> Tensor:
    return (vectors.square().sum(-1) + _LEAST).sqrt()


LOOKED_AT = 16
"""Validation bodies that are looked at."""


@dataclass(frozen=True, kw_only=True)
class FieldPlan(Plan):
    """Plan of the training of a field; see :class:`learned.training.loop.Plan` for the other parameters.

    Parameters
    ----------
    shapes
        ``"bodies"``: surfaces of fresh bodies. ``"scans"``: the same as scanners leave them, each several times.
    uses
        Steps that show each scan; a divisor of ``bodies``. Of a body that is not scanned it is 1.
    start
        ``"random"``: random weights. ``"shipped"``: those of the model of this configuration that is shipped.
    """

    steps: Annotated[int, Interval(1)] = 12_000
    bodies: Annotated[int, Interval(2)] = 8
    learning_rate: Annotated[float, Interval(0, closed="neither")] = 5e-4
    shapes: Literal["bodies", "scans"] = "bodies"
    uses: Annotated[int, Interval(1, 64)] = 1
    start: Literal["random", "shipped"] = "random"

    def __post_init__(self) -> None:
        """Raise ``ConfigurationError`` if batches cannot be made of whole bodies, or bodies are to come twice."""
        super().__post_init__()
        if self.bodies % self.uses or (self.shapes == "bodies" and self.uses > 1):
            raise ConfigurationError(
                f"{self.bodies} {self.shapes} a step cannot be shown {self.uses} times each",
                "take -o shapes=scans and a divisor of the bodies, such as -o bodies=8 -o uses=8",
            )


Makes = MakesSurfaces | MakesScans


def train_field(
    configuration: Field,
    plan: FieldPlan,
    make: Makes,
    validation: Makes | None,
    run: TrainingRun,
) -> Trained[FieldNetwork]:
    """Train a field, going on from a checkpoint; see :class:`learned.training.loop.TrainingLoop`.

    Parameters
    ----------
    configuration, plan
        What is trained, and how.
    make
        Makes the bodies, or the scans if the plan says so.
    validation
        Makes others for the curves; None for no curves.
    run
        Where; its seed is that of the weights.

    Raises
    ------
    TrainingError
        If a body cannot be made, a loss is not a number, or the checkpoint does not fit. The checkpoint then stands at
        the last step that was done.
    """
    network, details = build_field(configuration, run.seed), {}
    if plan.start == "shipped":
        folder = DeformationField(configuration=configuration.name).model_folder
        network.load_state_dict(load_field(folder).state_dict())
        details["started_from"] = read_card(folder)["digest"]
    network.to(run.device)
    unseen = _batches(replace(plan, bodies=LOOKED_AT, uses=1), configuration, validation)(0) if validation else None
    objective = _Objective(network, configuration, run.device, unseen)
    batches = _batches(plan, configuration, make, perturbed=True)
    progress, precision = TrainingLoop(network, objective, batches, plan, run).train()
    seen = fresh_bodies(plan, progress) | {"bodies": bodies_made(plan.steps, plan.bodies, plan.uses)}
    return Trained(network, progress, precision, seen, details)


def _batches(
    plan: FieldPlan, configuration: Field, make: Makes, perturbed: bool = False
) -> Callable[[int], SurfaceBatch]:
    if plan.shapes == "scans":
        return MakesScanBatches(cast(MakesScans, make), configuration, plan.bodies, plan.uses, perturbed)
    return MakesSurfaceBatches(cast(MakesSurfaces, make), configuration, plan.bodies, perturbed)


@dataclass
class _Objective(Objective[SurfaceBatch]):
    network: FieldNetwork
    configuration: Field
    device: torch.device
    unseen: SurfaceBatch | None
    terms = NAMES
    watched = "position error"

    def losses(self, batch: SurfaceBatch, half: bool) -> Tensor:
        return self._terms(self._unbent(batch, half), batch)

    def total(self, losses: Tensor, batch: SurfaceBatch) -> Tensor:
        return weighted(losses, self.configuration)

    def measured(self, half: bool) -> Mapping[str, float]:
        """Mean distance to the true position as a share of the body's height, and the terms of the loss."""
        if self.unseen is None:
            return {}
        unbent = self._unbent(self.unseen, half)
        distances = (unbent.positions.cpu() - self.unseen.targets).norm(dim=-1).mean(dim=1)
        terms = self._terms(unbent, self.unseen).tolist()
        error = float((distances / self.unseen.heights).mean())
        return {"position error": error, **dict(zip(self.terms[1:], terms[1:], strict=True))}

    def _unbent(self, batch: SurfaceBatch, half: bool) -> Unbent:
        seen = (batch.points, batch.normals, batch.positions, batch.position_normals)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=half):
            unbent: Unbent = self.network(*(tensor.to(self.device) for tensor in seen))
        return unbent

    def _terms(self, unbent: Unbent, batch: SurfaceBatch) -> Tensor:
        known = (batch.positions, batch.targets, batch.position_normals, batch.target_normals)
        return losses(unbent, *(tensor.to(self.device) for tensor in known))
