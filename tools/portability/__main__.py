"""``python -m tools.portability DATA_ROOT``: how far scores move between processors; writes the page of it.

Every method treats every shape of TOSCA under each variant, one process after the other. A run that was stopped goes on
where it was: each shape is kept in ``build/portability``, which ``rm -r`` empties after an edit of the code. Without an
argument the document is written again from ``results/portability.json``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tools.portability.document import DOCUMENT, SCORES, compare, document, with_scores
from tools.portability.variants import FOLDER, SCORED, Variant


def main() -> None:
    """Run what is missing and write the figures and the document."""
    if sys.argv[1:]:
        variants = [variant for variant in SCORED if not variant.obstacle()]
        folders = {variant.name: FOLDER / "scores" / variant.name for variant in variants}
        for variant in variants:
            _work(variant, [])
        rows = compare(folders)
        differing = [f"{row['method']} {row['input']}" for row in rows if row["same"] < row["shapes"]]
        for variant in variants if differing else []:
            _work(variant, differing)
        SCORES.write_text(json.dumps(with_scores(rows, folders), indent=1) + "\n")
    Path(DOCUMENT).write_text(document(json.loads(SCORES.read_text())))
    print(f"wrote {DOCUMENT}")


def _work(variant: Variant, rows: list[str]) -> None:
    command = [sys.executable, "-m", "tools.portability._worker", sys.argv[1], str(FOLDER / "scores" / variant.name)]
    subprocess.run([*command, *rows], env=variant.variables(), check=True)


main()
