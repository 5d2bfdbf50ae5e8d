"""What pyproject.toml cannot say: the wheel packs examples/ and the published records of results/."""

from setuptools import find_namespace_packages, setup

setup(
    packages=[
        *find_namespace_packages(include=["benchmark*", "baselines*", "learned*", "retrieval*"]),
        "benchmark.examples",
        "benchmark.results.records",
    ],
    package_dir={"benchmark.examples": "examples", "benchmark.results.records": "results/records"},
)
