"""Data sets of plugin files: opened by name, refused by name, and each fault costs what it must and no more."""

import pytest

from benchmark.datasets.catalogue import open_dataset, sources, table_name
from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, UnreadableMesh
from benchmark.geometry.camera import SIDE
from tests.registry.plugin import write_data_set
from tests.toy import write_rods

SHAPES = "tuple(Entry(f'{s}{n}', s, str(n)) for s in ('thin', 'thick') for n in range(2))"
LOAD = "return rod(0.1 if entry.subject == 'thin' else 0.3, 0.5 + int(entry.pose), 12, 8)"


@pytest.fixture
def plugin(tmp_path):
    def write(shapes=SHAPES, load=LOAD, **more):
        return write_data_set(tmp_path / "rods.py", shapes=shapes, load=load, **more)

    return write


def opened(path, name="rods"):
    return open_dataset(sources([name], [path])[0])


def test_a_data_set_is_a_variable_of_its_file(plugin):
    path = plugin(more="camera=lambda entry: SIDE, key=lambda entry: 'made in spring',")
    dataset = opened(path)
    assert (dataset.name, dataset.title, dataset.code) == ("rods", "rods", (str(path),))
    assert [entry.identifier for entry in dataset.shapes] == ["thin0", "thin1", "thick0", "thick1"]
    thin, _, thick, _ = map(dataset.load, dataset.shapes)
    assert thick.area > thin.area
    assert dataset.camera(dataset.shapes[0]) == SIDE
    assert dataset.key(dataset.shapes[0]) == "rods thin0 made in spring"


def test_its_shapes_can_be_changed_as_those_of_any_set(plugin):
    path = plugin()
    changed = opened(path, "rods[noise=2][view-angle=1]")
    assert changed.name == table_name(f"{path}:RODS[noise=2][view-angle=1]") == "rods[noise=2][view-angle=1]"
    assert changed.code == (str(path), "benchmark.datasets.changes")
    assert changed.load(changed.shapes[0]).n_vertices == opened(path).load(changed.shapes[0]).n_vertices


def test_meshes_of_files_need_no_load_and_are_known_by_their_content(plugin, tmp_path):
    write_rods(tmp_path / "files")
    shapes = "tuple(Entry(p.stem, p.stem[:-1], p.stem[-1], p) for p in sorted(Path(FOLDER).iterdir()))"
    path = plugin(shapes=shapes.replace("FOLDER", repr(str(tmp_path / "files"))))
    path.write_text(path.read_text().replace("load=load, ", ""))
    dataset = opened(path)
    assert dataset.load(dataset.shapes[0]).n_vertices > 100
    before = [dataset.key(entry) for entry in dataset.shapes]
    (tmp_path / "files" / "thin0.off").write_bytes((tmp_path / "files" / "thin1.off").read_bytes())
    after = [dataset.key(entry) for entry in dataset.shapes]
    assert [a == b for a, b in zip(before, after, strict=True)].count(False) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shapes": "()"}, "it lists no shapes"),
        ({"shapes": "('thin0',)"}, "'shapes' lists str; list Entry"),
        ({"shapes": "(Entry('a', 'b', 'c'), Entry('a', 'b', 'd'))"}, "two shapes are called 'a'"),
        ({"shapes": "(Entry('a', '', 'c'),)"}, "subject '' is not a text of one line"),
        ({"shapes": "(Entry('a\\nb', 'b', 'c'),)"}, "identifier .* is not a text of one line"),
        ({"shapes": "1 / 0"}, "rods.py cannot be imported: rods.py:12: ZeroDivisionError"),
        ({"name": "My Rods"}, "name 'My Rods' is not lower-case words"),
        ({"name": "people"}, "there is a data set 'people' already; rename"),
    ],
)
def test_what_a_data_set_cannot_be_is_named(plugin, changes, message):
    path = plugin(**changes)
    with pytest.raises((DatasetError, ConfigurationError), match=message):
        opened(path, changes.get("name", "rods"))


@pytest.mark.parametrize(
    ("load", "message"),
    [
        ("return None", "shape 'thin0': it returned NoneType; return Mesh"),
        ("return Mesh([[0, 0, float('nan')]], [])", "NaN or infinite"),
        ("raise KeyError('thin')", "shape 'thin0': rods.py:9: KeyError: 'thin'; correct the file"),
    ],
)
def test_a_mesh_that_cannot_be_made_costs_its_shape(plugin, load, message):
    dataset = opened(plugin(load=load))
    with pytest.raises(BenchmarkError, match=message) as caught:
        dataset.load(dataset.shapes[0])
    assert isinstance(caught.value, UnreadableMesh) or "NaN" in message
