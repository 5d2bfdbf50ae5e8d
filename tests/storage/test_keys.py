import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmark.storage import keys


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A first-party package of three modules: method -> helper, and a bystander."""
    root = tmp_path / "toyparty"
    root.mkdir()
    (root / "__init__.py").write_text("")
    (root / "method.py").write_text(
        '"""Method."""\n\n\ndef run(x):\n    from toyparty import helper\n\n    return helper.twice(x)\n'
    )
    (root / "helper.py").write_text("def twice(x):\n    return 2 * x\n")
    (root / "bystander.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(keys, "FIRST_PARTY", (*keys.FIRST_PARTY, "toyparty"))
    forget()
    yield root
    for name in [name for name in sys.modules if name.startswith("toyparty")]:
        del sys.modules[name]
    forget()


def forget():
    for cached in (keys._code_digest, keys._source, keys._read):
        cached.cache_clear()


def digest_after(edit, *paths):
    forget()
    before = keys.code_digest("toyparty.method")
    edit()
    forget()
    return before, keys.code_digest("toyparty.method")


def test_an_edit_in_a_helper_invalidates(package):
    before, after = digest_after(lambda: (package / "helper.py").write_text("def twice(x):\n    return 3 * x\n"))
    assert before != after


def test_comments_docstrings_and_moved_lines_do_not_invalidate(package):
    text = (package / "method.py").read_text().replace("Method.", "Other words.\n").replace("\n\n\n", "\n\n# why\n\n\n")
    text = text.replace("def run(x):", 'def run(x):\n    """Say more."""')
    before, after = digest_after(lambda: (package / "method.py").write_text(text))
    assert before == after


def test_an_edit_elsewhere_does_not_invalidate(package):
    before, after = digest_after(lambda: (package / "bystander.py").write_text("x = 2\n"))
    assert before == after


def test_the_closure_names_what_is_imported_inside_functions():
    assert {"benchmark.contracts", "benchmark.geometry.geodesics"} <= set(keys.code_of("baselines.classic_mds"))
    assert "benchmark.errors" not in keys.code_of("baselines.classic_mds")


def test_digest_ignores_the_order_of_a_dict_and_the_type_of_a_number():
    assert keys.digest({"a": 1, "b": (1, 2)}) == keys.digest({"b": [1, 2], "a": np.int64(1)})
    assert keys.digest({"a": 1}) != keys.digest({"a": 2})
    with pytest.raises(TypeError, match="cannot be part of a recipe"):
        keys.digest({"a": object()})


def test_the_place_of_a_plugin_does_not_matter(tmp_path):
    text = "value = 1\n"
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "plugin.py").write_text(text)
    assert keys.code_digest(str(tmp_path / "a" / "plugin.py")) == keys.code_digest(str(tmp_path / "b" / "plugin.py"))


def test_digests_agree_between_processes():
    command = "from benchmark.storage import keys; print(keys.code_digest('retrieval.cmbof'))"
    out = subprocess.run(
        [sys.executable, "-c", command], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    assert out.stdout.strip() == keys.code_digest("retrieval.cmbof")
