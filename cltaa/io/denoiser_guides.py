"""The channels that guide a denoiser: the albedo and the normals that renderers write beside a picture."""

from __future__ import annotations

from collections.abc import Iterable

# Last words of the names of layers that guide a denoiser, and their channels: albedo 0 to 1, normals -1 to 1.
GUIDES = {"albedo": (("albedo",), ("RGB",)), "normal": (("normal", "normals", "n"), ("XYZ", "RGB"))}


def guided_role(layer: str) -> str | None:
    """Return the guide that a layer's name, or its last word, stands for; None for none."""
    last = layer.lower().replace("_", " ").split(" ")[-1]
    return next((role for role, (words, _) in GUIDES.items() if last in words), None)


def guides_of(channels: Iterable[str], colour: Iterable[str] = ()) -> dict[str, tuple[str, ...]]:
    """Return the channels of a file that guide a denoiser: ``albedo`` and ``normal`` -> three names; absent ones are
    left out. Those of the layer and view of the ``colour`` channels come first, then those named for a denoiser."""
    names, own = set(channels), {word for name in colour for word in name.split(".")[:-1]}

    def is_of_another(layer: str) -> bool:  # one with a picture of its own
        above = layer.rpartition(".")[0]
        return f"{above}.R" in names and not own.issuperset(above.split("."))

    others = {
        layer: [word for word in layer.split(".") if word not in own]
        for layer in {n.rpartition(".")[0] for n in names}
        if not is_of_another(layer)
    }

    def rank(layer: str) -> tuple[int, bool, int, str]:
        shared = len(layer.split(".")) - len(others[layer])
        return -shared, "denois" not in layer.lower(), len(others[layer]), layer

    found: dict[str, tuple[str, ...]] = {}
    for role, (_, kinds) in GUIDES.items():
        for layer in sorted(others, key=rank):
            triples = (tuple(f"{layer}.{axis}" for axis in axes) for axes in kinds)
            triple = next((each for each in triples if names.issuperset(each)), None)
            if guided_role("".join(others[layer][-1:])) == role and triple and role not in found:
                found[role] = triple
    return found
