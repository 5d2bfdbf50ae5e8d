"""What may be wrong with an official set, and how it is told."""

from tests.datasets.official.layouts import cla, listing, tetrahedron


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
    "a missing model": (
        "shrec11",
        lambda f: (f / "T137.off").unlink(),
        "test.cla lists 600 models for 599 meshes: there is no T137; unpack",
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
