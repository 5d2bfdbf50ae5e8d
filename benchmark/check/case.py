"""A component under test, and its answers for the shapes of the checks."""

from __future__ import annotations

import faulthandler
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import FrozenInstanceError, dataclass
from functools import cached_property
from multiprocessing import get_context
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.contracts import FloatArray, Mesh, Shape
from benchmark.api.parameters import checked, parameter_values
from benchmark.check.shapes import BENDS, figure, view
from benchmark.errors import BenchmarkError, ShapeError, UnsupportedShape, locate
from benchmark.geometry.mesh import read_only
from benchmark.machine import copies_end
from benchmark.pipeline.outputs import (
    compute_descriptor,
    compute_distances,
    compute_form,
    compute_signature,
)
from benchmark.places import live_in, temporary_folder
from benchmark.registry import Component
from benchmark.registry.modules import import_plugins_anew
from benchmark.text import Printed


class FailedCheck(Exception):
    """The check failed; with the reason and a hint."""


class SkippedCheck(Exception):
    """The check does not apply; with the reason."""


def explained(error: BaseException) -> str:
    """Return an exception as the author needs it, with advice that fits."""
    if isinstance(error, UnsupportedShape):
        return f"refuses an ordinary surface ({error}); treat it"
    if isinstance(error, FailedCheck | BenchmarkError):
        return str(error)
    if isinstance(error, ImportError):
        return f"{locate(error)}; name packages beyond the core in info.requires"
    if "read-only" in str(error) or isinstance(error, FrozenInstanceError):
        return f"{locate(error)}; it writes into its input: work on a copy"
    return locate(error)


