#version 330 core
// One vertex of a mesh. All matrices are composed on the host in float64, relative to the camera.

layout(location = 0) in vec3 position;
layout(location = NORMAL_SLOT) in vec3 normal;

uniform mat4 model_to_clip;  // un-jittered, reversed depth
uniform mat4 model_to_view;
uniform mat3 normal_to_world;
uniform vec2 jitter_ndc;

out vec3 view_position;
out vec3 world_normal;

#ifdef TEXCOORD_SLOT
layout(location = TEXCOORD_SLOT) in vec2 texcoord;
out vec2 uv;
#endif

#ifdef COLOUR_SLOT
layout(location = COLOUR_SLOT) in vec4 colour;
out vec4 vertex_colour;
#endif

#ifdef MOVING
uniform mat4 clip_displacement;  // previous model_to_clip - current, subtracted in float64
out vec3 displacement;           // its x, y, w
#ifdef STEP_SLOT
layout(location = STEP_SLOT) in vec3 step_back;  // previous position - current
uniform mat4 previous_model_to_clip;
#endif
#endif

void main()
{
    vec4 clip = model_to_clip * vec4(position, 1.0);
    gl_Position = vec4(clip.xy + jitter_ndc * clip.w, clip.zw);
    view_position = (model_to_view * vec4(position, 1.0)).xyz;
    world_normal = normal_to_world * normal;
#ifdef TEXCOORD_SLOT
    uv = texcoord;
#endif
#ifdef COLOUR_SLOT
    vertex_colour = colour;
#endif
#ifdef MOVING
    vec4 back = clip_displacement * vec4(position, 1.0);
#ifdef STEP_SLOT
    // M' p' - M p = (M' - M) p + M' (p' - p)
    back += previous_model_to_clip * vec4(step_back, 0.0);
#endif
    displacement = back.xyw;
#endif
}
