"""Whole images or bands: what a resolve of a sequence takes, and what there is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cltaa.devices.device_launcher import DeviceLauncher
from cltaa.devices.launch import Launcher
from cltaa.errors import ResourceError
from cltaa.files.content import memory_limit
from cltaa.parameters.build import Storage
from cltaa.parameters.choices import HistoryOf
from cltaa.parameters.presets import Preset
from cltaa.planning.memory import NO_LAYERS, Memory, of_whole_images
from cltaa.resolve.bands import BAND_ROWS, BandedResolver, keeps
from cltaa.resolve.resolver import Resolver
from cltaa.sequences.sources import Sequence


def band_rows_for(whole: Memory) -> int:
    """Rows of a band that suit a run that would take ``whole`` over whole images; 0 where this machine has that."""
    return BAND_ROWS if whole.whole > memory_limit() else 0


def of_whole(
    sequence: Sequence, resolver: Resolver, *, half: bool = False, layers: Mapping[str, str] = NO_LAYERS
) -> Memory:
    """Memory of a resolve of ``sequence`` by ``resolver`` over whole images; ``layers`` as for ``of_resolve``."""
    return of_whole_images(
        sequence, resolver.storage, doubled=resolver.preset.choices.history_of is HistoryOf.DOUBLED, half=half,
        shared=resolver.launcher.shares_memory, layers=layers,
    )  # fmt: skip


def has_bands(resolver: Resolver) -> bool:
    """True where the device and the preset of ``resolver`` can do with bands."""
    on_device = isinstance(resolver.launcher, DeviceLauncher)
    return on_device and resolver.preset.choices.history_of is HistoryOf.RESULT


def resolver_for(
    preset: Preset, device: str | Launcher | None, sequence: Sequence, band_rows: int | None = None, *,
    storage: Storage = Storage.FLOAT, half: bool = False, layers: Mapping[str, str] = NO_LAYERS, **options: Any,
) -> Resolver:  # fmt: skip
    """A resolver for the frames of ``sequence``: in bands where whole ones take more memory than this machine has.

    ``half`` says that halves will be written, ``layers`` are as ``of_resolve`` takes them. ``band_rows`` chooses in the
    machine's place; 0 is whole images. Raises ResourceError where they would have to be resolved in bands and the
    preset keeps frames or a history at 200 %, which only whole images can.
    """
    resolver = Resolver(preset, device, storage=storage, **options)  # first: what shares its memory takes less of it
    if band_rows is None:
        whole = of_whole(sequence, resolver, half=half, layers=layers)
        band_rows = band_rows_for(whole)
        if band_rows and preset.choices.history_of is not HistoryOf.RESULT:
            raise ResourceError(
                f"{sequence.width} x {sequence.height} pixels are too many for preset {preset.name}, which "
                f"{keeps(preset)}, so it resolves whole images only",
                expected=f"{whole.whole / 1e6:.0f} MB beside what it keeps",
                found=f"{memory_limit() / 1e6:.0f} MB of memory",
                cure="take --preset default, which resolves them in bands, or --band-rows 0 to try all the same",
            )
        if not has_bands(resolver):
            band_rows = 0
    if not band_rows:
        return resolver
    return BandedResolver.beside(resolver, band_rows, in_place=True, storage=storage, **options)
