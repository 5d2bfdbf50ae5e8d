"""Write the lists in ``pinned/`` anew, for their differences to be looked at."""

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.behaviour.pins import PINNED, current
from tests.behaviour.suite import OLD

if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        shutil.copytree(OLD / "results", Path(folder, "old"))
        shutil.copy(OLD / "bundle.zip", folder)
        for name, text in current(Path(folder)).items():
            PINNED.mkdir(exist_ok=True)
            (PINNED / name).write_text(text, encoding="utf-8")
