import json
import re
from collections import Counter
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmark.cli.data import data
from benchmark.datasets.canonical import canonical_entry
from benchmark.datasets.catalogue import CATALOGUE, open_dataset
from benchmark.datasets.checking import check_source
from benchmark.datasets.official.layouts import members_digest
from benchmark.datasets.official.sets import EXTENDED, SETS, SHREC10_CLASSES, SHREC11_CLASSES
from benchmark.datasets.official.tosca import CLASS_SIZES
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.protocols.tables import galleries
from retrieval.chance import chance_levels
from tests.datasets.official_layouts import LISTED, NAMED, cla, class_of, copy, listing, make, tetrahedron
from tests.datasets.official_layouts import with_made_members as made_members
from tests.toy import RADII, rod, write_off


@pytest.fixture(scope="session")
def sets(tmp_path_factory):
    """All official sets in their layouts, made once; no test may write to them."""
    root = tmp_path_factory.mktemp("official")
    for name in SETS:
        make(name, root)
    return root


@pytest.fixture(autouse=True)
def _made_lists(monkeypatch):
    for name in ("shrec10", "shrec11"):
        monkeypatch.setitem(SETS, name, made_members(SETS[name]))


@pytest.fixture
def damaged(sets, tmp_path):
    """Copies a set so that it can be damaged; returns its folder, below a data root of its own."""
    return lambda name: copy(sets / SETS[name].folder, tmp_path / SETS[name].folder)


#: Set, shapes, classes, shapes of each class, and one shape with its subject and pose.
SIZES = [
    ("shrec14-synthetic", 300, 15, 20, ("219", "10", "19")),
    ("shrec14-real", 400, 40, 10, ("399", "39", "9")),
    ("shrec07", 400, 20, 20, ("386", "fourleg", "5")),
    ("shrec10", 200, 10, 20, ("T13", "official-class1", "T13")),
    ("shrec11", 600, 30, 20, ("T599", "official-class23", "T599")),
    ("shrec12-generic", 1200, 60, 20, ("D00061", "class7", "D00061")),
    ("shrec15", 1200, 50, 24, ("T1200", "class0", "T1200")),
    ("shrec15-canonical", 100, 10, 10, ("9", "class3", "9")),
    ("shrec16-cuts", 24, 8, 3, ("cuts_dog_shape_2", "dog", "2")),
    ("shrec16-holes", 24, 8, 3, ("holes_wolf_shape_3", "wolf", "3")),
    ("faust", 100, 10, 10, ("tr_reg_037", "3", "7")),
    ("kids", 32, 2, 16, ("0002.isometry.11", "0002", "11")),
    ("topkids", 26, 1, 26, ("kid25", "kid", "25")),
    ("scape", 71, 1, 71, ("mesh071", "scape", "71")),
]


def test_every_set_is_tested():
    assert [name for name, *_ in SIZES] == list(SETS)
    assert {*NAMED, *LISTED} == set(SETS)


@pytest.mark.parametrize(("name", "n_shapes", "n_classes", "n_poses", "example"), SIZES)
def test_a_set_in_its_layout_has_its_shapes_and_labels(sets, name, n_shapes, n_classes, n_poses, example):
    dataset = open_dataset(name, sets)
    sizes = Counter(entry.subject for entry in dataset.entries)
    assert (len(dataset.entries), len(sizes), set(sizes.values())) == (n_shapes, n_classes, {n_poses})
    assert len({entry.identifier for entry in dataset.entries}) == len({e.path for e in dataset.entries}) == n_shapes
    (entry,) = [entry for entry in dataset.entries if entry.identifier == example[0]]
    assert (entry.subject, entry.pose) == example[1:]
    assert entry.path.stem == example[0]
    assert dataset.load(entry).n_faces == 4
    known = CATALOGUE[name]
    assert (known.n_shapes or n_shapes, known.n_classes) == (n_shapes, n_classes)


def test_the_order_is_that_of_the_numbers(sets):
    assert [e.identifier for e in open_dataset("shrec11", sets).entries][9:12] == ["T9", "T10", "T11"]
    assert [e.identifier for e in open_dataset("shrec07", sets).entries][9:12] == ["10", "11", "12"]
    cuts = [e.identifier for e in open_dataset("shrec16-cuts", sets).entries]
    assert cuts[2:5] == ["cuts_cat_shape_3", "cuts_centaur_shape_1", "cuts_centaur_shape_2"]


