// Shows the means of the samples so far of a tile of a picture by light paths: tone mapped, in sRGB, over
// a backdrop. Pixels without samples show the backdrop.

struct Show {
    // Red, green and blue behind the body, and the light that is shown as white.
    backdrop: vec4<f32>,
    size: vec2<u32>,
    // Pixels per row of the result.
    stride: u32,
    exposure: f32,
}

@group(0) @binding(0) var<storage, read> sums: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> shown: array<u32>;
@group(0) @binding(2) var<uniform> params: Show;

fn filmic(x: vec3<f32>) -> vec3<f32> {
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
}

fn srgb(x: vec3<f32>) -> vec3<f32> {
    return select(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, x <= vec3(0.0031308));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= params.size) {
        return;
    }
    let i = 2u * (id.y * params.size.x + id.x);
    let mean = sums[i] / max(sums[i + 1u].y, 1.0);
    let light = max(params.exposure * mean.xyz / max(mean.w, 1e-6), vec3(0.0));
    let tone = srgb(min(filmic(light) / filmic(vec3(params.backdrop.w)), vec3(1.0)));
    let colour = tone * mean.w + (1.0 - mean.w) * params.backdrop.xyz;
    shown[id.y * params.stride + id.x] = pack4x8unorm(vec4(colour, 1.0));
}
