// Computes one layer of the paper's table of colour and opacity over (s_front, s_back, depth) from
// the previous layer: a segment is split into a first slab and the rest. Incremental
// pre-integration after Weiler et al. (2003).

#import lib/bilinear

struct VolumeLayer {
    size: u32,
    // Layer to compute; a slab is one layer deep.
    layer: u32,
    // Depth of a slab, in the table's unit (extinction 1, log2).
    depth: f32,
}

// Mean colour and extinction of short segments; the first slab; the previous layer.
@group(0) @binding(0) var limit: texture_2d<f32>;
@group(0) @binding(1) var slab: texture_2d<f32>;
@group(0) @binding(2) var before: texture_2d<f32>;
@group(0) @binding(3) var whole: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var layer: texture_storage_2d<rgba16float, write>;
@group(0) @binding(5) var<uniform> params: VolumeLayer;

// Number of intervals over which the first slab is summed.
const PIECES: f32 = 32.0;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.size || id.y >= params.size {
        return;
    }
    let s = vec2<f32>(id.xy);
    var sum = vec4(0.0);
    if params.layer == 1u {
        for (var i = 0.0; i < PIECES; i += 1.0) {
            let ends = mix(vec2(s.x), vec2(s.y), vec2(i, i + 1.0) / PIECES);
            let mean = bilinear(limit, params.size, ends);
            let alpha = 1.0 - exp2(-mean.a * params.depth / PIECES);
            sum += (1.0 - sum.a) * alpha * vec4(mean.rgb, 1.0);
        }
    }
    if params.layer > 1u {
        let cut = mix(s.x, s.y, 1.0 / f32(params.layer));
        let front = bilinear(slab, params.size, vec2(s.x, cut));
        let back = bilinear(before, params.size, vec2(cut, s.y));
        sum = front + (1.0 - front.a) * back;
    }
    textureStore(whole, id.xy, sum);
    textureStore(layer, id.xy, sum);
}
