// The surroundings that light a body: a map of equal-area texels (Lambert's cylindrical projection),
// sampled by brightness with an alias table (Walker 1977). Needs lib/array, lib/path_random, lib/path_lobes and
// `params: Path`. Host side: `render::path::environment`.

// `sky_item` gives two items per texel: colour and the density per solid angle with which it is sampled; then the
// probability that it keeps a sample, and the texel that takes it otherwise.
// Returns the colour in a direction, and the density of sample_sky there.
fn sky_at(d: vec3<f32>) -> vec4<f32> {
    let m = vec3(dot(params.sky_x.xyz, d), dot(params.sky_y.xyz, d), dot(params.sky_z.xyz, d));
    let turn = atan2(m.x, m.z) / (2.0 * PI) + 0.5;
    let size = vec2<f32>(params.sky_size);
    let column = min(u32(max(turn, 0.0) * size.x), params.sky_size.x - 1u);
    let row = min(u32(clamp(0.5 - 0.5 * m.y, 0.0, 1.0) * size.y), params.sky_size.y - 1u);
    return sky_item(2u * (row * params.sky_size.x + column));
}

struct SkySample {
    direction: vec3<f32>,
    colour: vec3<f32>,
    density: f32,
}

fn sample_sky() -> SkySample {
    let count = params.sky_size.x * params.sky_size.y;
    var k = min(u32(random() * f32(count)), count - 1u);
    let alias_entry = sky_item(2u * k + 1u);
    if random() >= alias_entry.x {
        k = u32(alias_entry.y);
    }
    let texel = sky_item(2u * k);
    let at = (vec2(f32(k % params.sky_size.x), f32(k / params.sky_size.x)) + vec2(random(), random())) / vec2<f32>(params.sky_size);
    let turn = 2.0 * PI * (at.x - 0.5);
    let y = 1.0 - 2.0 * at.y;
    let r = sqrt(max(1.0 - y * y, 0.0));
    let m = vec3(r * sin(turn), y, r * cos(turn));
    let d = m.x * params.sky_x.xyz + m.y * params.sky_y.xyz + m.z * params.sky_z.xyz;
    return SkySample(d, texel.rgb, texel.w);
}
