#version 330
// The resolve of kernels/bench/plain.cl as a fragment shader: the same algorithm, the same order of work. Row 0 of every
// texture and of the target is the top of the image, so y points down here too.
uniform sampler2D current, inverse_depth, history;
uniform mat4 displacement; // rows x, y, w of D, then (origin_x, origin_y, reset, -)
uniform vec4 limits; // sample_limit, blend_weight, luminance_knee, box_floor
uniform vec3 box; // box_scale_static, box_scale_moving, motion_px
out vec4 result;

vec3 to_ycocg(vec3 c)
{
    return vec3(0.25 * c.r + 0.5 * c.g + 0.25 * c.b, 0.5 * c.r - 0.5 * c.b, -0.25 * c.r + 0.5 * c.g - 0.25 * c.b);
}

vec3 from_ycocg(vec3 c)
{
    float t = c.x - c.z;
    return vec3(t + c.y, c.x + c.z, t - c.y);
}

vec4 weights(float t)
{
    return vec4(t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t));
}

vec3 catmull_rom(vec2 position, ivec2 last)
{
    vec2 base = floor(position), f = position - base;
    vec4 wx = weights(f.x), wy = weights(f.y);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i)
            sum += wx[i] * wy[j] * texelFetch(history, clamp(ivec2(base) + ivec2(i - 1, j - 1), ivec2(0), last), 0).rgb;
    return sum;
}

float bilinear_count(vec2 position, ivec2 last)
{
    vec2 base = floor(position), f = position - base;
    ivec2 p = ivec2(base);
    float a = texelFetch(history, clamp(p, ivec2(0), last), 0).a;
    float b = texelFetch(history, clamp(p + ivec2(1, 0), ivec2(0), last), 0).a;
    float c = texelFetch(history, clamp(p + ivec2(0, 1), ivec2(0), last), 0).a;
    float d = texelFetch(history, clamp(p + ivec2(1, 1), ivec2(0), last), 0).a;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(current, 0) - 1, place = at;
    vec3 sum = vec3(0.0), squares = vec3(0.0), centre = vec3(0.0);
    float nearest = texelFetch(inverse_depth, at, 0).r;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
            ivec2 p = clamp(at + ivec2(i, j), ivec2(0), last);
            vec3 c = to_ycocg(texelFetch(current, p, 0).rgb);
            sum += c;
            squares += c * c;
            if (i == 0 && j == 0)
                centre = c;
            float q = texelFetch(inverse_depth, p, 0).r;
            if (q > nearest) {
                nearest = q;
                place = at + ivec2(i, j);
            }
        }
    vec3 mean = sum / 9.0, deviation = sqrt(max(squares / 9.0 - mean * mean, 0.0));

    vec2 origin = displacement[3].xy, p = vec2(place) + origin;
    vec4 v = vec4(p, nearest, 1.0);
    vec3 d = vec3(dot(displacement[0], v), dot(displacement[1], v), dot(displacement[2], v));
    vec2 motion = (d.xy - p * d.z) / (1.0 + d.z), position = vec2(at) + motion;

    vec3 past = to_ycocg(catmull_rom(position, last));
    float count = min(bilinear_count(position, last), limits[0]);
    bool seen = displacement[3].z == 0.0 && all(greaterThanEqual(position, vec2(-0.5)))
        && all(lessThanEqual(position, vec2(last) + 0.5));

    float still = max(1.0 - max(abs(motion.x), abs(motion.y)) / box.z, 0.0), gamma = mix(box.y, box.x, still);
    vec3 extent = max(gamma * deviation, limits[3] * max(abs(mean.x), max(abs(mean.y), abs(mean.z))) + 1e-30);
    vec3 away = abs((past - mean) / extent);
    float outside = max(away.x, max(away.y, away.z));
    vec3 held = outside > 1.0 ? mean + (past - mean) / outside : past;

    float weight = max(1.0 / (count + 1.0), limits[1]);
    float for_current = weight * (limits[2] + max(held.x, 0.0));
    float for_history = (1.0 - weight) * (limits[2] + max(centre.x, 0.0));
    vec3 blended = held + (for_current / (for_current + for_history)) * (centre - held);
    result = vec4(max(from_ycocg(seen ? blended : centre), 0.0), seen ? count + 1.0 : 1.0);
}
