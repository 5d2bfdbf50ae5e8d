"""Made-up signatures of any number of bodies in poses, as far from each other as those of generated humans are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from retrieval.clock import Signature, count_words
from retrieval.views import N_VIEWS

N_WORDS = 1500
#: Keypoints of a view of the form of a generated human by classic MDS; 800 a form.
KEYPOINTS_PER_VIEW = 12
#: Shares of the words that belong to the body, and of these to the pose, and of these to the form alone. With them 9 of
#: 10 distances between 300 forms lie in 54 to 63, as between forms of 13 generated humans by classic MDS, and the
#: nearest form is of the same body or of the same pose.
OF_BODY, OF_POSE, OF_FORM = 0.6, 0.5, 0.3


def signatures(size: int, poses: int, seed: int = 0) -> Iterator[Signature]:
    """Yield the signatures of a gallery, body by body."""
    rng = np.random.default_rng(seed)
    common = np.exp(rng.normal(size=(N_VIEWS, N_WORDS)) + rng.normal(size=N_WORDS))
    chances = (np.cumsum(common / common.sum(axis=1, keepdims=True), axis=1) + np.arange(N_VIEWS)[:, None]).ravel()
    views = np.repeat(np.arange(N_VIEWS), KEYPOINTS_PER_VIEW)
    offsets = np.arange(N_VIEWS + 1, dtype=np.int32) * KEYPOINTS_PER_VIEW

    def drawn() -> np.ndarray:
        places = np.searchsorted(chances, rng.random(len(views)) + views) - views * N_WORDS
        return np.minimum(places, N_WORDS - 1).astype(np.int32)

    def mixed(share: float, words: np.ndarray, others: np.ndarray) -> np.ndarray:
        return np.where(rng.random(len(views)) < share, words, others)

    everybody, of_pose = drawn(), [drawn() for _ in range(poses)]
    for number in range(size):
        if number % poses == 0:
            body = mixed(OF_BODY, drawn(), everybody)
        words = mixed(OF_FORM, drawn(), mixed(OF_POSE, of_pose[number % poses], body))
        yield count_words(words, offsets, N_WORDS)
