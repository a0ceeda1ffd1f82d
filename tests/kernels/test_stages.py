"""The stage kernels one after another give the bits of the fused kernel."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from cltaa.core.backend import Buffer
from cltaa.core.build import Build, settings_record
from cltaa.core.presets import load_preset
from cltaa.core.record import Past, frame_record
from cltaa.core.resolver import Resolver
from cltaa.frame import Effect
from cltaa.opencl.launcher import DeviceLauncher
from tests.kernels.test_resolve import hard_frames
from tests.sequence_factory import bits

# Planes that each stage leaves, as its file says.
PLANES = {"repaired": 3, "statistics": 15, "motion": 10, "history": 9, "change": 6, "output": 4, "count": 2}


class Kept(Resolver):
    """A resolver that keeps its buffers as they were before the last frame was swapped in."""

    def chain(self, previous: Past | None, frame: Any) -> np.ndarray[Any, Any]:
        """Run the stages over what the last resolve read, and return the colour and alpha that they leave."""
        assert self._buffers is not None
        assert self.plan is not None
        assert isinstance(self.launcher, DeviceLauncher)
        read, build, layout = self._buffers, self._build(self.plan), self._buffers.layout
        record, settings = frame_record(frame, previous, layout, self.plan), settings_record(self.plan.settings)
        made: dict[str, Buffer] = {name: read._planes(count) for name, count in PLANES.items()}
        # The resolve has swapped already: what it read as history and inverse depth is now what it will write next.
        current, inverse_depth, motion = read.channels["current"], read.previous_inverse_depth, read.channels["motion"]
        texels = {"current": current, "alpha": read.channels["alpha"]}
        window = {**texels, "inverse_depth": inverse_depth, "motion": motion}
        image = {"frame": record}
        both = {"frame": record, "settings": settings}

        def run(kernel: str, **arguments: Any) -> None:
            self.launcher.run(kernel, build, layout, arguments)

        run("repair_colour", **texels, repaired=made["repaired"], **image)
        run("neighbourhood_statistics", **window, statistics_out=made["statistics"], **image)
        run("surface_motion", **window, motion_out=made["motion"], **both)
        run(
            "sample_history",
            **texels,
            motion_in=made["motion"],
            history=read.output,
            history_count=read.output_count,
            previous_inverse_depth=read.inverse_depth,
            history_at=made["history"],
            **both,
        )
        run(
            "rectify_history",
            statistics_in=made["statistics"],
            motion_in=made["motion"],
            history_at=made["history"],
            change_out=made["change"],
            **both,
        )
        run(
            "blend",
            **texels,
            reactive=read.channels["reactive"],
            statistics_in=made["statistics"],
            history_at=made["history"],
            change_in=made["change"],
            output=made["output"],
            output_count=made["count"],
            **both,
        )
        self.launcher.finish()
        with made["output"].mapped(write=False) as planes:
            return np.moveaxis(layout.inside(planes).copy(), 0, -1)


def test_chain_of_stages_is_the_fused_kernel() -> None:
    resolver = Kept(load_preset(), build=Build(strict=True, lanes=8, rows=5))
    previous = None
    for wild in hard_frames():
        frame = dataclasses.replace(wild, effects=frozenset(Effect))
        fused = resolver.resolve(frame)
        assert resolver.plan is not None
        assert resolver.plan.choices.illumination == "test"
        assert np.array_equal(bits(resolver.chain(previous, frame)), bits(fused))
        previous = Past.of(frame)
