"""What may be wrong with an official set, and how it is told."""

from tests.datasets.official.layouts import cla, listing, tetrahedron


def move(folder, old, new):
    (folder / old).rename(folder / new)


def relist(folder, change, name="test.cla"):
    text = (folder / "test.cla").read_text()
    (folder / "test.cla").unlink()
    (folder / name).write_text(change(text))


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
    "one shape twice": (
        "faust",
        lambda f: (f / "tr_reg_007.ply").write_text(tetrahedron(".ply", 9)),
        "holds one shape as tr_reg_007.ply and training/registrations/tr_reg_007.ply; keep one",
    ),
    "zeros": ("shrec14-synthetic", lambda f: (f / "007.obj").touch(), "holds one shape as (7|007).obj and (7|007).obj"),
    "a missing model": (
        "shrec11",
        lambda f: (f / "T137.off").unlink(),
        "test.cla lists 600 models for 599 meshes: there is no T137; unpack",
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
    "a class of the cuts": (
        "shrec16-cuts",
        lambda f: [p.unlink() for p in f.glob("*wolf*")],
        "holds no shape of class 'wolf', cuts_wolf_shape_1",
    ),
}


def moved(text, source, target):
    """Move the first model of one class to the end of another."""
    words = [block.split() for block in text.split("\n\n")]
    classes = {block[0]: [int(word) for word in block[3:]] for block in words[1:]}
    classes[target].append(classes[source].pop(0))
    return cla(classes)