def test_classes_of_the_watertight_set_by_their_numbers(sets):
    by_number = {entry.identifier: entry.subject for entry in open_dataset("shrec07", sets).entries}
    assert [by_number[n] for n in ("1", "20", "21", "261", "280", "281", "400")] == [
        *("human", "human", "cup", "spring", "spring", "armadillo", "fourleg")
    ]


def test_the_digests_are_those_of_the_official_lists():
    # Two classes of each list, as the tracks gave them out.
    crabs = (49, 15, 154, 83, 144, 26, 181, 139, 56, 82, 161, 9, 3, 187, 166, 156, 68, 162, 128, 19)
    teddy = (134, 54, 40, 185, 35, 105, 199, 13, 36, 137, 100, 46, 106, 130, 118, 29, 34, 10, 107, 33)
    assert [SHREC10_CLASSES[members_digest(numbers)] for numbers in (crabs, teddy)] == ["crabs", "teddy"]
    alien = (137, 30, 50, 124, 290, 5, 422, 545, 411, 9, 511, 311, 31, 547, 418, 573, 220, 133, 18, 228)
    woman = (345, 581, 22, 147, 503, 585, 586, 461, 89, 294, 521, 332, 592, 381, 395, 238, 410, 36, 580, 534)
    assert [SHREC11_CLASSES[members_digest(numbers)] for numbers in (alien, woman)] == ["alien", "woman"]
    assert (len(SHREC10_CLASSES), len(SHREC11_CLASSES)) == (10, 30)


def test_cameras(sets):
    up = {name: open_dataset(name, sets) for name in ("faust", "shrec16-cuts", "shrec11")}
    assert up["faust"].camera(up["faust"].entries[0]) == Camera((0, 0, -1), (0, 1, 0))
    cuts = {entry.subject: up["shrec16-cuts"].camera(entry) for entry in up["shrec16-cuts"].entries}
    assert (cuts["horse"], cuts["david"]) == (SIDE, FRONT)
    assert up["shrec11"].camera(up["shrec11"].entries[0]) == FRONT


def test_saying_that_faust_stands_along_y_changes_nothing(sets, damaged):
    folder = damaged("faust")
    (folder / "dataset.toml").write_text('up = "y"\ncanonical_pose = 3\n')
    dataset = open_dataset("faust", folder.parent)
    assert dataset.camera(dataset.entries[0]) == Camera((0, 0, -1), (0, 1, 0))
    assert canonical_entry(dataset, "2").identifier == "tr_reg_023"
    (folder / "dataset.toml").write_text('camera = "side"\nup = "y"\n')
    dataset = open_dataset("faust", folder.parent)
    assert dataset.camera(dataset.entries[0]) == Camera((1, 0, 0), (0, 1, 0))


def test_canonical_poses_are_the_null_shapes(sets):
    for name, subject, identifier in (
        ("kids", "0002", "0002.null.0"),
        ("topkids", "kid", "kid00"),
        ("shrec14-real", "3", "30"),
    ):
        assert canonical_entry(open_dataset(name, sets), subject).identifier == identifier


def move(folder, old, new):
    (folder / old).rename(folder / new)


def relist(folder, change, name="test.cla"):
    text = (folder / "test.cla").read_text()
    (folder / "test.cla").unlink()
    (folder / name).write_text(change(text))


def duplicate(folder, file, of):
    (folder / file).unlink()
    (folder / file).write_bytes((folder / of).read_bytes())


def shift(folder, pattern, numbers, step):
    for n in sorted(numbers, reverse=step > 0):
        move(folder, pattern.format(n), pattern.format(n + step))


FIRST = cla(listing(30, 20)).split()[6]  # the first number of the first class

