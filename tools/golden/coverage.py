"""``make golden ARGS=--coverage``: the lines of kernels and of inference that no golden input runs.

Kernels are seen without compilation alone, so those parts run that are small enough for that. What only trains a
network counts for nothing, nor does what makes data sets.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence

import coverage

from benchmark.system.code import ROOT

#: Folders whose code makes forms, signatures, distances and measures out of meshes.
INFERENCE = ("baselines", "learned", "retrieval", "benchmark/geometry", "benchmark/depth", "benchmark/jobs/stages")
#: Among them, what makes scenes for a data set.
GENERATORS = ("benchmark/depth/scene.py",)
#: What is run elsewhere or never: training, types, contracts without a body.
EXCLUDED = (
    r"def (train|check_options)\(",
    r"if TYPE_CHECKING:",
    r"^\s*\.\.\.$",
    r"class .*\(Protocol\)",
    r"# pragma: no cover",
)


def report(names: Sequence[str]) -> int:
    """Print the lines that no small part of the components runs, by file and in percent; in a process of its own."""
    command = [sys.executable, "-m", "tools.golden.coverage", *names]
    return subprocess.run(command, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, check=False).returncode


def main(names: Sequence[str]) -> None:
    """Run the components under a tracer that sees imports, too."""
    measured = coverage.Coverage(data_file=None, config_file=False, include=[f"{ROOT}/{each}/*" for each in INFERENCE])
    for pattern in EXCLUDED:
        measured.exclude(pattern)
    measured.start()
    from tools.golden.components import modules_of, path_of
    from tools.golden.results import run_component

    for name in names:
        print(name, file=sys.stderr, flush=True)
        run_component(name, small=True)
    measured.stop()
    n_lines = n_missed = 0
    for path in sorted({path_of(module) for name in names for module in modules_of(name)}):
        name = str(path.relative_to(ROOT))
        if name in GENERATORS or not name.startswith(INFERENCE):
            continue
        _, lines, _, missing, text = measured.analysis2(str(path))
        n_lines, n_missed = n_lines + len(lines), n_missed + len(missing)
        if missing:
            print(f"{name}: {len(missing)} of {len(lines)} lines: {text}")
    print(f"{n_missed} of {n_lines} lines are run by no golden input: {100 * n_missed / n_lines:.1f} %")


if __name__ == "__main__":
    main(sys.argv[1:])
