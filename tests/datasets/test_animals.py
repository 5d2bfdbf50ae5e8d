from benchmark.datasets.animals import animals
from benchmark.datasets.animals.poses import POSES


def test_recipes_tell_all_shapes_apart_and_follow_the_data(monkeypatch):
    dataset = animals()
    recipes = {entry.identifier: dataset.key(entry) for entry in dataset.shapes}
    assert len(set(recipes.values())) == 80
    monkeypatch.setitem(POSES["cat"], "sitting", {"tail": (90,)})
    changed = {entry.identifier for entry in dataset.shapes if dataset.key(entry) != recipes[entry.identifier]}
    assert changed == {"cat2"}
