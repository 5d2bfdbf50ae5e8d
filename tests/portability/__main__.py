"""``python -m tests.portability DATA_ROOT``: how far scores move between processors; writes ``docs/portability.md``.

Every method treats every shape of TOSCA under each variant, one process after the other. A run that was stopped goes on
where it was: each shape is kept in ``build/portability``, which ``rm -r`` empties after an edit of the code. Without an
argument the document is written again from ``results/portability.json``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.portability.document import DOCUMENT, SCORES, compared, document
from tests.portability.variants import FOLDER, SCORED


def main() -> None:
    """Run what is missing and write the figures and the document."""
    if sys.argv[1:]:
        folders = {}
        for variant in SCORED:
            if variant.obstacle():
                print(f"{variant.name} skipped: {variant.obstacle()}")
                continue
            folders[variant.name] = FOLDER / "scores" / variant.name
            worker = [sys.executable, "-m", "tests.portability._worker", sys.argv[1], str(folders[variant.name])]
            subprocess.run(worker, env=variant.variables(), check=True)
        SCORES.write_text(json.dumps(compared(folders), indent=1) + "\n")
    Path(DOCUMENT).write_text(document(json.loads(SCORES.read_text())))
    print(f"wrote {DOCUMENT}")


main()
