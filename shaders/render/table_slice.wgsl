// Computes one slice of the table from the slice of half its depth: a segment is composited from
// two of half the length, front to back. Incremental pre-integration after Weiler et al. (2003), by
// doubling. The mean extinction is the same at every depth.

#import lib/bilinear

struct Slice {
    size: u32,
    // Depth of a half, in the table's unit (extinction 1, log2).
    half_depth: f32,
}

@group(0) @binding(0) var halves: texture_2d<f32>;
@group(0) @binding(1) var whole: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var layer: texture_storage_2d<rgba16float, write>;
@group(0) @binding(3) var<uniform> params: Slice;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.size || id.y >= params.size {
        return;
    }
    let s = vec2<f32>(id.xy);
    let middle = 0.5 * (s.x + s.y);
    let front = bilinear(halves, params.size, vec2(s.x, middle));
    let back = bilinear(halves, params.size, vec2(middle, s.y));
    let front_alpha = 1.0 - exp2(-front.a * params.half_depth);
    let back_alpha = (1.0 - front_alpha) * (1.0 - exp2(-back.a * params.half_depth));
    let alpha = front_alpha + back_alpha;
    var mean = textureLoad(halves, id.xy, 0);
    if alpha > 1e-6 {
        mean = vec4((front_alpha * front.rgb + back_alpha * back.rgb) / alpha, mean.a);
    }
    textureStore(whole, id.xy, mean);
    textureStore(layer, id.xy, mean);
}