FAULTS = {
    "a missing file": (
        "shrec07",
        lambda f: (f / "7.off").unlink(),
        "holds 399 shapes, not the official 400: shape '7' is missing",
    ),
    "a file too many": (
        "shrec07",
        lambda f: (f / "401.off").write_text(tetrahedron(".off", 9)),
        "holds 401 shapes, not the official 400: 401.off is one too many; unpack the official archive",
    ),
    "files from 0": ("shrec07", lambda f: shift(f, "{}.off", range(1, 401), -1), "begin with 0: add 1 to each"),
    "files from 1": ("shrec14-real", lambda f: shift(f, "{}.obj", range(400), 1), "begin with 1: subtract 1 from each"),
    "one shape twice": (
        "faust",
        lambda f: (f / "tr_reg_007.ply").write_text(tetrahedron(".ply", 9)),
        "holds one shape as tr_reg_007.ply and training/registrations/tr_reg_007.ply; keep one",
    ),
    "zeros": ("shrec14-synthetic", lambda f: (f / "007.obj").touch(), "holds one shape as (7|007).obj and (7|007).obj"),
    "a copied file": ("kids", lambda f: duplicate(f, "0001.isometry.3.off", "0002.null.0.off"), "is a copy of"),
    "a copy in a list": ("shrec10", lambda f: duplicate(f, "T3.off", "T9.off"), "T9.off is a copy of T3.off; fetch"),
    "no scan 51": (
        "scape",
        lambda f: move(f, "mesh003.ply", "mesh051.ply"),
        "holds 71 .* shape 'mesh003' is missing, mesh051.ply is one",
    ),
    "a null shape": (
        "kids",
        lambda f: (f / "0002.null.0.off").unlink(),
        "holds 31 .* 32: shape '0002.null.0' is missing",
    ),
    "topology": ("topkids", lambda f: (f / "off" / "kid25.off").unlink(), "holds 25 .* 26: shape 'kid25' is missing"),
    "nothing": (
        "faust",
        lambda f: [p.unlink() for p in f.rglob("*.ply")],
        "holds 0 .* 100: shape 'tr_reg_000' is missing",
    ),
    "nothing listed": (
        "shrec15",
        lambda f: [p.unlink() for p in f.rglob("*.off")],
        "test.cla lists 1200 models for 0 meshes: there is no T1;",
    ),
    "a missing model": (
        "shrec11",
        lambda f: (f / "T137.off").unlink(),
        "test.cla lists 600 models for 599 meshes: there is no T137; unpack",
    ),
    "an unlisted model": (
        "shrec11",
        lambda f: (f / "T600.off").write_text(tetrahedron(".off", 9)),
        "test.cla lists 600 models for 601 meshes: T600.off is extra",
    ),
    "a list from 1": (
        "shrec11",
        lambda f: relist(f, lambda _: cla(listing(30, 20, first=1))),
        "there is no T600; the numbers begin with 0: add 1 to each, or shift the list",
    ),
    "no list": ("shrec11", lambda f: (f / "test.cla").unlink(), "holds no list of classes; put the official .cla file"),
    "two lists": (
        "shrec10",
        lambda f: relist(f, str, "sub.cla") or (f / "test.cla").touch(),
        "holds sub.cla and test.cla",
    ),
    "a label moved": (
        "shrec15",
        lambda f: relist(f, lambda text: moved(text, "class4", "class5")),
        "class '(class4' of .* has 23|class5' of .* has 25) models, not the official 24; fetch the official list",
    ),
    "two labels exchanged": (
        "shrec11",
        lambda f: relist(f, lambda text: moved(moved(text, "class4", "class5"), "class5", "class4")),
        "classes 'class4', 'class5' of .*test.cla do not hold their official models; fetch",
    ),
    "a class too few": (
        "shrec12-generic",
        lambda f: relist(f, lambda _: cla(listing(30, 40, first=1))),
        "test.cla has 30 classes, not the official 60",
    ),
    "no list at all": ("shrec10", lambda f: relist(f, lambda text: text[4:]), "does not start with 'PSB 1'"),
    "labels of a numbered set": (
        "shrec07",
        lambda f: (f / "test.cla").write_text(cla(blocks(1, 20, exchanged=(20, 21)))),
        "puts model (20|21) into class 'c(0|1)', but it shows subject '(human|cup)'",
    ),
    "a list of a numbered set from 0": (
        "shrec07",
        lambda f: (f / "test.cla").write_text(cla(blocks(0, 20))),
        "does not list models 1 to 400; the numbers begin with 0: add 1 to each",
    ),
    "two names of one subject": (
        "shrec14-real",
        lambda f: (f / "test.cla").write_text(cla(blocks(0, 5))),
        "puts model 5 into class 'c1', but it shows subject '0'",
    ),
    "a class of the cuts": (
        "shrec16-cuts",
        lambda f: [p.unlink() for p in f.glob("*wolf*")],
        "holds no shape of class 'wolf', cuts_wolf_shape_1",
    ),
}


