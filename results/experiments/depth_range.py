"""Does the depth of a network say anything? ``depth_range.py evaluate FOLD SEED RESULTS EARLIER``.

The rules are in README.md beside this file, under "Targets that fill the range". RESULTS has the
models that were trained with ``stretch_depth``; EARLIER is ``learned/models`` of commit 37a963d1.
``lengthen RESULTS EARLIER`` trains for 250 epochs and evaluates on the way, ``take-apart FOLD``
looks at the network as printed, ``go-on RESULTS as-they-are|stretched`` trains it further, and
``judge`` prints the table. Scores go to depth-range.csv; what it holds is not computed again, and
two processes may add to it. ``average-bodies`` writes those of the rows of tables."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas
import torch
from numpy.typing import NDArray
from safetensors.torch import load as tensors_in
from safetensors.torch import save as saved
from scipy.ndimage import distance_transform_edt
from scipy.stats import t as student
from torch import Tensor

from benchmark.api.learning import CARD, WEIGHTS, checked_weights, read_card
from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import ShapeError
from benchmark.locks import take_lock
from benchmark.machine import describe_machine
from benchmark.pipeline.prepared import frame_of
from benchmark.pipeline.views import prepare_view
from benchmark.protocols.pairs import data_of_training
from benchmark.protocols.trainings import TRAININGS
from benchmark.text import say
from learned import fitting, training
from learned.images import COVERED, DepthScale, checked_image, enlarged, resampled
from learned.methods import Learned
from learned.models import CONFIGURATIONS, load_model, save_model
from learned.pairs import PairsInMemory, gather
from learned.paper_network import PaperNetwork
from learned.surface import open_surface
from retrieval.cmbof import CMBOF
from retrieval.measures import score_draws

#: Bodies on which models are judged, and data on which they were trained.
JUDGES = "people[n=12]"
TRAINED = "people[draw=0]"

#: Pixels a side, epochs of a training, and how many of these are early ones.
RESOLUTION = 128
EPOCHS = 60
EARLY = 12

SCORES = Path(__file__).with_name("depth-range.csv")
MEASURES = ("NN", "FT", "ST", "DCG")

#: Epochs of the long training, and those after which its weights are judged.
LONG = 250
AT = (60, 120, 180, 250)

#: Settings: what is judged. ``EARLIER`` was trained on depths as they are, ``NEW`` on stretched
#: ones; the others replace the depth that ``NEW`` predicts, or divide that of ``EARLIER``.
EARLIER = "earlier"
DIVIDED = "earlier depth / f"
NEW = "stretched"
AVERAGE = "average body"
FLAT = "flat"
TRUE = "true depth"

#: Targets of a network that is trained further, other than ``NEW``: depths as they are.
PLAIN = "as-they-are"

#: Settings that ``NEW`` has to exceed if it sees more than the range of depths and a mean body.
CONTROLS = (DIVIDED, AVERAGE)

#: Epochs and seed with which the network as printed is trained further.
FURTHER = 50
FURTHER_SEED = 1
AS_PRINTED = Learned.shipped_models / "people-fold-0" / "as_printed-seed0"


@cache
def judges() -> tuple[list[str], NDArray[np.float32], NDArray[np.float32]]:
    """Return subject, depth image and true canonical image of each view, in the frame of the
    training.
    """
    shapes = open_dataset(JUDGES)
    half_width = frame_of(open_dataset(TRAINED))
    entries = list(shapes.shapes)
    canonical = canonical_shapes(shapes)
    images = np.stack(
        [
            prepare_view(shapes.load(each), shapes.camera(each), half_width)["depth"]
            for each in entries
        ]
    )
    subjects = [entry.subject for entry in entries]
    return subjects, images, images[[entries.index(canonical[subject]) for subject in subjects]]


@cache
def training_bodies(fold: int, resolution: int) -> Tensor:
    """Return depth and mask of each training body, shape (n, 2, r, r)."""
    seen: dict[str, NDArray[np.float32]] = {}
    for pair in data_of_training(TRAININGS[f"people-fold-{fold}"], None, say).pairs():
        if pair.target_identifier not in seen:
            seen[pair.target_identifier] = resampled(checked_image(pair.target), resolution)
    return torch.from_numpy(np.stack([*seen.values()])).double()


def average_body(fold: int, resolution: int = RESOLUTION) -> Tensor:
    """Return the mean depth of the training bodies, shape (r, r): at each pixel, of those that
    cover it.
    """
    depth, mask = training_bodies(fold, resolution).unbind(1)
    return spread((depth * mask).sum(0) / mask.sum(0).clamp(min=1), mask.sum(0))


def spread(depth: Tensor, mask: Tensor) -> Tensor:
    """Return the depth inside a mask, and outside of it that of the nearest pixel inside."""
    rows, columns = distance_transform_edt(
        mask.numpy() <= COVERED, return_distances=False, return_indices=True
    )
    return depth[torch.from_numpy(rows).long(), torch.from_numpy(columns).long()]


def settings(
    earlier: Sequence[Tensor],
    new: Sequence[Tensor],
    truth: Sequence[Tensor],
    fold: int,
    factor: float,
) -> Iterator[tuple[str, list[Tensor]]]:
    """Yield what is judged: depth and mask of each view."""
    average = average_body(fold, len(new[0][0]))
    yield EARLIER, [*earlier]
    yield DIVIDED, [torch.stack([0.5 + (depth - 0.5) / factor, mask]) for depth, mask in earlier]
    yield NEW, [*new]
    yield AVERAGE, [torch.stack([average, mask]) for _, mask in new]
    yield FLAT, [torch.stack([torch.full_like(mask, 0.5), mask]) for _, mask in new]
    yield (
        TRUE,
        [torch.stack([spread(*true), mask]) for (_, mask), true in zip(new, truth, strict=True)],
    )


def error(predicted: Tensor, true: Tensor) -> float:
    """Return the root mean square error of the depth inside both masks, without the mean of the
    error.
    """
    both = (predicted[1] > COVERED) & (true[1] > COVERED)
    return float((predicted[0] - true[0])[both].std(correction=0)) if both.any() else np.nan


def ranked(predictions: Sequence[Tensor]) -> dict[str, NDArray[np.float64]]:
    """Return the measures of each query.

    As in tables, a query whose prediction has no surface scores 0, and ranks behind all others.
    """
    scorer = CMBOF()
    signatures = []
    answered = []
    for number, prediction in enumerate(predictions):
        try:
            surface, _ = open_surface(enlarged(prediction))
        except ShapeError as refusal:
            print(f"view {number}: {refusal}", flush=True)
            continue
        signatures.append(scorer.signature(surface))
        answered.append(number)
    matrices = (scorer.compare(signatures, draw) for draw in range(scorer.info.draws))
    return score_draws(matrices, judges()[0], answered)["per_query"]


def by_pixels(predictions: Sequence[Tensor]) -> dict[str, NDArray[np.float64]]:
    """Return the measures of each query by the L2 distance of depths inside the masks."""
    flat = np.stack(
        [torch.where(mask > COVERED, depth, 0).numpy().ravel() for depth, mask in predictions]
    )
    matrix = np.sqrt(
        np.maximum((flat**2).sum(1)[:, None] + (flat**2).sum(1) - 2 * flat @ flat.T, 0)
    )
    np.fill_diagonal(matrix, 0)
    return score_draws([(matrix + matrix.T) / 2], judges()[0])["per_query"]


def predictions(method: Learned) -> list[Tensor]:
    """Return the predictions of a model for all views."""
    return [method.predict(image) for image in judges()[1]]


def known_scores() -> pandas.DataFrame:
    """Return the scores that are in the table."""
    if not SCORES.is_file():
        return pandas.DataFrame(columns=["fold", "seed", "epochs", "setting"])
    return pandas.read_csv(SCORES)


def append(found: Sequence[pandas.DataFrame]) -> None:
    """Add scores to the table as it is now: another process may have added its own meanwhile."""
    with Path(__file__).open() as lock:
        take_lock(lock.fileno())
        table = pandas.concat([known_scores(), *found])
        partial = SCORES.with_suffix(".tmp")
        table.to_csv(partial, index=False, lineterminator="\n")
        partial.replace(SCORES)


def evaluate(fold: int, seed: int, folder: Path, earlier: Path, epochs: int) -> None:
    """Append the scores of a model, of the earlier one and of the controls."""
    known = known_scores()
    if len(known.query(f"fold == {fold} and seed == {seed} and epochs == {epochs}")):
        return
    card = json.loads((folder / CARD).read_text())
    truth = true_images(RESOLUTION)
    before = earlier / f"people-fold-{fold}" / f"literal-seed{seed}"
    of_earlier = predictions(Learned().load(before))
    new = predictions(Learned().load(folder))
    facts = {"fold": fold, "seed": seed, "epochs": epochs}
    found = []
    for setting, given in settings(of_earlier, new, truth, fold, card["depth_scale"]["factor"]):
        found.append(scored({**facts, "setting": setting}, ranked(given), given, truth))
    for setting, given in ((EARLIER, of_earlier), (NEW, new)):
        found.append(scored({**facts, "setting": f"{setting}, L2"}, by_pixels(given), given, truth))
    append(found)


def take_apart(fold: int) -> None:
    """Append the scores of the network as printed with a part of its prediction replaced."""
    method = Learned(configuration="as_printed")
    method = method.load(method.shipped_models / f"people-fold-{fold}" / "as_printed-seed0")
    truth = [each.float() for each in true_images(500)]
    given = [each.float() for each in predictions(method)]
    average = average_body(fold, 500).float()
    changes: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
        "as predicted": lambda predicted, true: predicted,
        TRUE: lambda predicted, true: torch.stack([spread(*true), predicted[1]]),
        "true mask": lambda predicted, true: torch.stack([spread(*predicted), true[1]]),
        AVERAGE: lambda predicted, true: torch.stack([average, predicted[1]]),
        FLAT: lambda predicted, true: torch.stack([torch.full_like(average, 0.5), predicted[1]]),
        "true": lambda predicted, true: true,
    }
    facts = {"fold": fold, "seed": 0, "epochs": 500}
    found = []
    for setting, change in changes.items():
        images = [change(*each) for each in zip(given, truth, strict=True)]
        found.append(
            scored({**facts, "setting": f"as printed: {setting}"}, ranked(images), images, truth)
        )
    found.append(scored({**facts, "setting": "as printed: L2"}, by_pixels(given), given, truth))
    append(found)


def go_on(results: Path, targets: str) -> None:
    """Train the network as printed of fold 0 further, on targets of either range, and append its
    scores.
    """
    if targets not in (PLAIN, NEW):
        raise SystemExit(__doc__)
    if known_scores()["setting"].str.startswith(f"as printed, then {targets}:").any():
        return
    name = "as_printed"
    data = data_of_training(TRAININGS["people-fold-0"], None, say)
    configuration = CONFIGURATIONS[name]
    device = torch.device("cpu")
    given = training.Schedule(epochs=FURTHER, early_epochs=0, stretch_depth=targets == NEW)
    schedule = training.resolved(given, device)
    pairs = gather(data.pairs(), data.n_pairs, schedule.resolution, configuration.crop)
    stretched = DepthScale.of(pairs.targets)
    scale = {PLAIN: DepthScale(), NEW: stretched}[targets]
    pairs = pairs.scaled(scale)
    folder = results / "models" / "people-fold-0" / f"{name}-{targets}"
    folder.mkdir(parents=True, exist_ok=True)
    recipe = {
        **asdict(schedule),
        "seed": FURTHER_SEED,
        "shapes": list(data.identifiers),
        "images": pairs.digest(),
    }
    if not fitting.check_finished(folder, recipe):
        network = configuration.build()
        assert isinstance(network, PaperNetwork)
        network.load_state_dict(
            {key: each.float() for key, each in tensors_in(checked_weights(AS_PRINTED)).items()}
        )
        if not (folder / training.CHECKPOINT).is_file():
            fit_depth_head(network, pairs, schedule)
        history, seconds = training.fit(
            network, pairs, None, schedule, folder, seed=FURTHER_SEED, device=device, log=say
        )
        start = read_card(AS_PRINTED).digest
        facts = {
            "pairs": len(pairs),
            "seed": FURTHER_SEED,
            "data_digest": recipe["images"],
            "depth_scale": msgspec.to_builtins(scale),
            "starts_from": f"{start}, its depth head fitted to the targets by least squares",
            "schedule_in_words": f"{schedule.in_words()}, {describe_machine()}",
            "machine": describe_machine(),
            "core_seconds": round(seconds),
        }
        save_model(network.eval(), configuration, data, schedule, history, folder, facts)
        (folder / training.CHECKPOINT).unlink(missing_ok=True)
    truth = true_images(schedule.resolution)
    before, new = (
        predictions(Learned(configuration="as_printed").load(each)) for each in (AS_PRINTED, folder)
    )
    facts = {"fold": 0, "seed": FURTHER_SEED, "epochs": FURTHER}
    append(
        [
            scored(
                {**facts, "setting": f"as printed, then {targets}: {setting}"},
                ranked(given),
                given,
                truth,
            )
            for setting, given in settings(before, new, truth, 0, stretched.factor)
        ]
    )


@torch.no_grad()
def fit_depth_head(
    network: PaperNetwork, pairs: PairsInMemory, schedule: training.Schedule
) -> None:
    """Fit the depth of the last layer of a network to targets by least squares, in place.

    The background of targets is 0, whether or not the depths of bodies are stretched. So no linear
    map of the predicted depths fits stretched targets: it would move the background, too, and a
    training would spend its steps on the way back.

    Parameters
    ----------
    network
        The network, of which only the weights and the bias of the depth change.
    pairs
        Images and targets.
    schedule
        Its precision is that in which the network computes.
    """
    head = network.reconstruction.head
    inputs: list[Tensor] = []
    watching = head.register_forward_pre_hook(lambda _, given: inputs.append(given[0]))
    # The normal equations: products of the features, and of the features and the depth.
    n_unknowns = head.in_channels + 1
    products = torch.zeros(n_unknowns, n_unknowns, dtype=torch.float64)
    right_side = torch.zeros(n_unknowns, 1, dtype=torch.float64)
    for row in range(len(pairs)):
        image, target = pairs[torch.tensor([row])]
        training._predicted(network, image, schedule)
        features = inputs.pop().double()
        columns = torch.cat([features, torch.ones_like(features[:, :1])], dim=1)[0].flatten(1)
        products += columns @ columns.T
        right_side += columns @ target[0, 0].double().reshape(-1, 1)
    watching.remove()
    # Some features may be 0 everywhere: of all solutions, that of the least norm.
    solution = torch.linalg.lstsq(products, right_side, driver="gelsd").solution[:, 0]
    bias = head.bias
    assert bias is not None
    head.weight[0] = solution[:-1].reshape(head.weight[0].shape)
    bias[0] = solution[-1]


def true_images(resolution: int) -> list[Tensor]:
    """Return depth and mask of the true canonical image of each view."""
    return [torch.from_numpy(resampled(image, resolution)).double() for image in judges()[2]]


def scored(
    facts: Mapping[str, Any],
    found: Mapping[str, Any],
    given: Sequence[Tensor],
    truth: Sequence[Tensor],
) -> pandas.DataFrame:
    """Return the scores and the error of each body."""
    errors = [error(*each) for each in zip(given, truth, strict=True)]
    table = pandas.DataFrame(
        {**{name: found[name] for name in MEASURES}, "error": errors, "body": judges()[0]}
    )
    means = table.groupby("body", sort=False).mean().reset_index()
    print(*facts.values(), means[[*MEASURES, "error"]].mean().round(4).to_dict(), flush=True)
    return means.assign(**facts)[[*facts, *means]].round({**dict.fromkeys(MEASURES, 4), "error": 5})


def lengthen(results: Path, earlier: Path) -> None:
    """Train fold 0 with seed 0 for :data:`LONG` epochs, and evaluate the weights at each of
    :data:`AT`.
    """
    folder = results / "models" / "people-fold-0" / "literal-seed0"
    finished = training._State.finished_epoch

    def keeping(state: Any, n_pairs: int) -> dict[str, float]:
        row = finished(state, n_pairs)
        if state.epoch in AT:
            halves = {
                name: each.detach().half().contiguous()
                for name, each in state.network.state_dict().items()
            }
            place = results / f"epoch-{state.epoch}"
            place.mkdir(parents=True, exist_ok=True)
            (place / WEIGHTS).write_bytes(saved(halves))
        return row

    training._State.finished_epoch = keeping  # type: ignore[method-assign]
    options = {
        "resolution": RESOLUTION,
        "epochs": LONG,
        "early_epochs": EARLY,
        "stretch_depth": True,
    }
    data = data_of_training(TRAININGS["people-fold-0"], None, say)
    fitting.train(
        "literal",
        0,
        data,
        folder,
        {**options, "device": "cpu"},
        say,
    )
    card = json.loads((folder / CARD).read_text())
    for epoch in AT:
        place = results / f"epoch-{epoch}"
        digest = hashlib.sha256((place / WEIGHTS).read_bytes()).hexdigest()
        (place / CARD).write_text(json.dumps({**card, "digest": digest}))
        load_model(place)
        evaluate(0, 0, place, earlier, -epoch)  # negative: of the long training


def judge() -> None:
    """Print the scores of every training and control, the paired differences, and what follows."""
    scores = pandas.read_csv(SCORES)
    judge_short_trainings(scores[scores["epochs"] == EPOCHS])
    judge_further_trainings(scores[scores["epochs"] == FURTHER])
    judge_long_training(scores[(scores["epochs"] < 0) & (scores["setting"] == NEW)])


def judge_short_trainings(scores: pandas.DataFrame) -> None:
    """Print how far stretched targets exceed other settings, and what the rule says.

    Parameters
    ----------
    scores
        One line for each body, fold, seed and setting.
    """
    means = scores.groupby(["fold", "seed", "setting"], sort=False)[[*MEASURES, "error"]].mean()
    print(
        means.round(4).to_string(),
        means.groupby("setting", sort=False).mean().round(4).to_string(),
        sep="\n\n",
    )
    of_trainings = means["FT"].unstack("setting")
    of_bodies = scores.groupby(["setting", "body"])["FT"].mean().unstack("setting")
    exceeds = {}
    for other in (EARLIER, *CONTROLS, FLAT, TRUE):
        gain = (of_trainings[NEW] - of_trainings[other]).to_numpy()
        gain_of_body = (of_bodies[NEW] - of_bodies[other]).to_numpy()
        unit = standard_error(gain)
        reach = student.ppf(0.975, len(gain_of_body) - 1) * standard_error(gain_of_body)
        exceeds[other] = gain.mean() >= student.ppf(0.975, len(gain) - 1) * unit
        print(
            f"{NEW} - {other}: FT {gain.mean():+.4f}, "
            f"{gain.mean() / unit:.2f} standard errors of {len(gain)} pairs, over bodies "
            f"{gain_of_body.mean() - reach:+.4f} to {gain_of_body.mean() + reach:+.4f}"
        )
    errors = means["error"].groupby("setting").mean()
    print("is kept:", exceeds[EARLIER])
    is_below = errors[NEW] < errors[AVERAGE]
    print(
        "sees the relief:",
        exceeds[EARLIER] and all(exceeds[name] for name in CONTROLS) and is_below,
    )


def standard_error(values: NDArray[np.float64]) -> float:
    """Return the standard error of a mean."""
    return float(values.std(ddof=1) / len(values) ** 0.5)


def judge_further_trainings(scores: pandas.DataFrame) -> None:
    """Print how far stretched targets exceed others, if the network as printed is trained further,
    and what the rule says.

    Parameters
    ----------
    scores
        One line for each body and setting.
    """
    of_bodies = scores.groupby(["setting", "body"])[["FT", "error"]].mean()
    mine = f"as printed, then {NEW}: {NEW}"
    plain = f"as printed, then {PLAIN}: {NEW}"
    controls = [f"as printed, then {NEW}: {each}" for each in CONTROLS]
    if not {mine, plain, *controls} <= {*of_bodies.index.get_level_values("setting")}:
        return  # not all have run
    ft = of_bodies["FT"].unstack("setting")
    errors = of_bodies["error"].unstack("setting").mean()
    lowest = {}
    highest = {}
    for other in (plain, *controls):
        gain = (ft[mine] - ft[other]).to_numpy()
        reach = student.ppf(0.975, len(gain) - 1) * standard_error(gain)
        lowest[other] = gain.mean() - reach
        highest[other] = gain.mean() + reach
        print(f"{mine} - {other}: FT over bodies {lowest[other]:+.4f} to {highest[other]:+.4f}")
    average = f"as printed, then {NEW}: {AVERAGE}"
    print(f"error: {errors[mine]:.5f}, of the average body {errors[average]:.5f}")
    range_matters = lowest[plain] > 0 or highest[plain] < 0
    exceeds_controls = all(lowest[control] > 0 for control in controls)
    print("the range of depths matters:", bool(range_matters))
    is_below = errors[mine] < errors[average]
    print("sees the relief:", bool(range_matters and exceeds_controls and is_below))


def judge_long_training(scores: pandas.DataFrame) -> None:
    """Print the fewest epochs after which a long training is within a standard error of its best.

    Parameters
    ----------
    scores
        One line for each body and number of epochs, which is negative for a long training.
    """
    of_epochs = scores.groupby("epochs")["FT"].agg(["mean", "sem"])
    if len(of_epochs) < len(AT):
        return
    best = of_epochs.loc[of_epochs["mean"].idxmax()]
    is_near_best = of_epochs["mean"] >= best["mean"] - best["sem"]
    print("epochs:", -of_epochs.index[is_near_best].max())


if __name__ == "__main__":
    torch.set_num_threads(1)
    what, *rest = sys.argv[1:]
    if what == "evaluate":
        place = Path(rest[2]) / "models" / f"people-fold-{rest[0]}" / f"literal-seed{rest[1]}"
        evaluate(int(rest[0]), int(rest[1]), place, Path(rest[3]), EPOCHS)
    elif what == "average-bodies":
        bodies = {f"people-fold-{fold}": (average_body(fold) - 0.5).half() for fold in range(3)}
        (Learned.shipped_models / "average-bodies.safetensors").write_bytes(saved(bodies))
    elif what == "take-apart":
        take_apart(int(rest[0]))
    elif what == "go-on":
        go_on(Path(rest[0]), rest[1])
    elif what == "lengthen":
        lengthen(Path(rest[0]), Path(rest[1]))
    elif what == "judge":
        judge()
    else:
        raise SystemExit(__doc__)
