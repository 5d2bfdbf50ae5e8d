"""Equal forms have equal features, whatever the processor: compared between the newest kernels and the oldest."""

import os
import subprocess
import sys

import pytest

from tools.portability import OLDEST

PROGRAM = """
import hashlib
from retrieval.cmbof import CMBOF
from tests.retrieval.figures import figure
features = [CMBOF().extract(figure(seed)) for seed in range(6)]
codebook = CMBOF().train_codebook(features)
words = [CMBOF().quantise(each, codebook) for each in features]
matrix = CMBOF().distances(words)
print(hashlib.sha256(b"".join(each.descriptors.tobytes() for each in features) + matrix.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_features_and_distances_are_the_same_bytes():
    if OLDEST.obstacle():
        pytest.skip(OLDEST.obstacle())
    native = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"}
    digests = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, check=True, capture_output=True, text=True
        ).stdout
        for environment in (native, {**os.environ, **OLDEST.settings()})
    ]
    assert len(digests[0]) == 65
    assert digests[0] == digests[1]