def blocks(first, n_poses, exchanged=()):
    """Classes of 400 models, n_poses each, perhaps two of them exchanged."""
    order = list(range(first, first + 400))
    if exchanged:
        one, other = (number - first for number in exchanged)
        order[one], order[other] = order[other], order[one]
    return {f"c{k}": order[k * n_poses : (k + 1) * n_poses] for k in range(400 // n_poses)}


def moved(text, source, target):
    """Move the first model of one class to the end of another."""
    words = [block.split() for block in text.split("\n\n")]
    classes = {block[0]: [int(word) for word in block[3:]] for block in words[1:]}
    classes[target].append(classes[source].pop(0))
    return cla(classes)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_set_that_is_not_as_it_was_given_out_is_named(damaged, tmp_path, fault):
    name, damage, message = FAULTS[fault]
    folder = damaged(name)
    damage(folder)
    with pytest.raises(DatasetError, match=message):
        open_dataset(name, tmp_path)


def test_a_list_that_agrees_with_the_numbers_changes_nothing(sets, damaged, tmp_path):
    for name, first, n_poses in (("shrec07", 1, 20), ("shrec14-real", 0, 10)):
        (damaged(name) / "test.cla").write_text(cla(blocks(first, n_poses)))
        labels = [(entry.identifier, entry.subject) for entry in open_dataset(name, tmp_path).entries]
        assert labels == [(entry.identifier, entry.subject) for entry in open_dataset(name, sets).entries]


def test_the_list_may_be_called_categories(sets, damaged, tmp_path):
    relist(damaged("shrec11"), str, "categories.txt")
    labels = [entry.subject for entry in open_dataset("shrec11", tmp_path).entries]
    assert labels == [entry.subject for entry in open_dataset("shrec11", sets).entries]


def test_folders_of_classes_take_the_place_of_the_list(sets, damaged, tmp_path):
    folder = damaged("shrec11")
    (folder / "test.cla").unlink()
    for number in range(600):
        place = folder / "shrec_16" / f"beast{class_of(number, 30)}" / ("test" if number % 5 == 0 else "train")
        place.mkdir(parents=True, exist_ok=True)
        move(folder, f"T{number}.off", place / f"T{number}.off")
    dataset, listed = open_dataset("shrec11", tmp_path), open_dataset("shrec11", sets)
    assert [(e.identifier, e.subject) for e in dataset.entries] == [(e.identifier, e.subject) for e in listed.entries]
    # 31 and 1 are of one class; 32 is not.
    path = dataset.entries[32].path
    path.rename(dataset.entries[1].path.with_name("T32.off"))
    with pytest.raises(DatasetError, match="class 'beast[0-9]+' of .*shrec11 has (19|21) models, not the official 20"):
        open_dataset("shrec11", tmp_path)


def test_unreadable_files_cost_their_shapes_and_not_the_set(damaged, tmp_path):
    folder = damaged("kids")
    for file in ("0001.null.0.off", "0002.null.0.off"):
        (folder / file).unlink()
        (folder / file).touch()
    assert len(open_dataset("kids", tmp_path).entries) == 32
    report = check_source("kids", tmp_path)
    assert [a.file for a in report.anomalies if a.severity == "error"] == ["0001.null.0.off", "0002.null.0.off"]


def test_the_made_sets_pass_their_check(sets):
    for name in ("shrec07", "faust"):
        report = check_source(name, sets)
        assert report.anomalies == ()
        assert report.n_shapes == SETS[name].layout.n_shapes


def test_a_set_of_one_subject_says_what_it_is_for(sets):
    done = CliRunner().invoke(data, ["check", "scape", "--data-root", str(sets)])
    assert done.exit_code == 0, done.output
    assert "data set 'scape' shows one subject, so nothing can be retrieved; use it with canonicalise" in done.output
    with pytest.raises(DatasetError, match="'topkids' shows one subject, so nothing can be retrieved; use it with"):
        galleries([], ["topkids"], sets)


@pytest.mark.parametrize("fault", ["a missing file", "a copied file"])
def test_the_check_names_what_is_wrong_and_still_reads_the_meshes(damaged, tmp_path, fault):
    name, damage, message = FAULTS[fault]
    damage(damaged(name))
    done = CliRunner().invoke(data, ["check", name, "--data-root", str(tmp_path)])
    assert done.exit_code == 1
    (error,) = [line for line in done.output.splitlines() if line.startswith("error")]
    assert re.search(message, error)
    assert "vertices    4 to 4" in done.output


def test_an_absent_set_says_where_it_is_wanted_and_where_it_comes_from(tmp_path):
    with pytest.raises(DatasetError, match="'faust' is not at .*/faust; put it there .* http://faust.is.tue.mpg.de"):
        open_dataset("faust", tmp_path)


def test_the_extended_table_is_made_for_every_set_that_is_here(sets, tmp_path):
    assert set(EXTENDED) == set(SETS) - {"shrec14-synthetic", "shrec14-real", "topkids", "scape"}
    chosen = galleries(["extended"], data_root=sets)
    assert [(gallery.table.identifier, gallery.name) for gallery in chosen] == [("extended", name) for name in EXTENDED]
    make("kids", tmp_path)
    (kids,) = galleries(["extended"], data_root=tmp_path)
    assert (kids.dataset.name, len(kids.entries)) == ("kids", 32)
    assert [gallery.table.identifier for gallery in galleries([], ["kids"], tmp_path)] == ["extended"]
    assert "extended" in {gallery.table.identifier for gallery in galleries(data_root=tmp_path)}
    (thin,) = galleries(["extended"], data_root=tmp_path, quick=True)
    assert (thin.name, len(thin.entries)) == ("kids (quick)", 8)


def test_the_extended_table_without_data_names_its_sets(tmp_path):
    with pytest.raises(DatasetError) as caught:
        galleries(["extended"], data_root=tmp_path)
    assert all(f"{name} ({SETS[name].folder}/)" in caught.value.problem for name in EXTENDED)
    assert "extended" not in {gallery.table.identifier for gallery in galleries(data_root=tmp_path)}


def test_a_broken_set_is_named_before_long_work(damaged, tmp_path):
    name, damage, message = FAULTS["a missing file"]
    damage(damaged(name))
    with pytest.raises(DatasetError, match=message):
        galleries(["extended"], data_root=tmp_path)


def test_the_list_fits_a_terminal_and_names_where_sets_belong(sets, tmp_path):
    (tmp_path / "kids").mkdir()
    lines = CliRunner().invoke(data, ["list"], env={"CANONICAL_FORMS_DATA": str(tmp_path)}).output.splitlines()
    assert lines[0].split() == ["name", "state", "shapes", "classes", "source"]
    assert max(map(len, lines)) <= 80
    by_name = {line.split()[0]: line for line in lines}
    assert re.search(r"not at shrec07 +400 +20 +IMATI", by_name["shrec07"])
    assert re.search(r"present +32 +2 +TU Munich", by_name["kids"])
    rows = json.loads(CliRunner().invoke(data, ["list", "--json"]).output)
    assert all(row["url"].startswith("http") and row["terms"] for row in rows if row["kind"] == "official")


ROOT = Path(__file__).parents[2]


def test_every_set_has_its_line_in_the_documentation(sets):
    """Name, folder, shapes, classes and chance level of the table in docs/data.md."""

    def printed(subjects):
        levels = chance_levels(subjects)
        return " ".join(f"{levels[measure]:.3f}" for measure in ("NN", "FT", "ST", "DCG"))

    text = (ROOT / "docs" / "data.md").read_text()
    for name, known in SETS.items():
        (line,) = re.findall(rf"^\| `{name}` \|.*$", text, re.M)
        _, _, folder, shapes, classes, chance, *_ = (cell.strip() for cell in line.split("|"))
        assert folder == f"`{known.folder}/`"
        layout = known.layout
        assert (shapes, classes) == (str(layout.n_shapes or "?"), str(layout.n_classes))
        if known.other_use or layout.n_shapes is None:
            assert chance == "-"
            continue
        assert chance == printed([entry.subject for entry in open_dataset(name, sets).entries])
    assert f"| {printed([subject for subject, n in CLASS_SIZES.items() for _ in range(n)])} | `cat0.off`" in text


def test_every_set_is_cited():
    entries = (ROOT / "benchmark" / "reference" / "references.bib").read_text()
    assert [name for name, known in SETS.items() if not re.search(rf"^@\w+{{{known.citation},$", entries, re.M)] == []


@pytest.mark.slow
def test_a_present_set_fills_the_extended_table(tmp_path):
    from tests.cli.test_command_line import benchmark

    for kid, radius in zip(("0001", "0002"), RADII.values(), strict=True):
        for pose in range(16):
            kind = f"isometry.{pose}" if pose else "null.0"
            write_off(tmp_path / "kids" / f"{kid}.{kind}.off", rod(radius, 0.15 * pose))
    arguments = ("-t", "extended", "-m", "identity", "--input", "mesh", "--data-root", tmp_path)
    arguments += ("--results", tmp_path / "results")
    done = benchmark("run", *arguments)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(benchmark("tables", *arguments, "--format", "json").stdout)
    assert (row["table"], row["dataset"], row["n_shapes"], row["status"]) == ("extended", "kids", 32, "ok")
    (tmp_path / "kids" / "0002.isometry.4.off").unlink()
    done = benchmark("plan", *arguments)
    assert done.returncode == 2
    assert "holds 31 shapes, not the official 32: shape '0002.isometry.4' is missing" in done.stderr
