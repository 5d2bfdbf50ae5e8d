"""Regions of code count as run when one of their own instructions was."""

import importlib.util
import threading

from benchmark.jobs.rekey.reached import Reached

SOURCE = """\
def chosen(flag, values):
    total = sum(v * 2 for v in values) if flag else len(values) - 1
    if total > 100:
        total = 2 * 3
    return total and values[0]
"""


def places(text):
    """Region of a piece of the source."""
    start = SOURCE.index(text)
    line = SOURCE.count("\n", 0, start) + 1
    column = start - (SOURCE.rfind("\n", 0, start) + 1)
    return (line, column, line, column + len(text))


PARTS = ("v * 2", "len(values) - 1", "total > 100", "2 * 3", "values[0]", "return total and values[0]")


def reached(tmp_path, run):
    (tmp_path / "module.py").write_text(SOURCE)
    spec = importlib.util.spec_from_file_location("module", tmp_path / "module.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    watched = Reached({"module.py": {part: places(part) for part in PARTS}}, tmp_path)
    with watched.watching():
        run(module.chosen)
    return watched.found


def test_arms_and_branches_are_told_apart(tmp_path):
    always = {"total > 100", "return total and values[0]"}
    assert reached(tmp_path, lambda f: f(True, [1, 2])) == always | {"v * 2", "values[0]"}
    assert reached(tmp_path, lambda f: f(False, [1])) == always | {"len(values) - 1"}
    assert reached(tmp_path, lambda f: f(True, [90])) == always | {"v * 2", "2 * 3", "values[0]"}
    assert reached(tmp_path, lambda f: None) == set()


def test_other_threads_are_watched(tmp_path):
    def run(function):
        thread = threading.Thread(target=function, args=(True, [1]))
        thread.start()
        thread.join()

    assert "v * 2" in reached(tmp_path, run)
