"""Imports what workers of a run need, and loads the kernels that every run calls."""

from __future__ import annotations

from benchmark.geometry.camera import FRONT
from benchmark.geometry.depth import depth_surface
from benchmark.geometry.preparation import prepare
from benchmark.machine import pin_threads
from retrieval.cmbof import CMBOF
from tests.toy import rod

pin_threads()
depth_surface(prepare(rod(0.1, 1.0)).mesh, FRONT, 0.6)
CMBOF().compare([CMBOF().signature(rod(0.1, bend)) for bend in (1.0, 2.0)], 0)
