"""The notebook of the examples runs from its first cell to its last."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "first_table.ipynb"


@pytest.mark.slow
def test_the_cells_run_one_after_the_other(tmp_path, monkeypatch):
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), found)  # noqa: S102
    assert list(found["jobs"]["status"]) == ["ok", "ok"]
    assert len(found["sweep"]) == 3
    assert len(found["curves"]) == 8
    assert found["form"].n_vertices > 100
