"""Limits are sums of bytes and operations over measured rates, and say so in words."""

from __future__ import annotations

import numpy as np
import pytest

from retrieval.views import BACKGROUND
from tools.speed import _limits, signature
from tools.speed._limits import Limit, Rates


def test_a_limit_is_the_sum_of_its_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_limits, "rates", lambda: Rates(bytes=20e9, sums=10e9, singles=20e9, roots=0.5e9, looks=1e9))
    # 2 GB at 20 GB/s, 10 million roots at .5 a ns, 30 million values at 1 a ns, 1 Gflop at 10 and at 20 Gflop/s, 5 ms.
    limit = Limit.of(moved=2e9, roots=10e6, looks=30e6, sums=1e9, singles=1e9, the_graph=0.005)
    assert limit.seconds == pytest.approx(0.1 + 0.02 + 0.03 + 0.1 + 0.05 + 0.005)
    assert str(limit) == (
        "limit 305 ms: the graph 5 ms, 2.00 GB at 20.0 GB/s 100 ms, 10 million roots and quotients at 0.50 a ns 20 ms, "
        "30 million values by index at 1.00 a ns 30 ms, 1.00 Gflop at 10.0 Gflop/s 100 ms, "
        "1.00 Gflop in single precision at 20.0 Gflop/s 50 ms"
    )
    assert Limit.of(the_graph=0.005).parts == {"the graph": 0.005}


def test_blurs_of_a_view_are_counted_by_hand() -> None:
    image = np.full((32, 32), BACKGROUND, dtype=np.float32)
    assert signature.operations_of_blurs(image) == 0  # nothing is searched where nothing was seen
    image[0, 0] = 0.5
    # Windows of 19 and 16 pixels; weights of one side reach 4 deviations: 5, 7, 8, 10 and 13 pixels, the first blur 7.
    # Of a pixel a product, and a product and two sums for each pixel of the reach, once each way.
    each, first = sum(2 * (3 * reach + 1) for reach in (5, 7, 8, 10, 13)), 2 * (3 * 7 + 1)
    assert signature.operations_of_blurs(image) == 19**2 * (each + first) + 16**2 * each
