#version 330 core
// The sky behind everything: a direction, seen at the un-jittered position of the sample.

#include "sky.glsl"
#include "outputs.glsl"

uniform mat3 ndc_to_world;

#ifdef STARS
uniform float stars;  // radiance of the brightest

// Cells along the side of a cube around the eye, of which one in four holds a star; radii of stars, in cells.
const float CELLS = 90.0;
const float SMALLEST = 0.04, GREATEST = 0.14;

// Wellons, "Prospecting for Hash Functions" (2018), lowbias32.
uint scrambled(uint x)
{
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

float starlight(vec3 direction)
{
    vec3 size = abs(direction);
    float most = max(size.x, max(size.y, size.z));
    int axis = size.x == most ? 0 : size.y == most ? 1 : 2;
    vec2 place = (vec2(direction[(axis + 1) % 3], direction[(axis + 2) % 3]) / most + 1.0) * (0.5 * CELLS);
    vec2 cell = min(floor(place), CELLS - 1.0);
    uint side = uint(2 * axis) + (direction[axis] < 0.0 ? 1u : 0u);
    uint number = scrambled(uint(cell.x) + scrambled(uint(cell.y) + scrambled(side)));
    vec3 random = vec3(number & 1023u, (number >> 10) & 1023u, (number >> 20) & 1023u) / 1023.0;
    float radius = mix(SMALLEST, GREATEST, random.z * random.z);
    vec2 centre = cell + mix(vec2(GREATEST), vec2(1.0 - GREATEST), random.xy);
    bool lit = (number >> 30) == 0u && distance(place, centre) < radius;
    return lit ? stars * (0.2 + 0.8 * random.z) : 0.0;
}
#endif

void main()
{
    vec3 direction = normalize(ndc_to_world * vec3(sample_ndc(), 1.0));
    vec3 radiance = sky_radiance(direction);
#ifdef STARS
    radiance += starlight(direction) * smoothstep(0.0, HORIZON_BAND, direction.y);
#endif
    write_radiance(radiance, 1.0);
#ifdef MOTION
    write_no_motion();
#endif
#ifdef REACTIVE
    write_reactive(0.0);
#endif
}
