import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from benchmark.geometry.mesh import edges_of, sides_of

TRIANGLES = st.lists(st.tuples(*[st.integers(0, 9)] * 3), max_size=30)


@given(TRIANGLES)
def test_any_triangles(triangles):
    """Against sorting rows; corners may repeat, faces may be doubled, edges may have many faces."""
    faces = np.array(triangles, dtype=np.int32).reshape(-1, 3)
    edges = edges_of(faces)
    rows = np.sort(np.stack(sides_of(faces), axis=1), axis=1)
    ends, of_sides, counts = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    np.testing.assert_array_equal(edges.ends, ends)
    np.testing.assert_array_equal(edges.of_sides, of_sides.reshape(-1))
    np.testing.assert_array_equal(edges.counts, counts)
    for edge, first in enumerate(edges.first):
        members = edges.grouped_sides[first : first + counts[edge]]
        np.testing.assert_array_equal(members, np.flatnonzero(edges.of_sides == edge))
