"""The OpenEXR module as it is used here: in a process of our own, with how many threads, and how large images."""

import OpenEXR

from cltaa.io.exr_header import LARGEST_SIDE
from cltaa.process import CORES, MANY_CORES, once_own

__all__ = ["OpenEXR"]


def _configure() -> None:
    # OpenEXR starts with no worker threads and no limit; a second core halves the time of ZIP. Of many cores half are
    # left to what runs beside it: with all of them each frame is decoded sooner, and the others wait for it.
    OpenEXR.set_global_thread_count(min(CORES, max(MANY_CORES, CORES // 2)))
    OpenEXR.setMaxImageSize(LARGEST_SIDE, LARGEST_SIDE)


once_own(_configure)
