#version 330 core
// Metallic-roughness shading of one surface point (glTF 2.0, appendix B), lit by suns, lamps and the sky.

#include "sky.glsl"
#include "outputs.glsl"

struct Material {
    vec4 base_colour;
    vec3 emissive;
    float metallic;
    float roughness;
    float specular;
    float alpha_cutoff;
};
uniform Material material;
uniform mat3 view_to_world;

#if SUNS > 0
struct Sun { vec3 direction; vec3 irradiance; };
uniform Sun suns[SUNS];
#endif
#if LAMPS > 0
struct Lamp { vec3 view_position; vec3 intensity; };
uniform Lamp lamps[LAMPS];
#endif

#ifdef BASE_TEXTURE
uniform sampler2D base_texture;
#endif
#ifdef METALLIC_ROUGHNESS_TEXTURE
uniform sampler2D metallic_roughness_texture;
#endif
#ifdef EMISSIVE_TEXTURE
uniform sampler2D emissive_texture;
#endif

#ifdef SHADOWED_SUN
uniform sampler2DShadow shadow_map;
uniform mat4 view_to_shadow;
uniform float shadow_offset;  // metres along the normal
#endif

in vec3 view_position;
in vec3 world_normal;
#ifdef TEXCOORD_SLOT
in vec2 uv;
#endif
#ifdef COLOUR_SLOT
in vec4 vertex_colour;
#endif
#ifdef MOVING
in vec3 displacement;
#endif

const float PI = 3.14159265358979;
// Reflectance of a dielectric at normal incidence (index of refraction 1.5), glTF 2.0 appendix B.
const float DIELECTRIC = 0.04;
// A perfect mirror of a point light has no finite picture: smallest roughness, and smallest cosine divided by.
const float MIN_ROUGHNESS = 0.08;
const float MIN_COSINE = 1e-3;
// A point this close to the previous camera's plane, relative to its depth, is far outside the previous picture.
const float MIN_PREVIOUS_W = 1e-3;

struct Surface {
    vec3 normal;
    vec3 to_eye;
    vec3 diffuse;
    vec3 f0;
    float roughness;
};

// Schlick's weight of grazing light. Rounding lifts the cosine of two unit vectors above 1, and pow of less than 0 is NaN.
float grazing(float cosine)
{
    return pow(max(1.0 - cosine, 0.0), 5.0);
}

// Light of one direction reflected to the eye: Lambert + GGX with Smith's joint shadowing (Heitz 2014).
vec3 reflected(Surface s, vec3 to_light, vec3 irradiance)
{
    float nl = dot(s.normal, to_light);
    if (nl <= 0.0) return vec3(0.0);
#ifdef MATT
    return s.diffuse / PI * irradiance * nl;
#else
    vec3 halfway = normalize(to_light + s.to_eye);
    float nv = max(dot(s.normal, s.to_eye), MIN_COSINE);
    float nh = max(dot(s.normal, halfway), 0.0);
    float vh = max(dot(s.to_eye, halfway), 0.0);
    float a = s.roughness * s.roughness;
    float a2 = a * a;
    float spread = nh * nh * (a2 - 1.0) + 1.0;
    float distribution = a2 / (PI * spread * spread);
    float visibility = 0.5 / (nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2));
    vec3 fresnel = s.f0 + (1.0 - s.f0) * grazing(vh);
    return ((1.0 - fresnel) * s.diffuse / PI + fresnel * distribution * visibility) * irradiance * nl;
#endif
}

// The sky as a light: diffuse from both half-spheres, mirror image of the sky blurred towards them by roughness.
vec3 reflected_sky(Surface s)
{
    vec3 ambient = sky_ambient(s.normal);
#ifdef MATT
    return s.diffuse * ambient;
#else
    float nv = max(dot(s.normal, s.to_eye), MIN_COSINE);
    vec3 fresnel = s.f0 + (max(vec3(1.0 - s.roughness), s.f0) - s.f0) * grazing(nv);
    vec3 mirrored = sky.ambient * sky_radiance(reflect(-s.to_eye, s.normal));
    return (1.0 - fresnel) * s.diffuse * ambient + fresnel * mix(mirrored, ambient, s.roughness);
#endif
}

