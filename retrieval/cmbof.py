"""CM-BOF: bag-of-features signatures of depth images from all sides, compared by clock matching.

The stages are pure functions, so that a caller can store the result of each: ``extract`` per form, ``train_codebook``
per gallery, ``quantise`` per form and codebook, ``distances`` per gallery.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from benchmark.api.parameters import Interval
from benchmark.api.scoring import ScorerInfo, SignatureArrays
from benchmark.geometry.mesh import Mesh
from retrieval.clock import Progress, Signature, count_words, match_across, match_all
from retrieval.codebook import Descriptors, nearest_words, sample_codebook
from retrieval.features import Features, detect_views
from retrieval.pose import normalise
from retrieval.views import BACKGROUND, render, view_sphere

__all__ = ["CMBOF", "Features", "Signature"]

#: Any reflection serves: the others differ from it by one of the 24 rotations.
REFLECTION = np.diag([-1.0, 1.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class CMBOF:
    """Scorer of canonical forms.

    Parameters
    ----------
    n_words
        Size of the codebook.
    image_size
        Height and width of a depth image in pixels.
    codebook_seed
        Seed of the random draw of words.
    pose
        Candidates of the pose normalisation, ``"pca"`` and ``"rectilinearity"``; empty keeps the orientation.
    allow_mirror
        Whether a form may also match the mirror image of another.
    peak_threshold
        Minimum absolute difference of Gaussians at a keypoint, for depths in [0, 1]; 0 in the original.
    subdivisions
        Number of subdivisions of the view sphere, an octahedron: 6, 18, 66 or 258 views.

    References
    ----------
    Lian, Godil, Sun, Xiao, "CM-BOF: visual similarity-based 3D shape retrieval using Clock Matching and
    Bag-of-Features", Machine Vision and Applications 24, 2013. Values: the public re-implementation by D. Pickup.
    """

    info: ClassVar[ScorerInfo] = ScorerInfo(
        name="cm-bof",
        title="CM-BOF",
        cite="lian2013cmbof",
        summary="bags of SIFT features of 66 depth views, compared by clock matching",
        draws=3,  # the codebook is drawn at random
        invariant=False,
    )

    n_words: int = 1500
    image_size: int = 256
    codebook_seed: int = 0
    pose: tuple[str, ...] = ("pca", "rectilinearity")
    allow_mirror: bool = False
    peak_threshold: float = 1e-3
    subdivisions: Annotated[int, Interval(0, 3)] = 2

    @property
    def n_views(self) -> int:
        """Number of views of a form."""
        return len(view_sphere(self.subdivisions).directions)

    def signature(self, form: Mesh) -> SignatureArrays:
        """Return the arrays of the :class:`Features` of a form; raise ``InvalidMesh`` if it has no extent."""
        return self.extract(form).to_arrays()

    def compare(self, signatures: Sequence[SignatureArrays], draw: int) -> NDArray[np.float64]:
        """Return the dissimilarities of all pairs of forms with the codebook of seed ``draw``, shape (N, N)."""
        features = [Features.from_arrays(arrays) for arrays in signatures]
        codebook = self.train_codebook(features, draw)
        return self.distances([self.quantise(feature, codebook) for feature in features])

    def codebook(self, signatures: Iterable[SignatureArrays], draw: int) -> SignatureArrays:
        """Draw the codebook of a gallery, reading one signature at a time; see :meth:`train_codebook`."""
        return {"words": self.train_codebook(map(Features.from_arrays, signatures), draw)}

    def encode(self, signature: SignatureArrays, codebook: SignatureArrays) -> SignatureArrays:
        """Return the arrays of the :class:`Signature` of a form; see :meth:`quantise`."""
        return self.quantise(Features.from_arrays(signature), codebook["words"]).to_arrays()

    def match(self, rows: Sequence[SignatureArrays], columns: Sequence[SignatureArrays]) -> NDArray[np.float64]:
        """Return the dissimilarities of each of M encoded forms to each of N others, shape (M, N)."""
        first, second = ([Signature.from_arrays(arrays) for arrays in forms] for forms in (rows, columns))
        distances = match_across(first, second)
        if self.allow_mirror:
            of_first, of_second = ([form.mirrored for form in forms if form.mirrored] for forms in (first, second))
            np.minimum(distances, match_across(first, of_second), out=distances)
            np.minimum(distances, match_across(second, of_first).T, out=distances)
        return distances

    def extract(self, mesh: Mesh) -> Features:
        """Normalise the pose of a form, render its views, and describe their keypoints.

        Raises
        ------
        InvalidMesh
            If the form has no triangles or no extent.
        """
        upright = normalise(mesh, self.pose, self.image_size)
        images = render(upright, self.image_size, view_sphere(self.subdivisions))
        return detect_views(images, peak_threshold=self.peak_threshold, background=BACKGROUND)

    def train_codebook(self, features: Iterable[Features], seed: int | None = None) -> Descriptors:
        """Draw the words of a gallery from all descriptors of all its views, shape (n_words, 128), uint8.

        If there are fewer distinct descriptors than words, all of them become words. The order of the forms does not
        matter.

        Parameters
        ----------
        features
            One per form of the gallery.
        seed
            Replaces ``codebook_seed``.

        Raises
        ------
        DatasetError
            If there are no descriptors.
        """
        chosen = self.codebook_seed if seed is None else seed
        return sample_codebook((form.descriptors for form in features), self.n_words, chosen)

    def quantise(self, features: Features, codebook: Descriptors) -> Signature:
        """Count the nearest words of the descriptors of each view."""
        signature = count_words(nearest_words(features.descriptors, codebook), features.view_offsets, len(codebook))
        if not self.allow_mirror:
            return signature
        mirror = features.mirrored(view_sphere(self.subdivisions).permutation_of(REFLECTION))
        words = nearest_words(mirror.descriptors, codebook)
        return replace(signature, mirrored=count_words(words, mirror.view_offsets, len(codebook)))

    def distances(
        self, signatures: Sequence[Signature], threads: int = 1, progress: Progress | None = None
    ) -> NDArray[np.float64]:
        """Return the dissimilarities of all pairs of forms, shape (N, N), float64, symmetric, zero diagonal.

        Parameters
        ----------
        signatures
            One per form, all of one codebook; with their mirror images if the scorer allows them.
        threads
            Number of threads; the result does not depend on it.
        progress
            As in :func:`retrieval.clock.match_all`.
        """
        distances = match_all(signatures, threads, progress)
        mirrored = [s.mirrored for s in signatures if s.mirrored is not None]
        if self.allow_mirror:
            across = match_across(signatures, mirrored, threads, progress)
            np.minimum(distances, across, out=distances)
            np.minimum(distances, across.T, out=distances)
            np.fill_diagonal(distances, 0.0)
        return distances
