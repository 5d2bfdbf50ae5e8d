"""The data set: nine classes with the sizes of TOSCA, eighty shapes."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass

from benchmark.datasets.animals.generate import generated_mesh, generated_recipe
from benchmark.datasets.animals.people import PEOPLE, person_mesh, person_recipe
from benchmark.datasets.animals.poses import POSES
from benchmark.datasets.base import Entry
from benchmark.errors import DatasetError
from benchmark.geometry.depth import FRONT, SIDE, Camera
from benchmark.geometry.mesh import Mesh
