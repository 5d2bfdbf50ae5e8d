"""Regions that differ between two trees: none where names alone changed, all where a digit might."""

from textwrap import dedent

import pytest

from benchmark.jobs.rekey.changes import changes
from benchmark.jobs.rekey.trees import Tree

BEFORE = {
    "baselines/form.py": '''
        """A method."""

        from baselines.helpers import clipped, scaled
        from benchmark.failures import Refused

        LIMIT = 1e-9
        _HINT = "take another shape"

        class Form:
            """A form."""

            power: float = 2.0

            def canonicalise(self, shape):
                """Make it."""
                total = 0.0
                for value in shape:
                    if value < LIMIT:
                        raise Refused("too small", _HINT)
                    total = total + value**self.power
                return scaled(total, factor=3.0) if total else clipped(total)
    ''',
    "baselines/helpers.py": """
        from numba import njit

        def scaled(total, factor=1.0):
            return total * factor

        def clipped(total):
            return max(total, 0.0)

        @njit(cache=True)
        def kernel(values):
            found = 0.0
            for k in range(len(values)):
                found += values[k] * 0.5
            return found
    """,
    "benchmark/failures.py": """
        class Refused(Exception):
            def __init__(self, problem, hint):
                self.hint = hint
    """,
}


@pytest.fixture
def compared(tmp_path):
    """Differences between the example and an edit of it, as ``module.function line`` of the new tree, or of the old."""

    def compare(*edits, moved=()):
        for name in ("old", "new"):
            for file, text in BEFORE.items():
                path = tmp_path / name / file
                path.parent.mkdir(parents=True, exist_ok=True)
                (path.parent / "__init__.py").write_text("")
                path.write_text(dedent(text))
        for file, before, after in edits:
            path = tmp_path / "new" / file
            text = path.read_text()
            assert before in text, (file, before)
            path.write_text(text.replace(before, after))
        for source, target in moved:
            (tmp_path / "new" / source).rename(tmp_path / "new" / target)
        return changes(Tree(tmp_path / "old", "old"), Tree(tmp_path / "new", "new"))

    return compare


FORM, HELPERS, FAILURES = BEFORE

SAME = {
    "a local": [(FORM, "total", "power_sum")],
    "a parameter with its callers": [(HELPERS, "factor", "times"), (FORM, "factor=", "times=")],
    "a function with its callers": [(HELPERS, "scaled", "stretched"), (FORM, "scaled", "stretched")],
    "an attribute": [(FAILURES, "hint", "advice")],
    "a class": [(FAILURES, "Refused", "Unfit"), (FORM, "Refused", "Unfit")],
    "a constant": [(FORM, "LIMIT", "SMALLEST")],
    "an annotation": [(HELPERS, "def clipped(total)", "def clipped(total: float) -> float"),
                      (FORM, "total = 0.0", "total: float = 0.0")],
    "a docstring": [(FORM, '"""Make it."""', '"""Make the form."""')],
    "a comment": [(FORM, "total = 0.0", "total = 0.0  # of all")],
    "the text of an error": [(FORM, '"too small"', '"it is too small"')],
    "a hint": [(FORM, '"take another shape"', '"take a larger shape"')],
}  # fmt: skip


@pytest.mark.parametrize("edits", SAME.values(), ids=SAME)
def test_what_changes_no_digit_is_no_difference(compared, edits):
    assert [change.told for change in compared(*edits)] == []


def test_a_module_may_be_renamed_if_its_functions_run(compared):
    found = compared((FORM, "baselines.helpers", "baselines.tools"), moved=[(HELPERS, "baselines/tools.py")])
    assert {(c.module, c.function) for c in found} <= {
        (module, name)
        for module in ("baselines.helpers", "baselines.tools")
        for name in ("scaled", "clipped", "kernel")
    }
    assert not [c for c in found if c.module == "baselines.form"]


HELPERS_TEXT, ALIAS = dedent(BEFORE[HELPERS]), "from baselines.tools import *\n"


@pytest.mark.parametrize(
    ("first_lines", "different"),
    [("", set()), ("def max(*values):\n    return values[0]\n", {"baselines.helpers", "baselines.tools"})],
    ids=["the same built-in", "a function of its own"],
)
def test_a_function_that_moved_need_not_run_where_its_globals_mean_the_same(compared, tmp_path, first_lines, different):
    tools = tmp_path / "new" / "baselines" / "tools.py"
    tools.parent.mkdir(parents=True)
    tools.write_text(first_lines + HELPERS_TEXT)
    found = compared((HELPERS, HELPERS_TEXT, ALIAS), (FORM, "baselines.helpers", "baselines.tools"))
    assert {change.module for change in found if change.function == "clipped"} == different
    assert not [change for change in found if change.function in ("scaled", "kernel")]


