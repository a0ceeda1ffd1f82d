#version 330 core
// Only depth is kept; what is cut out casts no shadow.

#if defined(MASK) && defined(BASE_TEXTURE)
uniform sampler2D base_texture;
uniform float cutoff;  // over the base colour's own alpha
in vec2 uv;
#endif

void main()
{
#if defined(MASK) && defined(BASE_TEXTURE)
    if (texture(base_texture, uv).a < cutoff) discard;
#endif
}
