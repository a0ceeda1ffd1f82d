"""The Pareto front: what is beaten by nothing in time and error at once."""

from __future__ import annotations

from collections.abc import Mapping

Point = tuple[float, float]  # time, error: less is better in both


def dominated_by(points: Mapping[str, Point]) -> dict[str, str]:
    """For each point that is not on the front, the point on the front with the least error that beats it.

    A point is beaten by one that is no worse in time and error and better in one of them.
    """
    front = {
        name: point
        for name, point in points.items()
        if not any(_beats(other, point) for key, other in points.items() if key != name)
    }
    result = {}
    for name, point in points.items():
        if name not in front:
            better = [key for key, other in front.items() if _beats(other, point)]
            result[name] = min(better, key=lambda key: (front[key][1], front[key][0]))
    return result


def _beats(other: Point, point: Point) -> bool:
    return other[0] <= point[0] and other[1] <= point[1] and other != point
