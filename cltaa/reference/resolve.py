"""Twin of ``resolve.cl``: the whole resolve of one frame."""

from __future__ import annotations

from cltaa.core.build import Build, Record
from cltaa.core.planes import Layout
from cltaa.reference.accumulate import current_pixel, rectified_alpha, resolve_pixel, without_missing
from cltaa.reference.colour import whole_samples
from cltaa.reference.dilation import borrowed_surface
from cltaa.reference.fireflies import without_firefly
from cltaa.reference.history import sample_history
from cltaa.reference.illumination import tests_light
from cltaa.reference.neighbourhood import nearest_surface
from cltaa.reference.planes import extend_stored, read_rows, store_recurrent
from cltaa.reference.real import Array, Run, quiet
from cltaa.reference.rectify import box_scale_of, rectify
from cltaa.reference.reprojection import surface_motion


@quiet
def resolve(
    build: Build,
    layout: Layout,
    *,
    current: Array,
    inverse_depth: Array,
    motion: Array | None,
    alpha: Array | None,
    reactive: Array | None,
    history: Array,
    history_count: Array,
    previous_inverse_depth: Array,
    output: Array,
    output_count: Array,
    frame: Record,
    settings: Record,
) -> None:
    """Resolve one frame from padded planes into ``output`` [3 or 4, rows, stride] and ``output_count``."""
    run = Run(build, layout, frame, settings)
    current, alpha = whole_samples(current, alpha, run)
    rows = read_rows(current, inverse_depth, motion, run)
    p = current_pixel(rows, alpha, reactive, run)
    s = nearest_surface(*rows, run)
    s = borrowed_surface(s, inverse_depth, motion, run)
    m = surface_motion(s, run)
    h = sample_history(current, alpha, history, history_count, previous_inverse_depth, m, s, run)
    r = rectify(h.rgb, p.filtered, p.stats, m, box_scale_of(m, run), run)
    r = r._replace(alpha=rectified_alpha(alpha, h.alpha, run))
    p = without_firefly(p, current, h, run)
    out = without_missing(resolve_pixel(p, h, r, run), h, current, alpha, run)
    store_recurrent(out, run, output, output_count)
    extend_stored(run, output[: 3 + build.steps.alpha], output_count[: 1 + tests_light(build)])
