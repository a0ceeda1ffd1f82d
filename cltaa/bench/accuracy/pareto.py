"""What is beaten: by something with no more error that takes less time, as far as the times can tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping


def dominated_by(errors: Mapping[str, float], faster: Callable[[str, str], bool]) -> dict[str, str]:
    """For each name that is beaten, what beats it with the least error.

    ``errors`` are exact, less is better. ``faster(a, b)`` says whether ``a`` takes less time than ``b`` beyond chance:
    of two whose times cannot be told apart neither beats the other, whatever their errors.
    """
    order = sorted(errors, key=lambda name: errors[name])
    result = {}
    for name in order:
        no_worse = (other for other in order if other != name and errors[other] <= errors[name])
        found = next((other for other in no_worse if faster(other, name)), None)
        if found is not None:
            result[name] = found
    return result
