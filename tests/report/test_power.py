"""Numbers of classes or seeds that would tell two methods apart, where the answer is known."""

import numpy as np
import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from benchmark.report.comparison import compare_folders, compare_methods, lines
from benchmark.report.statistics.power import power_of
from benchmark.storage.keys import digest
from benchmark.storage.records import Records
from tests.records import MEASURES, record

HIT = 1e6


def test_the_size_for_a_known_binomial_difference_is_that_of_the_formula():
    # Connor, Biometrics 43, 1987: (1.96 sqrt(d) + .8416 sqrt(d - e^2))^2 / e^2 pairs for shares .3 and .1 that differ,
    # d = .4 and e = .2: 76.1; for .6 and .1, d = .7 and e = .5: 20.9.
    for better, worse, pairs in ((30, 10, 76.1), (60, 10, 20.9)):
        differences = np.repeat([HIT, -HIT, 0.0], [better, worse, 100 - better - worse])
        found = power_of(differences, range(100))
        assert found.needed == pytest.approx(pairs, rel=0.15)
        assert found.now > 0.8
        # Ten pictures of each subject tell no more than one.
        assert power_of(np.repeat(differences, 10), np.repeat(np.arange(100), 10).tolist()) == found


def test_the_size_for_a_known_normal_difference_is_that_of_the_formula():
    # Half a standard deviation: 34 pairs of a t test.
    values = np.random.default_rng(1).standard_normal(500)
    values = (values - values.mean()) / values.std() + 0.5
    assert power_of(np.rint(HIT * values), range(500)).needed == pytest.approx(34, rel=0.15)


def test_equal_rows_are_told_apart_by_no_number_and_few_units_by_none_of_their_own():
    assert power_of(np.zeros(9), range(9)).needed is None
    even = power_of(np.array([HIT, -HIT] * 50), range(100))
    assert even.needed is None
    assert even.now < 0.08  # the level of the test
    three = power_of(np.full(3, HIT), range(3))
    assert (three.now, three.needed) == (0.0, 6)  # of six exchanges 2 in 64 are as large, of five 2 in 32


def made(method, values, seed=0, **more):
    """A record of twelve classes of two queries each, NN of the queries as given."""
    labels = [f"c{k // 2}" for k in range(24)]
    per_query = {name: [0.5] * 24 for name in MEASURES} | {"NN": list(values)}
    scores = {name: sum(each) / 24 for name, each in per_query.items()}
    whole = {"shapes": [f"s{k}" for k in range(24)], "labels": labels, "n_shapes": 24, "n_classes": 12}
    found = record(method, per_query=per_query, scores=scores, **whole, **more)
    found["recipe"] = found["recipe"] | {"seed": seed}
    return found | {"key": digest(found["recipe"])}


def said(*records, **options):
    return lines(compare_methods(records, "gps", "pca", power=True, **options), "gps", "pca")


def test_the_answer_is_told_in_classes_and_shapes():
    head, nn, ft, *_, equal, _, legend = said(made("gps", [0.0] * 24), made("pca", [1.0, 1.0, 0.0] * 8))
    assert head.startswith("rods mesh: 16 of 24 queries changed")
    # Each pair of queries has a hit: twelve classes are six more than the test needs.
    assert nn.endswith("power 1.00, 0.80 with 6 classes (12 shapes)")
    assert ft.endswith("power 0.00, 0.80 with more than 1000 classes")
    assert equal == "0 of 1 pairs are equal"
    assert "Power: share of samples" in legend
    assert "power" not in " ".join(lines(compare_methods([made("gps", [0.0] * 24)], "gps", "gps"), "a", "b"))


def test_equal_rows_have_an_answer_and_two_classes_none():
    same = [made(name, [1.0, 0.0] * 12) for name in ("gps", "pca")]
    assert "with more than 1000 classes" in said(*same)[1]
    assert said(record("gps"), record("pca", nn=0.5))[1].endswith("power unknown from 2 classes")


def test_seeds_are_drawn_where_both_have_three():
    trainings = [
        made(name if seed == 0 else f"{name}[training_seed={seed}]", [float(k < 12 + good) for k in range(24)],
             parameters={"training_seed": seed} if seed else {})
        for seed in range(3) for name, good in (("gps", 0), ("pca", 2 + seed))
    ]  # fmt: skip
    text = said(*trainings)
    at = next(k for k, line in enumerate(text) if line.startswith("rods mesh over 3 seeds: 3 of 3 seeds changed"))
    assert text[at + 1].startswith("  NN   0.500 -> 0.625  +0.125")
    assert text[at + 1].endswith("power 0.00, 0.80 with 6 seeds")
    assert not any("over" in line and "seeds:" in line for line in said(*trainings[:4]))
    runs = [[made("gps", [value] * 24, seed) for seed in range(3)] for value in (0.0, 1.0)]
    (found,) = compare_folders(*runs, power=True).seeds
    assert found.where == "rods mesh gps over 3 seeds"


def test_the_verb_has_the_option(tmp_path):
    for each in (made("gps", [0.0] * 24), made("pca", [1.0] * 24)):
        Records(tmp_path / "runs" / "records").write(each)
    told = CliRunner().invoke(cli, ["compare", "gps", "pca", "--power", "--results", str(tmp_path)])
    assert told.exit_code == 0, told.output
    assert "0.80 with 6 classes (12 shapes)" in told.output
    for others in (["cm-bof", "spherical-harmonics"], ["gps", "pca", "--digests"]):
        refused = CliRunner().invoke(cli, ["compare", *others, "--power", "--results", str(tmp_path)])
        assert isinstance(refused.exception, ConfigurationError)
