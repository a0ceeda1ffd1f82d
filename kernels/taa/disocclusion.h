// Rejection: history that belongs to another surface is dropped.
#include "taa/sampling.h"

// The previous frame saw this surface if one of the four texels around the history position lies within the range of
// inverse depth that the current 3x3 has, seen from the previous camera and widened by depth_tolerance. One matching
// texel is enough: along silhouettes, and where a feature narrower than a pixel comes and goes with the jitter, some
// texel matches.
STAGE mask same_surface(quad previous, surface s, motion_t m, settings_t settings)
{
    const real near = s.nearest * m.scale + m.shift, far = s.farthest * m.scale + m.shift;
    const real slack = K(settings.depth_tolerance) * greater(absolute(near), absolute(far));
    const real high = near + slack, low = far - slack;
    return ((previous.p00 <= high) & (previous.p00 >= low)) | ((previous.p10 <= high) & (previous.p10 >= low))
        | ((previous.p01 <= high) & (previous.p01 >= low)) | ((previous.p11 <= high) & (previous.p11 >= low));
}
