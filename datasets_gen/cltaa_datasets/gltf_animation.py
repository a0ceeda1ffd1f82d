"""Node trees and their animation as functions of time, float64 (glTF 2.0, sections 3.5, 3.11 and appendix C)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cltaa.errors import DataError
from cltaa.printable import counted
from cltaa_datasets.gltf_file import MALFORMED, GltfFile, picked
from cltaa_datasets.scene import Matrix

Floats = NDArray[np.float64]
REST: dict[str, tuple[float, ...]] = {
    "translation": (0.0, 0.0, 0.0),
    "rotation": (0.0, 0.0, 0.0, 1.0),
    "scale": (1.0, 1.0, 1.0),
}
INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
NEARLY_PARALLEL = 1.0 - 1e-9  # cosine between quaternions above which linear interpolation replaces the arc


@dataclass(frozen=True, eq=False, slots=True)
class Channel:
    """One property of one node over time."""

    times: Floats  # [K], seconds, ascending
    values: Floats  # [K, width], or [K, 3, width] for a cubic spline: in-tangent, value, out-tangent
    interpolation: str  # STEP, LINEAR or CUBICSPLINE
    turns: bool  # whether the values are quaternions

    def at(self, time: float) -> Floats:
        """Return the value at a time, clamped to the first and the last key."""
        cubic = self.interpolation == "CUBICSPLINE"
        keys = self.values[:, 1] if cubic else self.values
        after = int(np.searchsorted(self.times, time, side="right"))
        if after in (0, len(self.times)):
            value = keys[0 if after == 0 else -1]
        elif self.interpolation == "STEP":
            value = keys[after - 1]
        else:
            span = self.times[after] - self.times[after - 1]
            share = (time - self.times[after - 1]) / span
            if cubic:
                value = _hermite(self.values[after - 1], self.values[after], share, span)
            else:
                value = (slerp if self.turns else _straight)(keys[after - 1], keys[after], share)
        return unit_quaternion(value) if self.turns else np.asarray(value)


def _straight(a: Floats, b: Floats, share: float) -> Floats:
    return a + share * (b - a)


def _hermite(before: Floats, after: Floats, t: float, span: float) -> Floats:
    (_, a, leaving), (arriving, b, _) = before, after
    value = (2 * t**3 - 3 * t**2 + 1) * a + span * (t**3 - 2 * t**2 + t) * leaving
    return np.asarray(value + (3 * t**2 - 2 * t**3) * b + span * (t**3 - t**2) * arriving)


def slerp(a: Floats, b: Floats, share: float) -> Floats:
    """Interpolate from quaternion ``a`` to ``b`` along the shorter arc (Shoemake 1985)."""
    cosine = float(a @ b)
    if cosine < 0.0:
        b, cosine = -b, -cosine
    if cosine > NEARLY_PARALLEL:
        return _straight(a, b, share)
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle))


def unit_quaternion(quaternion: Floats) -> Floats:
    """Normalise a quaternion; a zero quaternion becomes the identity."""
    length = float(np.linalg.norm(quaternion))
    return np.asarray(quaternion / length if length != 0.0 else REST["rotation"])


def quaternion_matrix(quaternion: Floats) -> Matrix:
    """Return the rotation matrix [3, 3] of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2.0 * (w * cross + cross @ cross))


class NodeTree:
    """The nodes of a file, moved by its first animation in a loop, or at rest."""

    def __init__(self, file: GltfFile, *, played: bool = True) -> None:
        """Read nodes and channels; raises DataError for an animation that cannot be played."""
        self._nodes = file.items("nodes")
        self._parents = {child: i for i, node in enumerate(self._nodes) for child in node.get("children", ())}
        self._order = self._parents_first()
        self._channels: dict[tuple[int, str], Channel] = {}
        animations = file.items("animations") if played else []
        try:
            for channel in animations[0]["channels"] if animations else ():
                self._add(file, channel["target"], picked(animations[0]["samplers"], channel["sampler"], "samplers"))
        except MALFORMED as error:
            raise DataError(f"its animation cannot be read ({error!r})", path=file.path) from error
        self.duration = max((float(c.times[-1]) for c in self._channels.values()), default=0.0)

    def _parents_first(self) -> list[int]:
        """Return every node, parents before children."""
        children = [child for node in self._nodes for child in node.get("children", ())]
        for child in children:
            picked(self._nodes, child, "nodes")
        order = [index for index in range(len(self._nodes)) if index not in self._parents]
        if len(self._parents) == len(children):  # otherwise a node has two parents
            for index in order:
                order += self._nodes[index].get("children", ())
        if len(order) != len(self._nodes):
            raise ValueError("its nodes form no trees")
        return order

    def _add(self, file: GltfFile, target: dict[str, Any], sampler: dict[str, Any]) -> None:
        if "node" not in target:
            return  # the target of an extension
        picked(self._nodes, target["node"], "nodes")
        times = np.asarray(file.array(sampler["input"]), np.float64)
        interpolation = sampler.get("interpolation", "LINEAR")
        values = np.asarray(file.array(sampler["output"]), np.float64)
        if not (times.size and np.isfinite(times).all() and np.isfinite(values).all()):
            raise ValueError("its keys are none, or not finite")
        if (np.diff(times) < 0.0).any():
            raise ValueError("its keys are not in order")
        if interpolation not in INTERPOLATIONS:
            raise ValueError(f"no interpolation {interpolation}")
        shape = (len(times), 3, -1) if interpolation == "CUBICSPLINE" else (len(times), -1)
        path = target["path"]
        keys = values.reshape(shape)
        if path in REST and keys.shape[-1] != len(REST[path]):
            raise ValueError(f"{path} of {counted(keys.shape[-1], 'number')} a key")
        self._channels[target["node"], path] = Channel(times, keys, interpolation, turns=path == "rotation")

    def property(self, node: int, path: str, time: float) -> Floats | None:
        """Return the animated value of a node's ``path`` at a time; None if it is not animated."""
        channel = self._channels.get((node, path))
        if channel is None:
            return None
        return channel.at(time % self.duration if self.duration > 0.0 else 0.0)

    def shown(self, scene: dict[str, Any] | None) -> list[int]:
        """Return the nodes of a scene with all their descendants, in order; all nodes without a scene."""
        roots = range(len(self._nodes)) if scene is None else scene.get("nodes", ())
        for root in roots:
            picked(self._nodes, root, "nodes")
        found = set(roots)
        for index in self._order:
            if self._parents.get(index) in found:
                found.add(index)
        return sorted(found)

    def poses(self, time: float) -> list[Matrix]:
        """Return the matrix from node to world [4, 4] of every node."""
        done: dict[int | None, Matrix] = {None: np.eye(4)}
        for index in self._order:
            done[index] = done[self._parents.get(index)] @ self._local(index, time)
        return [done[index] for index in range(len(self._nodes))]

    def _local(self, index: int, time: float) -> Matrix:
        node = self._nodes[index]
        if "matrix" in node:
            matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
            matrix[3] = 0.0, 0.0, 0.0, 1.0  # which the specification requires
            return matrix
        parts = []
        for path, rest in REST.items():
            played = self.property(index, path, time)
            parts.append(np.asarray(node.get(path, rest), np.float64) if played is None else played)
        matrix = np.eye(4)
        matrix[:3, :3] = quaternion_matrix(unit_quaternion(parts[1])) * parts[2]
        matrix[:3, 3] = parts[0]
        return matrix
