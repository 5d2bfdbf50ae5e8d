"""Data sets of plugin files: opened by name, refused by name, and each fault costs what it must and no more."""

import pytest

from benchmark.datasets.catalogue import open_dataset, sources
from benchmark.datasets.own import data_sets_of, open_own
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, UnreadableMesh
from benchmark.plugins import remote
from benchmark.plugins.inspection import inspect
from tests.toy import write_rods

pytestmark = pytest.mark.usefixtures("forked_workers")

PLUGIN = """
import os, random, time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from benchmark.api.datasets import SIDE, Camera, DatasetInfo, Entry, Mesh
from tests.toy import rod


@dataclass(frozen=True, kw_only=True)
class Rods:
    info: ClassVar[DatasetInfo] = DatasetInfo({info})
    bends: tuple[float, ...] = (0.5, 1.5)

    def entries(self):
        {entries}

    def load(self, entry):
        {load}
{more}
"""

ENTRIES = "return [Entry(f'{s}{n}', s, str(n)) for s in ('thin', 'thick') for n in range(len(self.bends))]"
LOAD = "return rod(0.1 if entry.subject == 'thin' else 0.3, self.bends[int(entry.pose)], 12, 8)"


@pytest.fixture
def plugin(tmp_path):
    def write(info="name='rods', title='Rods'", entries=ENTRIES, load=LOAD, more="", file="rods.py"):
        path = tmp_path / file
        path.write_text(PLUGIN.format(info=info, entries=entries, load=load, more=more))
        return path

    return write


def opened(path):
    (source,) = data_sets_of([path]).values()
    return open_own(source)


def test_a_data_set_is_what_its_class_lists_and_loads(plugin):
    path = plugin()
    (source,) = sources(["rods"], [path])
    dataset = open_dataset(source, None)
    assert (dataset.name, dataset.title, dataset.stand_in_for) == ("rods", "Rods", "")
    assert [entry.identifier for entry in dataset.entries] == ["thin0", "thin1", "thick0", "thick1"]
    thin, thick = dataset.load(dataset.entries[0]), dataset.load(dataset.entries[2])
    assert thick.area > thin.area
    assert dataset.recipe(dataset.entries[0]) == "rods thin0 {'bends': (0.5, 1.5)}"


def test_optional_methods_are_asked(plugin):
    more = "    def camera(self, entry): return SIDE\n    def recipe(self, entry): return 'made in spring'"
    dataset = opened(plugin(more=more))
    assert dataset.camera(dataset.entries[0]).direction == (1.0, 0.0, 0.0)
    assert dataset.recipe(dataset.entries[0]).endswith("made in spring")


def test_meshes_of_files_need_no_load_and_are_known_by_their_content(plugin, tmp_path):
    write_rods(tmp_path / "files")
    entries = "return [Entry(p.stem, p.stem[:-1], p.stem[-1], p) for p in sorted(Path(FOLDER).iterdir())]"
    path = plugin(entries=entries.replace("FOLDER", repr(str(tmp_path / "files"))))
    path.write_text(path.read_text().replace("def load", "def unused"))
    dataset = opened(path)
    assert dataset.load(dataset.entries[0]).n_vertices > 100
    before = [dataset.recipe(entry) for entry in dataset.entries]
    (tmp_path / "files" / "thin0.off").write_bytes((tmp_path / "files" / "thin1.off").read_bytes())
    after = [dataset.recipe(entry) for entry in dataset.entries]
    assert [a == b for a, b in zip(before, after, strict=True)].count(False) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"entries": "return []"}, "it lists no shapes"),
        ({"entries": "return ['thin0']"}, "'entries' lists str; list Entry"),
        ({"entries": "return [Entry('a', 'b', 'c'), Entry('a', 'b', 'd')]"}, "two shapes are called 'a'"),
        ({"entries": "return [Entry('a', '', 'c')]"}, "subject '' is not a text of one line"),
        ({"entries": "return [Entry('a\\nb', 'b', 'c')]"}, "identifier .* is not a text of one line"),
        ({"entries": "return [Entry('a', 'b', 'c', '/x.off')]"}, "path of 'a' is str; pass a pathlib.Path"),
        ({"entries": "return 1 / 0"}, "Rods cannot be opened: ZeroDivisionError: .*correct the file"),
        ({"info": "name='My Rods', title='Rods'"}, "name 'My Rods' is not lower-case words"),
        ({"info": "name='rods', title=''"}, "title is empty; write the text for the tables"),
        ({"info": "name='rods', title='Rods', half_width=-1"}, "half_width is -1; write a positive number"),
        ({"info": "name='humans', title='Humans'"}, "there is a data set 'humans' already; rename"),
    ],
)
def test_what_a_data_set_cannot_be_is_named(plugin, changes, message):
    path = plugin(**changes)
    with pytest.raises(DatasetError, match=message):
        open_dataset(sources(data_sets_of([path]), [path])[0], None)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        ("return None", "shape 'thin0': 'load' returned NoneType; return Mesh"),
        ("return Mesh([[0, 0, float('nan')]], [])", "NaN or infinite"),
        ("raise KeyError('thin')", "shape 'thin0': 'load' raises KeyError: 'thin'; correct the file"),
    ],
)
def test_a_mesh_that_cannot_be_made_costs_its_shape(plugin, load, message):
    dataset = opened(plugin(load=load))
    with pytest.raises(BenchmarkError, match=message) as caught:
        dataset.load(dataset.entries[0])
    assert isinstance(caught.value, UnreadableMesh) or "NaN" in message


def test_an_unknown_name_is_answered_with_those_of_the_file(plugin):
    with pytest.raises(ConfigurationError, match="unknown data set 'rodds'; did you mean rods"):
        sources(["rodds"], [plugin()])


def test_a_file_that_hangs_while_it_lists_its_shapes_is_refused_from_outside(plugin, monkeypatch):
    monkeypatch.setattr(remote, "LIMIT", 1.0)
    with pytest.raises(ConfigurationError, match="does not end: stopped after 1 s"):
        inspect([plugin(entries="time.sleep(3600)")])


# The checks ----------------------------------------------------------------------------------------------------------
