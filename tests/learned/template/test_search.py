"""Every way of standing along the principal axes is tried, each by itself."""

import numpy as np

from learned.template.search import quarter_turns


def test_the_quarter_turns_are_the_rotations_of_a_cube() -> None:
    turns = quarter_turns()
    assert np.allclose(np.linalg.det(turns), 1)
    assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3))
    known = {turn.tobytes() for turn in turns.round() + 0.0}
    assert len(known) == 24
    assert {(one @ other + 0.0).tobytes() for one in turns for other in turns} == known
