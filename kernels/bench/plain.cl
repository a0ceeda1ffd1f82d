// A baseline to measure against: the temporal resolve ported from a shader, one pixel a work-item, interleaved float4
// pixels, coordinates clamped at the border, the library's max, clamp and sqrt. The same algorithm as `resolve.cl` with
// the choices of cltaa/lab/bench/kernels.py, without its repair of bad texels.
inline float3 to_ycocg(float3 c)
{
    return (float3)(0.25f * c.x + 0.5f * c.y + 0.25f * c.z, 0.5f * c.x - 0.5f * c.z,
        -0.25f * c.x + 0.5f * c.y - 0.25f * c.z);
}

inline float3 from_ycocg(float3 c)
{
    const float t = c.x - c.z;
    return (float3)(t + c.y, c.x + c.z, t - c.y);
}

inline size_t texel_at(int x, int y, frame_t frame)
{
    return (size_t)clamp(y, 0, frame.height - 1) * frame.width + clamp(x, 0, frame.width - 1);
}

inline void catmull_rom_weights(float t, float* w)
{
    w[0] = t * (-0.5f + t * (1.0f - 0.5f * t));
    w[1] = 1.0f + t * t * (-2.5f + 1.5f * t);
    w[2] = t * (0.5f + t * (2.0f - 1.5f * t));
    w[3] = t * t * (-0.5f + 0.5f * t);
}

__kernel void plain_kernel(__global const float* restrict current, __global const float* restrict inverse_depth,
    __global const float* restrict history, __global float* restrict output, const frame_t frame,
    const settings_t settings)
{
    const int x = get_global_id(0), y = get_global_id(1);
    if (x >= frame.width || y >= frame.height)
        return;

    float3 sum = 0.0f, squares = 0.0f, centre = 0.0f;
    float nearest = inverse_depth[texel_at(x, y, frame)];
    int nearest_x = x, nearest_y = y;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) {
            const size_t at = texel_at(x + i, y + j, frame);
            const float3 c = to_ycocg(vload4(at, current).xyz);
            sum += c;
            squares += c * c;
            if (i == 0 && j == 0)
                centre = c;
            if (inverse_depth[at] > nearest) {
                nearest = inverse_depth[at];
                nearest_x = x + i;
                nearest_y = y + j;
            }
        }
    const float3 mean = sum / 9.0f;
    const float3 deviation = sqrt(max(squares / 9.0f - mean * mean, 0.0f));

    const float px = nearest_x + frame.origin_x, py = nearest_y + frame.origin_y;
    const float dx = frame.xx * px + frame.xy * py + frame.xq * nearest + frame.x1;
    const float dy = frame.yx * px + frame.yy * py + frame.yq * nearest + frame.y1;
    const float dw = frame.wx * px + frame.wy * py + frame.wq * nearest + frame.w1;
    const float u = (dx - px * dw) / (1.0f + dw), v = (dy - py * dw) / (1.0f + dw);
    const float hx = x + u, hy = y + v;

    const float fx = hx - floor(hx), fy = hy - floor(hy);
    const int bx = (int)floor(hx), by = (int)floor(hy);
    float wx[4], wy[4];
    catmull_rom_weights(fx, wx);
    catmull_rom_weights(fy, wy);
    float3 past = 0.0f;
    float count = 0.0f;
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i) {
            const float4 texel_value = vload4(texel_at(bx + i - 1, by + j - 1, frame), history);
            past += wx[i] * wy[j] * texel_value.xyz;
            if ((i == 1 || i == 2) && (j == 1 || j == 2))
                count += (i == 1 ? 1.0f - fx : fx) * (j == 1 ? 1.0f - fy : fy) * texel_value.w;
        }
    const int seen
        = !frame.reset && hx >= -0.5f && hy >= -0.5f && hx <= frame.width - 0.5f && hy <= frame.height - 0.5f;

    const float speed = max(fabs(u), fabs(v)) / settings.motion_px;
    const float gamma = mix(settings.box_scale_moving, settings.box_scale_static, max(1.0f - speed, 0.0f));
    const float size = max(fabs(mean.x), max(fabs(mean.y), fabs(mean.z)));
    const float3 extent = max(gamma * deviation, settings.box_floor * size + 1e-30f);
    const float3 boxed_past = to_ycocg(past), away = fabs((boxed_past - mean) / extent);
    const float outside = max(away.x, max(away.y, away.z));
    const float3 held = outside > 1.0f ? mean + (boxed_past - mean) / outside : boxed_past;

    count = min(count, settings.sample_limit);
    const float weight = max(1.0f / (count + 1.0f), settings.blend_weight);
    const float for_current = weight * (settings.luminance_knee + max(held.x, 0.0f));
    const float for_history = (1.0f - weight) * (settings.luminance_knee + max(centre.x, 0.0f));
    const float3 blended = held + (for_current / (for_current + for_history)) * (centre - held);
    const float3 out = max(from_ycocg(seen ? blended : centre), 0.0f);
    vstore4((float4)(out, seen ? count + 1.0f : 1.0f), (size_t)y * frame.width + x, output);
}
