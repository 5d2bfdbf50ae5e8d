"""Pareto front of methods: none of the others is both cheaper and better."""

from __future__ import annotations

from collections.abc import Mapping


def pareto_front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """Names on the front of cost and score.

    Parameters
    ----------
    points
        Cost, of which less is better, and score, of which more is better, by name.

    Returns
    -------
    list of str
        The cheapest first; of names that are equal in both, all.
    """
    front: list[str] = []
    for name, (cost, score) in sorted(points.items(), key=lambda item: (item[1][0], -item[1][1], item[0])):
        if not front or score > points[front[-1]][1] or (cost, score) == points[front[-1]]:
            front.append(name)
    return front
