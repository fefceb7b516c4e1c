// X-ray attenuation of scalar values. CPU reference: `render::xray`. Needs lib/view, `tets` and
// `rests`, and `corner_at` of the importing shader.

// Difference, relative to the air-water interval or the range, below which two values count as
// equal.
const SMALL_DIFFERENCE: f32 = 0.01;
// Lower bound of the current volume of a tet, relative to its rest volume.
const MIN_VOLUME_RATIO: f32 = 1e-4;

// Returns the attenuation of a normalised value, per file unit.
fn attenuation(s: f32) -> f32 {
    let x = params.xray;
    let beyond = (s - x.y) / (x.y - x.x);
    return x.z * max(1.0 + beyond * select(1.0, x.w, beyond > 0.0), 0.0);
}

// Returns the integral of the attenuation from air to s.
fn attenuation_integral(s: f32) -> f32 {
    let x = params.xray;
    let span = x.y - x.x;
    let low = clamp(s - x.x, 0.0, span);
    let high = max(s - x.y, 0.0);
    return x.z * (0.5 * low * low / span + high + 0.5 * x.w * high * high / span);
}

// Returns the mean attenuation between two normalised values.
fn mean_attenuation(a: f32, b: f32) -> f32 {
    if abs(b - a) < SMALL_DIFFERENCE * min(params.xray.y - params.xray.x, 1.0) {
        return (attenuation(a) + 4.0 * attenuation(0.5 * (a + b)) + attenuation(b)) / 6.0;
    }
    return (attenuation_integral(b) - attenuation_integral(a)) / (b - a);
}

fn volume_of(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, d: vec3<f32>) -> f32 {
    return dot(b - a, cross(c - a, d - a));
}

fn rest_at(i: u32) -> vec3<f32> {
    return textureLoad(rests, array_texel(i), 0).xyz;
}

// Returns the density of a tet relative to rest: 1 / J.
fn density_ratio(tet: u32) -> f32 {
    let v = textureLoad(tets, array_texel(tet), 0);
    let now = volume_of(corner_at(v.x), corner_at(v.y), corner_at(v.z), corner_at(v.w));
    let before = volume_of(rest_at(v.x), rest_at(v.y), rest_at(v.z), rest_at(v.w));
    return abs(before) / max(abs(now), MIN_VOLUME_RATIO * abs(before));
}
