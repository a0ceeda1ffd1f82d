// What a fragment writes: linear scene-referred radiance, premultiplied; no clamp, no tonemap, no gamma.
layout(location = 0) out vec4 radiance_out;

uniform float exposure;
// Half the picture's size in pixels, and where the sample lies in un-jittered NDC relative to the raster's.
uniform vec2 half_size;
uniform vec2 sample_shift;

// Un-jittered normalised device coordinates of the sample of this pixel, y up.
vec2 sample_ndc()
{
    return gl_FragCoord.xy / half_size - 1.0 + sample_shift;
}

void write_radiance(vec3 radiance, float alpha)
{
    radiance_out = vec4(radiance * exposure * alpha, alpha);
}

#ifdef MOTION
// Pixels from here to where the same point was in the previous frame: x right, y down.
layout(location = MOTION) out vec2 motion_out;

// Where nothing but the camera moves: not a vector, the depth tells.
void write_no_motion()
{
    motion_out = vec2(uintBitsToFloat(0x7fc00000u));
}
#endif

#ifdef REACTIVE
// How much of the colour does not belong to the depth and motion written here.
layout(location = REACTIVE) out vec4 reactive_out;

void write_reactive(float share)
{
    // In all channels: blending weighs red by alpha.
    reactive_out = vec4(share);
}
#endif
