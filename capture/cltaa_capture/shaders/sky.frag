#version 330 core
// The sky behind everything: a direction, seen at the un-jittered position of the sample.

#include "sky.glsl"
#include "outputs.glsl"

uniform mat3 ndc_to_world;

void main()
{
    vec3 direction = normalize(ndc_to_world * vec3(sample_ndc(), 1.0));
    write_radiance(sky_radiance(direction), 1.0);
#ifdef MOTION
    write_no_motion();
#endif
#ifdef REACTIVE
    write_reactive(0.0);
#endif
}
