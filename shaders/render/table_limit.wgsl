// Computes the first slice of the table, the limit of short segments: extinction-weighted mean
// colour, and mean extinction, between every two scalars. Also the first slab of the paper's
// volume.

#import lib/linear_pieces

struct Limit {
    // Texels along each scalar axis.
    size: u32,
    pieces: u32,
}

@group(0) @binding(0) var<storage, read> pieces: array<Piece>;
@group(0) @binding(1) var limit: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var<uniform> params: Limit;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.size || id.y >= params.size {
        return;
    }
    let s = vec2<f32>(id.xy) / f32(params.size - 1u);
    // A narrow interval represents a single scalar.
    let low = min(s.x, s.y) - 1e-5;
    let high = max(s.x, s.y) + 1e-5;
    var colour = vec4(0.0);
    var emission = vec4(0.0);
    for (var i = 0u; i < params.pieces; i++) {
        let found = part(pieces[i], low, high);
        colour += found.colour;
        emission += found.emission;
    }
    // Without extinction the unweighted mean avoids black bleeding in by interpolation.
    let mean = select(colour.rgb / colour.a, emission.rgb / emission.a, emission.a > 1e-12 * colour.a);
    textureStore(limit, id.xy, vec4(mean, emission.a / colour.a));
}
