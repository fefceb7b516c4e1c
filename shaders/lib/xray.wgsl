// How strongly what a scalar stands for attenuates X-rays. The twin of `render::xray`. Needs lib/view,
// `tets` and `rests`, and `corner_at` of the walk that imports it.

// The share of the way from air to water, or of the range, below which ends of a stretch are alike.
const SMALL_DIFFERENCE: f32 = 0.01;
// Of a tet as it was at rest: less is taken for this.
const MIN_VOLUME_RATIO: f32 = 1e-4;

// Attenuation at a share of the range, per file unit.
fn attenuation(s: f32) -> f32 {
    let x = params.xray;
    let beyond = (s - x.y) / (x.y - x.x);
    return x.z * max(1.0 + beyond * select(1.0, x.w, beyond > 0.0), 0.0);
}

// Its integral from air.
fn attenuation_integral(s: f32) -> f32 {
    let x = params.xray;
    let span = x.y - x.x;
    let low = clamp(s - x.x, 0.0, span);
    let high = max(s - x.y, 0.0);
    return x.z * (0.5 * low * low / span + high + 0.5 * x.w * high * high / span);
}

// The mean between two shares.
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

// How many times as dense a tet is as it was at rest: 1 / J.
fn density_ratio(tet: u32) -> f32 {
    let v = textureLoad(tets, array_texel(tet), 0);
    let now = volume_of(corner_at(v.x), corner_at(v.y), corner_at(v.z), corner_at(v.w));
    let before = volume_of(rest_at(v.x), rest_at(v.y), rest_at(v.z), rest_at(v.w));
    return abs(before) / max(abs(now), MIN_VOLUME_RATIO * abs(before));
}
