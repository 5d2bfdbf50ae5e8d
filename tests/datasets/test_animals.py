from benchmark.datasets.animals import Animals
from benchmark.datasets.animals.poses import POSES


def test_recipes_tell_all_shapes_apart_and_follow_the_data(monkeypatch):
    dataset = Animals()
    recipes = {entry.identifier: dataset.recipe(entry) for entry in dataset.entries}
    assert len(set(recipes.values())) == 80
    monkeypatch.setitem(POSES["cat"], "sitting", {"tail": (90,)})
    changed = {entry.identifier for entry in dataset.entries if dataset.recipe(entry) != recipes[entry.identifier]}
    assert changed == {"cat2"}
