"""Files of the cache: each damaged bit is found."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.pipeline.cache import Cache

ARRAYS = {
    "descriptors": np.arange(24, dtype=np.uint8).reshape(2, 12),
    "offsets": np.arange(3),
    "seconds": np.array(2.5),
}


@pytest.mark.parametrize("kind", ["forms", "signatures"])
def test_a_file_with_any_flipped_bit_counts_as_missing_or_is_the_same(tmp_path, kind):
    cache = Cache(tmp_path)
    cache.write(kind, "key", ARRAYS)
    path = next(tmp_path.rglob("*.npz"))
    content = path.read_bytes()
    for place in range(len(content)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1 << place % 8]) + content[place + 1 :])
        read = cache.read(kind, "key")
        assert read is None or (
            read.keys() == ARRAYS.keys() and all(np.array_equal(read[name], ARRAYS[name]) for name in read)
        )
    path.write_bytes(content[:-30])
    assert cache.read(kind, "key") is cache.read(kind, "other") is None
