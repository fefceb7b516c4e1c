// Samples the transfer function, colour and extinction, to one line of texels: the table for point
// sampling of tets without pre-integration.

#import lib/linear_pieces

struct Limit {
    // Texels along the scalar.
    size: u32,
    pieces: u32,
}

@group(0) @binding(0) var<storage, read> pieces: array<Piece>;
@group(0) @binding(1) var whole: texture_storage_2d<rgba32float, write>;
@group(0) @binding(2) var layer: texture_storage_2d<rgba16float, write>;
@group(0) @binding(3) var<uniform> params: Limit;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.size || id.y >= 1u {
        return;
    }
    let s = f32(id.x) / f32(params.size - 1u);
    var colour = vec4(0.0);
    var emission = vec4(0.0);
    for (var i = 0u; i < params.pieces; i++) {
        // A narrow interval represents a single scalar.
        let found = part(pieces[i], s - 1e-5, s + 1e-5);
        colour += found.colour;
        emission += found.emission;
    }
    let mean = vec4(colour.rgb, emission.a) / colour.a;
    textureStore(whole, id.xy, mean);
    textureStore(layer, id.xy, mean);
}