vec4 base_colour()
{
    vec4 base = material.base_colour;
#ifdef BASE_TEXTURE
    base *= texture(base_texture, uv);
#endif
#ifdef COLOUR_SLOT
    base *= vertex_colour;
#endif
    return base;
}

Surface surface_of(vec4 base)
{
    float metallic = material.metallic, roughness = material.roughness;
#ifdef METALLIC_ROUGHNESS_TEXTURE
    vec4 texel = texture(metallic_roughness_texture, uv);
    roughness *= texel.g;
    metallic *= texel.b;
#endif
    Surface s;
#ifdef PARALLEL
    s.to_eye = view_to_world * vec3(0.0, 0.0, 1.0);
#else
    s.to_eye = normalize(view_to_world * -view_position);
#endif
    s.normal = normalize(gl_FrontFacing ? world_normal : -world_normal);
    // Between vertices whose normals are opposite the interpolated normal is 0, and normalised NaN.
    if (!(dot(s.normal, s.normal) > 0.5)) s.normal = s.to_eye;
    s.diffuse = base.rgb * (1.0 - metallic);
    s.f0 = mix(vec3(DIELECTRIC * material.specular), base.rgb, metallic);
    s.roughness = max(roughness, MIN_ROUGHNESS);
    return s;
}

#ifdef SHADOWED_SUN
// Share of the sun that reaches a point: 0 in shadow, 1 in light and outside the map.
float sunlight(Surface s)
{
    vec3 lifted = view_position + shadow_offset * (s.normal * view_to_world);
    vec3 at = (view_to_shadow * vec4(lifted, 1.0)).xyz;
    return texture(shadow_map, vec3(0.5 + 0.5 * at.xy, at.z));
}
#endif

vec3 shade(Surface s)
{
#ifdef UNLIT
    vec3 radiance = s.diffuse;
#else
    vec3 radiance = reflected_sky(s);
#if SUNS > 0
    for (int i = 0; i < SUNS; ++i) {
        vec3 irradiance = suns[i].irradiance;
#ifdef SHADOWED_SUN
        if (i == SHADOWED_SUN) irradiance *= sunlight(s);
#endif
        radiance += reflected(s, suns[i].direction, irradiance);
    }
#endif
#if LAMPS > 0
    for (int i = 0; i < LAMPS; ++i) {
        vec3 offset = lamps[i].view_position - view_position;
        vec3 to_light = view_to_world * normalize(offset);
        radiance += reflected(s, to_light, lamps[i].intensity / dot(offset, offset));
    }
#endif
#endif
    vec3 emissive = material.emissive;
#ifdef EMISSIVE_TEXTURE
    emissive *= texture(emissive_texture, uv).rgb;
#endif
    return radiance + emissive;
}

#ifdef MOVING
// (previous clip / previous w - current) with only small numbers subtracted: exact where the displacement is.
void write_motion()
{
#ifdef PARALLEL
    float w = 1.0;
#else
    float w = -view_position.z;
#endif
    float previous_w = max(w + displacement.z, MIN_PREVIOUS_W * w);
    vec2 ndc_motion = (displacement.xy - sample_ndc() * displacement.z) / previous_w;
    motion_out = ndc_motion * half_size * vec2(1.0, -1.0);
}
#endif

void main()
{
    vec4 base = base_colour();
#ifdef MASK
    if (base.a < material.alpha_cutoff) discard;
#endif
    vec3 radiance = shade(surface_of(base));
#ifdef FOG
    vec3 away = normalize(view_to_world * view_position);
    radiance = mix(sky_radiance(away), radiance, exp(-sky.fog * length(view_position)));
#endif
#ifdef BLEND
    write_radiance(radiance, base.a);
#else
    write_radiance(radiance, 1.0);
#endif
#ifdef REACTIVE
#ifdef BLEND
    write_reactive(base.a);
#else
    write_reactive(0.0);
#endif
#endif
#ifdef MOTION
#ifdef MOVING
    write_motion();
#else
    write_no_motion();
#endif
#endif
}
