"""The rules of experiments on made-up scores, and what their pages say."""

import importlib
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch

from benchmark.api.learning import CARD, read_card
from benchmark.errors import ConfigurationError
from learned import fitting
from learned.images import DepthScale
from learned.pairs import gather
from learned.paper_network import PaperNetwork
from learned.training import CHECKPOINT, Schedule, losses, resolved
from tests.learned.toy import BUILDS, quiet, toy_data, toy_pairs

FOLDER = Path(__file__).parents[2] / "results" / "experiments"


@pytest.fixture
def experiment(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import data_or_architecture

    yield data_or_architecture
    for name in ("data_or_architecture", "depth_range"):
        sys.modules.pop(name, None)


@pytest.fixture
def depth_range(experiment, monkeypatch, tmp_path):
    module = experiment.depth_range
    monkeypatch.setattr(module, "SCORES", tmp_path / "depth-range.csv")
    n_threads = torch.get_num_threads()
    yield module
    torch.set_num_threads(n_threads)
    torch.set_flush_denormal(False)  # as before a training


def cell(mean, between_seeds=0.0, noise=0.01):
    """FT of twelve bodies by two seeds."""
    random = np.random.default_rng(7)
    bodies = 0.1 * random.normal(size=12)
    columns = {
        seed: mean + bodies + sign * between_seeds + noise * random.normal(size=12)
        for seed, sign in ((0, -1), (1, 1))
    }
    return pd.DataFrame(columns)


def test_a_factor_has_an_effect_if_it_exceeds_the_level_at_both_levels_of_the_other(experiment):
    low, high = cell(0.5), cell(0.6)
    assert experiment.has_effect([(high, low), (high, low)])
    assert experiment.has_effect([(low, high), (low, high)])
    turned = low.iloc[::-1].set_axis(low.index)
    assert not experiment.has_effect([(high, low), (low, turned)])
    assert not experiment.has_effect([(high, low), (low, high)])


def test_a_factor_has_no_effect_if_other_seeds_turn_its_sign(experiment):
    low, high = cell(0.5, between_seeds=0.04), cell(0.53)
    t, signs = experiment.difference(high, low)
    assert t > experiment.LEAST_T and signs == {-1, 1}
    assert not experiment.has_effect([(high, low), (high, low)])


def test_t_is_that_of_paired_differences_over_bodies(experiment):
    first = pd.DataFrame({0: [1.0, 2.0, 4.0], 1: [1.0, 2.0, 6.0]})
    second = pd.DataFrame({0: [0.0, 0.0, 0.0], 1: [0.0, 0.0, 0.0]})
    gains = np.array([1.0, 2.0, 5.0])
    expected = gains.mean() / (gains.std(ddof=1) / 3**0.5)
    assert experiment.difference(first, second)[0] == pytest.approx(expected)


def test_no_model_is_evaluated_before_all_are_trained(experiment, monkeypatch, tmp_path):
    monkeypatch.setattr(experiment, "MODELS", tmp_path)
    with pytest.raises(SystemExit, match="no model is evaluated before all are trained"):
        experiment.finished_cells()
    assert experiment.status().count("not yet") == 8


def test_the_recipe_of_all_cells_has_the_same_number_of_images(experiment):
    from benchmark.protocols.trainings import TRAININGS, n_pairs

    for data in experiment.DATA:
        pairs = n_pairs(TRAININGS[data], None)
        images = pairs * experiment.REPEATS[data] * experiment.RECIPE["epochs"]
        assert images == experiment.IMAGES
    assert len(list(experiment.cells())) == 8


def test_the_computation_of_the_networks_is_that_of_the_page(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import computation

    page = (FOLDER.parents[1] / "docs" / "explanation" / "networks.md").read_text()
    for configuration, pixels, epochs in computation.NETWORKS:
        count = f"{computation.parameters(configuration):,}"
        giga = f"{computation.forward_operations(configuration, pixels) / 2e9:.1f}"
        tera = f"{computation.training(configuration, pixels, epochs):,.0f}"
        assert f"width 16, {epochs} epochs | {count} | {giga} | {tera} |" in page
    millions = [
        [computation.capacity(rate, share) / 1e6 for share in computation.SHARES]
        for rate in computation.RATES.values()
    ]
    for low, high in millions:
        assert f"| {low:.1f} to {high:.0f} million |" in page
    ours = computation.training(*computation.NETWORKS[0]) / 1e6
    assert 200 < min(millions)[0] / ours < 300
    assert 2000 < max(millions)[1] / ours < 2500
    assert "two hundred to two thousand times as much" in " ".join(page.split())


def test_the_page_says_which_weights_matter_alone_and_among_all_changes():
    changes = pd.read_csv(FOLDER / "sensitivity.csv")
    page = " ".join((FOLDER / "README.md").read_text().split())
    found = changes[(changes["p"] < 0.05) & changes["above_scatter"]]
    data_by_weight = {
        (method, weight): set(of_weight["data"])
        for (method, weight), of_weight in found.groupby(["method", "weight"])
    }
    on_both = {"tosca", "people[draw=1]"}
    assert data_by_weight == {
        ("sd-gdm", "count"): on_both,
        ("mesh-unfolding", "strain_bound"): on_both,
        ("constrained-mds", "last_pull"): {"people[draw=1]"},
        ("mesh-unfolding", "first_stiffness"): {"people[draw=1]"},
    }
    assert "**Four of the seven weights matter somewhere**" in page
    on_people = changes[changes["data"] == "people[draw=1]"]
    of_small = on_people[on_people["weight"].isin(["last_pull", "first_stiffness"])]
    assert of_small["change"].abs().max() < 0.02

    n_changes = changes.groupby(["data", "method", "weight", "factor"]).ngroups
    assert f"{n_changes} changes were tested" in page
    among_all = found[found["p"] < 0.05 / n_changes]
    assert set(among_all["data"]) == {"people[draw=1]"}
    assert set(zip(among_all["weight"], among_all["factor"], strict=True)) == {
        ("count", 0.5),
        ("count", 2.0),
        ("strain_bound", 0.5),
        ("first_stiffness", 2.0),
    }


def test_weights_of_ours_are_parameters_that_their_methods_declare(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    import sensitivity

    from benchmark.registry import select_one

    for method, weights in sensitivity.WEIGHTS.items():
        component = select_one(method)
        assert "ours" in component.info.departs
        halved, doubled = sensitivity.FACTORS
        names = [name for name, _, _ in sensitivity.variants(method)]
        assert len(names) == 2 * len(weights)
        for name, weight, factor in sensitivity.variants(method):
            value = select_one(name).parameters[weight]
            assert value == factor * component.defaults[weight], name
            assert factor in (halved, doubled)


def test_the_page_on_data_and_architecture_has_what_its_scores_say(experiment):
    page = experiment.PAGE.read_text(encoding="utf-8")
    assert f"<!-- cells -->\n{experiment.status()}\n<!-- end of cells -->" in page
    assert f"<!-- results -->\n{experiment.results()}\n<!-- end of results -->" in page


def test_the_words_on_data_and_architecture_follow_from_the_scores(experiment):
    judged = experiment.Judgement(pd.read_csv(experiment.SCORES))
    page = " ".join(experiment.PAGE.read_text(encoding="utf-8").split())
    of_data, of_architecture = judged.levels_of_data(), judged.levels_of_architecture()
    assert not experiment.has_effect([*of_data.values()])
    assert not experiment.has_effect([*of_architecture.values()])
    assert "no effect of the data is shown, and none of the architecture" in page

    t, signs = experiment.difference(*of_data["wide-extra"])
    assert signs == {1} and f"(t(11) = {t:.2f}), for every choice of seeds. FT of the" in page
    t, signs = experiment.difference(*of_data["literal"])
    assert t < 0 and signs == {-1, 1}
    t, signs = experiment.difference(*of_architecture["humans-sampled"])
    assert signs == {1} and f"(t(11) = {t:.2f}), for every choice of seeds. On fold 0" in page
    assert experiment.difference(*of_architecture["people-fold-0"])[1] == {-1, 1}

    cells = {(cell.data, cell.network) for cell in experiment.cells()}
    lowest = min(judged.ft(*cell, experiment.depth_range.TRUE).to_numpy().mean() for cell in cells)
    assert f"FT is at least {lowest:.2f} in every cell".replace("0.", ".") in page
    t = judged.against_average_body("humans-sampled", "literal")
    assert t < -experiment.LEAST_T and f"(t(11) = {t:.2f})" in page
    for cell in cells:
        assert not judged.sees_the_relief(*cell)
        predicted = judged.ft(*cell).to_numpy().mean()
        assert predicted <= judged.ft(*cell, experiment.depth_range.AVERAGE).to_numpy().mean()
        assert predicted < judged.ft(*cell, experiment.L2).to_numpy().mean()
        error = judged.values("error", *cell).to_numpy().mean()
        of_average = judged.values("error", *cell, experiment.depth_range.AVERAGE)
        assert error < of_average.to_numpy().mean()


def test_a_network_sees_the_relief_only_by_score_and_error_together(experiment):
    higher, lower = cell(0.6), cell(0.5)
    small, large = cell(0.004, noise=0.0), cell(0.008, noise=0.0)

    def judgement(ft, ft_of_average, error, error_of_average):
        tables = []
        for setting, of_ft, of_error in (
            (experiment.PREDICTED, ft, error),
            (experiment.depth_range.AVERAGE, ft_of_average, error_of_average),
        ):
            for seed in (0, 1):
                tables.append(
                    pd.DataFrame(
                        {
                            "data": "people-fold-0",
                            "network": "literal",
                            "seed": seed,
                            "setting": setting,
                            "body": range(12),
                            "FT": of_ft[seed],
                            "error": of_error[seed],
                        }
                    )
                )
        return experiment.Judgement(pd.concat(tables))

    def sees(*values):
        return judgement(*values).sees_the_relief("people-fold-0", "literal")

    assert sees(higher, lower, small, large)
    assert not sees(higher, lower, large, small)
    assert not sees(lower, higher, small, large)
    one_seed = higher.copy()
    one_seed[1] = lower[1] - 0.01
    assert not sees(one_seed, lower, small, large)


def further_scores(module, gains, errors=(0.5, 1.0)):
    """Scores of twelve bodies by the network as printed that was trained further.

    Parameters
    ----------
    module
        The experiment.
    gains
        How far FT with stretched targets exceeds that with plain ones, and that of each control.
    errors
        Error of the depth with stretched targets, and that of the average body.
    """
    stretched = f"as printed, then {module.NEW}"
    plain = f"as printed, then {module.PLAIN}: {module.NEW}"
    controls = [f"{stretched}: {name}" for name in module.CONTROLS]
    bodies = 0.5 + 0.1 * np.random.default_rng(3).normal(size=12)
    noise = 0.01 * np.random.default_rng(4).normal(size=12)
    ft = {f"{stretched}: {module.NEW}": bodies + noise}
    for setting, gain in zip([plain, *controls], gains, strict=True):
        ft[setting] = bodies - gain
    error = {f"{stretched}: {module.NEW}": errors[0], f"{stretched}: {module.AVERAGE}": errors[1]}
    tables = []
    for setting, values in ft.items():
        facts = {"setting": setting, "body": range(12), "error": error.get(setting, 2.0)}
        tables.append(pd.DataFrame({**facts, "FT": values}))
    return pd.concat(tables)


@pytest.mark.parametrize(
    ("gains", "errors", "matters", "sees"),
    [
        ((0.1, 0.1, 0.1), (0.5, 1.0), True, True),
        ((0.1, 0.1, 0.1), (1.0, 0.5), True, False),
        ((0.1, 0.0, 0.1), (0.5, 1.0), True, False),
        ((0.1, 0.1, -0.1), (0.5, 1.0), True, False),
        ((0.0, 0.1, 0.1), (0.5, 1.0), False, False),
        ((-0.1, -0.1, -0.1), (0.5, 1.0), True, False),
    ],
)
def test_a_network_trained_further_sees_the_relief_only_by_scores_and_error_together(
    gains, errors, matters, sees, depth_range, capsys
):
    depth_range.judge_further_trainings(further_scores(depth_range, gains, errors))
    said = capsys.readouterr().out
    assert f"the range of depths matters: {matters}" in said
    assert f"sees the relief: {sees}" in said


def test_the_page_says_what_came_of_the_network_as_printed_that_was_trained_further(
    experiment, capsys
):
    module = experiment.depth_range
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    scores = pd.read_csv(FOLDER / "depth-range.csv")
    further = scores[scores["epochs"] == module.FURTHER]
    module.judge_further_trainings(further)
    for line in capsys.readouterr().out.splitlines():
        assert f"    {line}\n" in page
    means = further.groupby("setting")[[*module.MEASURES, "error"]].mean()
    rows = {
        "before": f"{module.NEW}: {module.EARLIER}",
        "its depth / f": f"{module.NEW}: {module.CONTROLS[0]}",
        "50 more epochs, plain targets": f"{module.PLAIN}: {module.NEW}",
        "50 more epochs, stretched targets": f"{module.NEW}: {module.NEW}",
        "average body in the last one's mask": f"{module.NEW}: {module.AVERAGE}",
        "flat in its mask": f"{module.NEW}: {module.FLAT}",
        "true depth in its mask": f"{module.NEW}: {module.TRUE}",
    }
    for title, setting in rows.items():
        of_row = means.loc[f"as printed, then {setting}"]
        numbers = " ".join(f"{of_row[name]:.2f}".removeprefix("0") for name in module.MEASURES)
        error = f"{of_row['error']:.4f} ".removeprefix("0") if of_row["error"] else ""
        assert f"| {title} | {numbers} | {error}|" in page


def test_scores_that_another_process_adds_meanwhile_are_kept(depth_range, monkeypatch, tmp_path):
    def found(setting):
        return pd.DataFrame({"fold": [0], "seed": [1], "epochs": [50], "setting": [setting]})

    def predictions(_):
        depth_range.append([found("of another process")])
        return []

    monkeypatch.setattr(depth_range, "data_of_training", lambda *_: toy_data())
    monkeypatch.setattr(depth_range.fitting, "check_finished", lambda *_: True)
    monkeypatch.setattr(depth_range.Learned, "load", lambda *_: None)
    monkeypatch.setattr(depth_range, "predictions", predictions)
    monkeypatch.setattr(depth_range, "true_images", lambda _: [])
    monkeypatch.setattr(depth_range, "settings", lambda *_: iter([("predicted", [])]))
    monkeypatch.setattr(depth_range, "ranked", lambda _: {})
    monkeypatch.setattr(depth_range, "scored", lambda facts, *_: found(facts["setting"]))
    depth_range.append([found("known")])
    depth_range.go_on(tmp_path, depth_range.PLAIN)
    settings = pd.read_csv(depth_range.SCORES)["setting"].tolist()
    other = "of another process"
    assert settings == ["known", other, other, "as printed, then as-they-are: predicted"]


def test_a_finished_model_of_other_pairs_is_no_model_of_the_experiment(
    depth_range, monkeypatch, tmp_path
):
    data = toy_data()
    monkeypatch.setattr(depth_range, "data_of_training", lambda *_: data)
    folder = tmp_path / "models" / "people-fold-0" / f"as_printed-{depth_range.PLAIN}"
    folder.mkdir(parents=True)
    schedule = Schedule(epochs=depth_range.FURTHER, early_epochs=0)
    card = {
        "schedule": asdict(resolved(schedule, torch.device("cpu"))),
        "seed": depth_range.FURTHER_SEED,
        "identifiers": list(data.identifiers),
        "data_digest": "0" * 64,
    }
    (folder / CARD).write_text(json.dumps(card))
    with pytest.raises(ConfigurationError, match="of another training, with another images"):
        depth_range.go_on(tmp_path, depth_range.PLAIN)


@pytest.mark.parametrize("is_stretched", [False, True])
def test_the_depth_of_the_last_layer_is_fitted_by_least_squares(is_stretched, depth_range):
    pairs = gather(toy_pairs(BUILDS), 10, 32)
    if is_stretched:
        pairs = pairs.stretched()
    schedule = Schedule(resolution=32, precision="float32", stretch_depth=is_stretched)
    network = PaperNetwork(width=4)
    images, targets = pairs[torch.arange(len(pairs))]
    before = network(images).detach()
    depth_range.fit_depth_head(network, pairs, schedule)
    after = network(images)
    torch.testing.assert_close(after[:, 1], before[:, 1], rtol=0, atol=1e-6)
    depth_loss, _ = losses(after, targets)
    (of_weights,) = torch.autograd.grad(depth_loss, network.reconstruction.head.weight)
    assert of_weights.abs().max() < 1e-5  # no other weights fit better
    assert depth_loss < targets[:, 0].var() < losses(before, targets)[0]
    head = network.reconstruction.head
    assert not head._forward_pre_hooks


def test_the_network_as_printed_goes_on_from_a_start_that_fits_either_targets(
    depth_range, monkeypatch, tmp_path
):
    """With few pixels, pairs and bodies: both trainings, their scores, and what is not repeated."""
    small = {"resolution": 32, "batch": 2, "precision": "float32"}
    printed = tmp_path / "printed"
    one_epoch = {**small, "epochs": 1, "device": "cpu", "threads": 1}
    fitting.train("as_printed", 0, toy_data(), printed, one_epoch, quiet)
    monkeypatch.setattr(depth_range, "AS_PRINTED", printed)
    monkeypatch.setattr(depth_range, "FURTHER", 2)
    monkeypatch.setattr(depth_range, "data_of_training", lambda *_: toy_data())
    monkeypatch.setattr(
        depth_range.training, "Schedule", lambda **given: Schedule(**{**small, **given})
    )
    images = [pair.image for pair in toy_pairs(BUILDS)]
    bodies = [pair.subject for pair in toy_pairs(BUILDS)]
    truth = [pair.target for pair in toy_pairs(BUILDS)]
    monkeypatch.setattr(depth_range, "judges", lambda: (bodies, images, truth))
    ranked = {name: np.linspace(0, 1, len(bodies)) for name in depth_range.MEASURES}
    monkeypatch.setattr(depth_range, "ranked", lambda _: ranked)
    begun = {}
    fit = depth_range.training.fit

    def watched(network, pairs, *given, **named):
        images, targets = pairs[torch.arange(len(pairs))]
        start = network(images).detach()
        begun[pairs.scale] = float(losses(start, targets)[0] / targets[:, 0].var()), start[:, 1]
        return fit(network, pairs, *given, **named)

    monkeypatch.setattr(depth_range.training, "fit", watched)
    for targets in (depth_range.PLAIN, depth_range.NEW, depth_range.NEW):
        depth_range.go_on(tmp_path / "results", targets)
    (plain, (loss, mask)), (stretched, (loss_of_stretched, mask_of_stretched)) = begun.items()
    assert plain == DepthScale() and stretched.factor > 1
    assert max(loss, loss_of_stretched) < 1  # a constant depth would be worse
    torch.testing.assert_close(mask, mask_of_stretched, rtol=0, atol=0)
    scores = pd.read_csv(depth_range.SCORES)
    assert len(scores) == 2 * 6 * len(BUILDS)
    assert scores["setting"].nunique() == 2 * 6
    for targets, scale in ((depth_range.PLAIN, plain), (depth_range.NEW, stretched)):
        folder = tmp_path / "results" / "models" / "people-fold-0" / f"as_printed-{targets}"
        card = json.loads((folder / CARD).read_text())
        assert card["depth_scale"] == {"mean": scale.mean, "factor": scale.factor}
        assert (card["schedule"]["early_epochs"], card["schedule"]["epochs"]) == (0, 2)
        assert card["schedule"]["stretch_depth"] == (targets == depth_range.NEW)
        assert card["starts_from"].startswith(read_card(printed).digest)
        assert not (folder / CHECKPOINT).exists()


def test_a_view_whose_prediction_is_empty_scores_nothing(depth_range, monkeypatch):
    bodies = ["a", "a", "b", "b"]
    monkeypatch.setattr(depth_range, "judges", lambda: (bodies, [], []))
    random = np.random.default_rng(0)
    predictions = []
    for _ in bodies:
        depth = 0.5 + 0.1 * torch.from_numpy(random.random((32, 32)))
        mask = torch.zeros_like(depth)
        mask[8:24, 8:24] = 1
        predictions.append(torch.stack([depth, mask]))
    predictions[1][1] = 0
    found = depth_range.ranked(predictions)
    assert found["NN"][1] == found["DCG"][1] == 0
    assert found["NN"][0] == 0 < found["DCG"][0]  # the only other view of its body ranks last


def test_frames_are_judged_by_their_command_as_their_page_says():
    command = [sys.executable, "-m", "results.experiments.depth_frames", "judge"]
    done = subprocess.run(
        command, cwd=FOLDER.parents[1], capture_output=True, text=True, check=True
    )
    said = {}
    for block in done.stdout.replace("\n  ", "|").splitlines():
        kind, *of_codes = block.split("|")
        said[kind.removesuffix(":")] = of_codes[-1]
    page = (FOLDER / "README.md").read_text()
    assert "| rows | .231, .0064 | .014, .0017 | repaired |" in page
    assert said["rows"].endswith("repaired True")
    assert "| resized, box | .742, .0101 | .182, .0104 | not repaired |" in page
    assert said["resized, box"].endswith("repaired False")
    assert "| none | | .035, .0040 | moves too far |" in page
    assert said["none"].endswith("moves too far True")
    assert said["repeat"].endswith("wrong in silence 0")


@pytest.mark.parametrize("name", ["sensitivity", "other_meshes"])
def test_no_table_is_made_before_all_rows_have_run(name, monkeypatch, tmp_path):
    """Of the first method, one row of each data set has run."""
    monkeypatch.syspath_prepend(str(FOLDER))
    module = importlib.import_module(name)
    scored = {"NN": 1.0, "FT": 1.0, "ST": 1.0, "DCG": 1.0}

    def record(data, method):
        facts = {"input": "mesh", "status": "ok", "scorer": "cm-bof", "seed": 0, "scores": scored}
        facts |= {"labels": ["a", "a"], "per_query": {key: [1.0, 1.0] for key in scored}}
        draws = dict.fromkeys(scored, 0.0)
        return SimpleNamespace(
            data=SimpleNamespace(name=data), gallery=data, method=method, draw_errors=draws, **facts
        )

    if name == "sensitivity":
        method = "sd-gdm"
        ran = [method, next(module.variants(method))[0]]
        found = [record(data, row) for data in module.DATA for row in ran]
    else:
        found = [record("copy", method) for method in module.METHODS]
    monkeypatch.setattr(module, "read_records", lambda *_, **__: found)
    monkeypatch.setattr(module, "TABLE", tmp_path / "table.csv")
    with pytest.raises(SystemExit, match="these rows have not run: "):
        module.judge(tmp_path)
    assert not (tmp_path / "table.csv").exists()


def test_weights_are_judged_by_rows_of_one_scorer_and_seed(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    module = importlib.import_module("sensitivity")
    facts = {"gallery": "tosca", "input": "mesh", "status": "ok", "method": "gps"}
    of_tables = SimpleNamespace(**facts, scorer="cm-bof", seed=0)
    others = [
        SimpleNamespace(**facts, scorer="spherical-harmonics", seed=0),
        SimpleNamespace(**facts, scorer="cm-bof", seed=1),
    ]
    monkeypatch.setattr(module, "read_records", lambda _: [of_tables, *others])
    assert module.records_of(FOLDER, "tosca") == [of_tables]
