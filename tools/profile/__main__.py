"""``python -m tools.profile run --all --quick``: does it, and prints where the time of its workers went."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmark.cli.main import main as run
from benchmark.threads import pin_threads

pin_threads()

from benchmark.jobs.execution import worker, worker_pool  # noqa: E402
from tools.profile import account  # noqa: E402
from tools.profile.report import Profile  # noqa: E402


def main() -> None:
    """Run the command line with workers that keep account, then print the profile; ends as the command ends."""
    worker._do_in_turn = account.do_in_turn
    sizes: list[int] = []
    begin = worker_pool.LocalWorkerPool.__init__

    def noted(pool: worker_pool.LocalWorkerPool, size: int, progress: Path) -> None:
        sizes.append(size)
        begin(pool, size, progress)

    worker_pool.LocalWorkerPool.__init__ = noted  # type: ignore[method-assign]
    began, code = psutil.Process().create_time(), 0
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "lines"
        lines.touch()
        os.environ[account.LINES] = str(lines)
        try:
            run()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        tasks = [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines()]
    if tasks:
        print(Profile(tasks, max(sizes), began, time.time(), account.processor_seconds()).markdown())
    sys.exit(code)


main()
