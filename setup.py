"""What pyproject.toml cannot say: the examples are a folder of the checkout, and a part of the installed package."""

from setuptools import find_namespace_packages, setup

setup(
    packages=[
        *find_namespace_packages(include=["benchmark*", "baselines*", "learned*", "retrieval*"]),
        "benchmark.examples",
    ],
    package_dir={"benchmark.examples": "examples"},
)
