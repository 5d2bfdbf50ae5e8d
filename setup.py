"""What pyproject.toml cannot say: the wheel packs examples/ and what is published in results/."""

from setuptools import find_namespace_packages, setup

#: Packages whose folder lies elsewhere in a checkout.
MOVED = {
    "benchmark.examples": "examples",
    "benchmark.results.figures": "results/figures",
    "benchmark.results.figures.rows": "results/figures/rows",
    "benchmark.results.records": "results/records",
    "benchmark.results.records.distances": "results/records/distances",
}

setup(
    packages=[
        *find_namespace_packages(include=["benchmark*", "baselines*", "learned*", "retrieval*"]),
        *MOVED,
    ],
    package_dir=MOVED,
)
