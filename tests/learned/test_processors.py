"""Forms of networks do not depend on the processor."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

#: Instructions of torch, of its convolutions, and of its products of matrices, that older
#: processors have. Sums are then added in another order.
OLDER = {
    "ATEN_CPU_CAPABILITY": "default",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "MKL_CBWR": "COMPATIBLE",
    "OPENBLAS_CORETYPE": "Nehalem",
}

#: Prints a digest of the form of a person, as it is stored, by each network.
DIGESTS = """
from hashlib import sha256
from benchmark.datasets.people import people
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.views import prepare_view
from learned.methods import Learned, SizeFree, Streamed, WideExtra
shapes = people()
entry = shapes.shapes[7]
view = prepare_view(shapes.load(entry), shapes.camera(entry), shapes.half_width)
methods = (
    Learned(), Learned(configuration="as_printed"), SizeFree(), WideExtra(), Streamed()
)
for method in methods:
    form = method.canonicalise(shape_of(view, entry.identifier))
    print(sha256(form.vertices.astype("float32").tobytes()).hexdigest())
"""


def digests(**environment: str) -> list[str]:
    """The digests that a process prints in this environment."""
    process = subprocess.run(
        [sys.executable, "-c", DIGESTS],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | environment,
    )
    return process.stdout.split()


@pytest.mark.slow
def test_forms_of_networks_are_the_same_on_older_processors() -> None:
    forms = digests()
    assert len(set(forms)) == 5
    assert digests(**OLDER) == forms
