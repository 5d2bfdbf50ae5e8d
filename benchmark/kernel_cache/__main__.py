"""Compile all kernels before the first run: ``python -m benchmark.kernel_cache``.

With ``--quick``, it compiles those of a quick run; with names of methods, data sets and scorers,
theirs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from benchmark.errors import ConfigurationError, check_known
from benchmark.kernel_cache import choose_kernel_cache, drop_stale_kernels
from benchmark.machine import pin_threads
from benchmark.text import say

#: Exit codes of an interruption, and of words that mean nothing.
_INTERRUPTED = 130
_USAGE = 2


def main(arguments: Sequence[str] = ()) -> None:
    """Compile kernels, so that later commands need not.

    Parameters
    ----------
    arguments
        ``--quick`` for those of a quick run alone; names of methods, data sets and scorers for
        theirs alone; none for all.
    """
    pin_threads()  # before numerical libraries are imported
    choose_kernel_cache()  # the one that later commands choose
    from benchmark.cli.progress import counting
    from benchmark.commands.kernels import kernel_uses

    drop_stale_kernels()
    start = time.monotonic()
    names = [argument for argument in arguments if argument != "--quick"]
    uses = kernel_uses(names, quick="--quick" in arguments)
    if not {use.name for use in uses}.issuperset(names):
        try:
            check_known("step with kernels", names, [use.name for use in kernel_uses()])
        except ConfigurationError as error:
            say(f"error: {error}", err=True)
            sys.exit(_USAGE)
    try:
        for use in counting("compiling kernels", uses, name=lambda use: use.name):
            use.compile()
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    say(f"kernels compiled after {time.monotonic() - start:.0f} s", err=True)


if __name__ == "__main__":
    main(sys.argv[1:])
