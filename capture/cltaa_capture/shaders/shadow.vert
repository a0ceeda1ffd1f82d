#version 330 core
// What a sun sees of a mesh: its depth, reversed, in the box of a shadow map.

layout(location = 0) in vec3 position;
uniform mat4 model_to_shadow;

#ifdef TEXCOORD_SLOT
layout(location = TEXCOORD_SLOT) in vec2 texcoord;
out vec2 uv;
#endif

void main()
{
    gl_Position = model_to_shadow * vec4(position, 1.0);
#ifdef TEXCOORD_SLOT
    uv = texcoord;
#endif
}