@dataclass
class Case:
    """A component under test, with its answers: forms, shape (n, 3), or vectors.

    Parameters
    ----------
    component
        What to check.
    folder
        Where a learner is trained.
    model
        The model of a learner, once it is trained.
    fresh
        Connection to a process in which no shape was treated before; see :func:`fresh_process`.
    """

    component: Component
    folder: Path
    model: Path | None = None
    fresh: Any = None

    @property
    def is_scorer(self) -> bool:
        """Whether it compares forms."""
        return self.component.kind == "scorer"

    @property
    def compares(self) -> bool:
        """Whether it compares signatures or descriptors."""
        return self.is_scorer or self.component.describes

    @property
    def is_random(self) -> bool:
        """Whether its answers depend on the seed."""
        return not getattr(self.component.info, "deterministic", True)

    @property
    def reads_images(self) -> bool:
        """Whether it is a method that needs depth images."""
        return "mesh" not in getattr(self.component.info, "inputs", ("mesh",))

    @cached_property
    def reference(self) -> FloatArray:
        """The answer for the figure."""
        return self.answer(self.shape())

    def create(self) -> Any:
        """Return a new object, with its trained model."""
        created = self.component.create()
        plain = {
            name: value
            for name, value in parameter_values(created).items()
            if isinstance(value, int | float | str)
        }
        checked(type(created), plain)
        return created.load(self.model) if self.model else created

    def shape(
        self, bend: float = BENDS[0], mesh: Mesh | None = None, seed: int = 0, name: str = "figure"
    ) -> Shape:
        """Return the reference figure as input of the method.

        Parameters
        ----------
        bend
            How far the figure is bent.
        mesh
            A mesh to take in place of the figure. A depth image, if the method reads them, still
            shows the figure.
        seed
            Seed of random choices.
        name
            First word of the identifier; ``bend`` follows.

        Returns
        -------
        Shape
            The figure. Its ``source_area`` is not its area: it grows with ``bend``, so that figures
            differ for methods that compare areas.
        """
        depth = None
        if self.reads_images:  # a network needs a depth image, too
            seen = view(bend)
            depth = seen.depth
            mesh = mesh or seen.mesh
        mesh = mesh or figure(bend)
        return Shape(
            identifier=f"{name} {bend}",
            mesh=mesh,
            depth=depth,
            # Bending itself preserves the area.
            source_area=(1 + bend) * mesh.area,
            seed=seed,
        )

    def answer(self, shape: Shape, by: Any = None) -> FloatArray:
        """Return the answer of an object, by default a new one, as an array."""
        if by is None:
            by = self.create()
        answer = self._answer(by, shape)
        if not self.is_scorer:
            return np.asarray(answer)
        numbers = [np.asarray(answer[name], dtype=np.float64) for name in sorted(answer)]
        return np.concatenate([array.ravel() for array in numbers])

    def dissimilarities(
        self, shapes: Sequence[Shape], draw: int = 0, queries: Sequence[Shape] | None = None
    ) -> FloatArray:
        """Return the dissimilarities of all pairs by a descriptor or a scorer.

        With queries, those of each query to the shapes.
        """
        created = self.create()
        of_shapes = self._outputs(created, shapes)
        of_queries = None if queries is None else self._outputs(created, queries)
        return compute_distances(created, of_shapes, draw, of_queries)

    def _outputs(self, created: Any, shapes: Sequence[Shape]) -> list[Any]:
        """Return what an object returns for shapes, as a run passes it on."""
        return [self._read_only(self._answer(created, shape)) for shape in shapes]

    def answers_after_another(self) -> list[FloatArray]:
        """Return :attr:`reference` and :meth:`compared` of a process that began otherwise.

        It treated other shapes before.
        """
        self.fresh.send(self.model)
        try:
            answers: list[FloatArray] | str = self.fresh.recv()
        except EOFError:
            raise FailedCheck("ends the process if another shape comes first") from None
        if isinstance(answers, str):
            raise FailedCheck(f"if another shape comes first: {answers}")
        return answers

    def compared(self, bends: Sequence[float] = BENDS) -> list[FloatArray]:
        """Return the dissimilarities of the figure in its poses, in a list.

        It is empty if nothing is compared.
        """
        if not self.compares:
            return []
        return [self.dissimilarities([self.shape(bend) for bend in bends])]

    def _read_only(self, answer: Any) -> Any:
        """Return a signature or a vector as a run passes it on.

        A run reads it from a file, which nobody can write to.
        """
        if self.is_scorer:
            return {name: read_only(array) for name, array in answer.items()}
        return read_only(answer)

    def _answer(self, created: Any, shape: Shape) -> Any:
        """Return what an object returns for a shape."""
        with copies_end():
            if self.is_scorer:
                return compute_signature(created, shape.mesh)
            if self.component.describes:
                return compute_descriptor(created, shape)
            return compute_form(created, shape).vertices


@contextmanager
def fresh_process(case: Case, limit: float) -> Iterator[None]:
    """Fork a process in which no shape was treated before; it ends with the context."""
    case.fresh, theirs = Pipe()
    with temporary_folder() as home:
        arguments = (case, theirs, limit, str(home))
        process = get_context("fork").Process(target=_serve, args=arguments)
        process.start()
        theirs.close()
        try:
            yield
        finally:
            process.kill()
            process.join()


def _serve(case: Case, connection: Connection, limit: float, home: str) -> None:
    """Compute the answers for the figure in a fresh process, and send them to the first one.

    Both processes must find the same, whatever was computed before, so that this one treats other
    shapes first.

    Parameters
    ----------
    case
        The method or scorer, with shapes to try it on.
    connection
        Connection to the first process: from there comes the folder of the model of a learner, or
        None; to there go the answers, or an error as text.
    limit
        Seconds after which the process ends.
    home
        Empty folder that the process sees as the home of the user.
    """
    live_in(home)
    case.fresh.close()  # the other end of the connection
    with suppress(EOFError, KeyboardInterrupt), redirect_stdout(Printed()):
        case.model = connection.recv()
        faulthandler.dump_traceback_later(limit, exit=True, file=2)
        try:
            import_plugins_anew()
            used = case.create()
            with suppress(ShapeError):
                case.answer(view(), used)
            case.answer(case.shape(BENDS[1]), used)
            case.compared(BENDS[:2])
            connection.send([case.answer(case.shape(), used), *case.compared()])
        except Exception as error:
            connection.send(explained(error))
