"""Differences between records, counted by hand."""

from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.pipeline.storage.records import Records
from benchmark.report.comparison import compare_methods, lines
from tests.records import failed, record

LATER = "2026-02-01T00:00:00+00:00"


def scored(nn, dcg, shapes=("cat0", "cat1", "dog0", "dog1"), **more):
    """A record whose queries have these NN and DCG, and FT and ST of one half."""
    halves = [0.5] * len(shapes)
    queries = {"NN": nn, "FT": halves, "ST": halves, "DCG": dcg}
    means = {name: sum(v for v in values if v is not None) / len(values) for name, values in queries.items()}
    labels = [shape[:3] for shape in shapes]
    return record(per_query=queries, scores=means, shapes=list(shapes), labels=labels, n_shapes=len(shapes), **more)


FIRST = scored([1.0, 0.0, 1.0, 1.0], [0.9, 0.5, 0.8, 1.0])
# By hand: cat1 is better in both, dog0 worse in DCG alone, dog1 differs by less than a record holds, cat0 not at all.
SECOND = scored([1.0, 1.0, 1.0, 1.0], [0.9, 0.7, 0.6, 1.0 - 4e-7], finished=LATER, code="2")


def compared(first, second):
    """The comparison of two records as those of two methods."""
    records = ({**first, "method": "a", "key": "1" * 32}, {**second, "method": "b", "key": "2" * 32})
    return compare_methods(records, "a", "b")


def test_changed_queries_are_counted():
    (found,) = compared(FIRST, SECOND).differences
    assert (found.changed, len(found.gains)) == (2, 4)
    assert found.measures.loc["NN", ["first", "second"]].tolist() == [0.75, 1.0]
    head, nn, ft, _, dcg, few, equal, legend = lines(compared(FIRST, SECOND), "a", "b")
    assert head == "rods mesh: 2 of 4 queries changed, 1 better, 1 worse in DCG"
    # One query of a cat is better: of two classes drawn anew, both, one or none is that of cats.
    assert nn == "  NN   0.750 -> 1.000  +0.250  (+0.000 to +0.500)  p 1.0000  classes 1.0000"
    assert ft == "  FT   0.500 -> 0.500  +0.000  (+0.000 to +0.000)  p 1.0000  classes 1.0000"
    assert dcg == "  DCG  0.800 -> 0.800  +0.000  (-0.100 to +0.100)  p 1.0000  classes 1.0000"
    assert few == "  with 2 classes, no p over classes is below 0.5000, so they say nothing about other subjects"
    assert equal == "0 of 1 pairs are equal"
    assert "resampled classes" in legend


def test_galleries_of_one_name_without_a_common_shape_are_not_compared():
    other = scored([1.0] * 4, [1.0] * 4, shapes=("cat8", "cat9", "dog8", "dog9"))
    found = compared(FIRST, other)
    assert (found.differences, found.only_first, found.only_second) == ((), *[("rods mesh",)] * 2)


def test_a_record_equals_itself_and_its_like():
    again = compared(FIRST, {**FIRST, "finished": LATER})
    assert lines(again, "a", "b") == ["1 of 1 pairs are equal"]


def test_two_methods_are_compared_wherever_both_have_scores():
    records = [
        FIRST,
        {**SECOND, "method": "gps", "key": "1" * 32},
        {**SECOND, "method": "gps", "key": "2" * 32, "gallery": "cones"},
        failed(gallery="cones"),
    ]
    found = compare_methods(records, "classic-mds", "gps")
    assert [pair.where for pair in found.differences] == ["rods mesh"]
    assert found.differences[0].changed == 2
    assert (found.only_first, found.only_second) == ((), ("cones mesh",))


def test_seeds_are_compared_each_with_itself():
    def seeded(found, seed):
        return {**found, "recipe": {**found["recipe"], "seed": seed}, "key": f"{seed}" * 32}

    again = seeded(SECOND, 1)
    others = [{**each, "method": "gps"} for each in (again, FIRST)]
    found = compare_methods([FIRST, again, *others], "classic-mds", "gps")
    assert {pair.where: pair.changed for pair in found.differences} == {"rods mesh": 0, "rods mesh seed 1": 0}


def write(folder, *records):
    for found in records:
        Records(folder / "runs" / "records").write(found)


def test_the_verb_compares_methods(tmp_path):
    write(tmp_path, FIRST, record("gps"))
    both = CliRunner().invoke(cli, ["compare", "classic-mds", "gps", "--results", str(tmp_path)])
    assert both.output.startswith("rods mesh: ")
    assert "  NN   0.750 -> 0.750  +0.000" in both.output


def test_the_better_method_is_named_with_what_that_holds_for():
    shapes = [f"{animal}{pose}" for animal in "abcdefgh" for pose in range(3)]
    first, second = (
        record(
            per_query={name: [value] * 24 for name in ("NN", "FT", "ST", "DCG")},
            scores=dict.fromkeys(("NN", "FT", "ST", "DCG"), value),
            shapes=shapes,
            labels=[shape[0] for shape in shapes],
            n_shapes=24,
        )
        for value in (0.4, 0.6)
    )
    said = lines(compared(first, second), "old", "new")
    assert said[1].endswith("p 0.0001  classes 0.0078  new is better for other poses and other subjects")
    assert not any("nothing can be said" in line for line in said)