DIFFERENT = {
    "a constant in a kernel": ([(HELPERS, "* 0.5", "* 0.25")], {"baselines.helpers.kernel"}),
    "an operator": ([(HELPERS, "total * factor", "total + factor")], {"baselines.helpers.scaled"}),
    "a comparison": ([(FORM, "value < LIMIT", "value <= LIMIT")], {"baselines.form.Form.canonicalise"}),
    "a default of a parameter": ([(HELPERS, "factor=1.0", "factor=2.0")], {"baselines.helpers.scaled"}),
    "a field of a class": ([(FORM, "float = 2.0", "float = 3.0")], {"baselines.form.Form.canonicalise"}),
    "a constant of a module": ([(FORM, "1e-9", "1e-6")], {"baselines.form.Form.canonicalise"}),
    "another function of a library": (
        [(HELPERS, "max(total, 0.0)", "min(total, 0.0)")], {"baselines.helpers.clipped"},
    ),
    "the order of statements": (
        [(HELPERS, "found = 0.0\n    for", "for"), (HELPERS, "return found", "found = 0.0\n    return found")],
        {"baselines.helpers.kernel"},
    ),
    "a function that another import brings": (
        [(FORM, "from baselines.helpers import clipped, scaled",
          "from baselines.helpers import clipped\nfrom baselines.helpers import clipped as scaled")],
        {"baselines.form.Form.canonicalise"},
    ),
    "one of two names that stand for the same": (
        [(FORM, "total = total + value", "total = value + value")], {"baselines.form.Form.canonicalise"},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("edits", "expected"), DIFFERENT.values(), ids=DIFFERENT)
def test_what_may_change_a_digit_must_run(compared, edits, expected):
    found = compared(*edits)
    assert expected <= {f"{change.module}.{change.function}" for change in found}
    assert {change.tree for change in found} == {0, 1}


def test_a_function_with_another_decorator_must_have_begun(compared):
    (old, new) = compared((FORM, "    def canonicalise", "    @functools.cache\n    def canonicalise"))
    assert {old.function, new.function} == {"Form.canonicalise"}
    assert (old.region[0], new.region[0]) == (17, 18)  # the first statement, whatever comes behind it


def test_a_kernel_is_told_as_compiled(compared):
    found = compared((HELPERS, "* 0.5", "* 0.25"))
    assert all(change.is_compiled for change in found)
    assert not any(change.is_compiled for change in compared((HELPERS, "total * factor", "total + factor")))


def test_an_arm_of_an_expression_is_a_region_of_its_own(compared):
    before = "else clipped(total)"
    old, new = sorted(compared((FORM, before, "else clipped(total + 1.0)")), key=lambda change: change.tree)
    assert "canonicalise" in old.function
    line = dedent(BEFORE[FORM]).splitlines()[new.region[0] - 1]
    assert line[new.region[1] :].startswith("total") and new.region[1] > line.index("else")


def test_statements_of_a_function_that_was_split_are_not_new(compared):
    found = compared(
        (FORM, "            if value < LIMIT:\n                raise Refused(\"too small\", _HINT)\n",
         "            _check(value)\n"),
        (FORM, "class Form:", "def _check(value):\n    if value < LIMIT:\n"
         "        raise Refused('too small', _HINT)\n\n\nclass Form:"),
    )  # fmt: skip
    told = {(change.function, change.tree) for change in found}
    assert ("Form.canonicalise", 1) in told  # the call
    assert not [c for c in found if c.tree == 1 and c.function == "_check" and c.region[0] > 11]  # not the raise


def test_dead_code_may_go(compared):
    dead = dedent(BEFORE[HELPERS])[dedent(BEFORE[HELPERS]).index("@njit") :]
    assert compared((HELPERS, dead, "")) == []


def test_a_use_in_dead_code_need_not_run(compared):
    dead = "def unused(value):\n    return value < LIMIT\n\n\nclass Form:"
    found = compared((FORM, "LIMIT = 1e-9", "LIMIT = 1e-8"), (FORM, "class Form:", dead))
    assert {change.function for change in found} == {"Form.canonicalise"}
