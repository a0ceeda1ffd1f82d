// Radiance from infinity, a function of the world direction alone (cltaa_datasets.scene.Sky).
struct Sky {
    vec3 zenith;
    vec3 horizon;
    vec3 ground;
    vec3 glow;
    vec3 glow_direction;
    float ambient;
    float fog;
};
uniform Sky sky;

// Width of the band over which the ground fades into the horizon, in units of the direction's y.
const float HORIZON_BAND = 0.02;
// Exponents that set how fast the horizon's colour fades upwards and how wide the glow is.
const float ZENITH_FADE = 0.5;
const float GLOW_FOCUS = 24.0;

vec3 sky_radiance(vec3 direction)
{
    vec3 above = mix(sky.horizon, sky.zenith, pow(max(direction.y, 0.0), ZENITH_FADE));
    vec3 radiance = mix(sky.ground, above, smoothstep(-HORIZON_BAND, HORIZON_BAND, direction.y));
    return radiance + sky.glow * pow(max(dot(direction, sky.glow_direction), 0.0), GLOW_FOCUS);
}

// Light on a surface facing `normal`, divided by pi: the two half-spheres weighted by how much of each it sees.
vec3 sky_ambient(vec3 normal)
{
    vec3 dome = mix(sky.horizon, sky.zenith, 0.5);
    return sky.ambient * mix(sky.ground, dome, 0.5 + 0.5 * normal.y);
}
