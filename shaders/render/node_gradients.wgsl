// Computes the shading gradients at the nodes: the volume-weighted gradient of the scalar over the
// adjacent tets and, where the body or a region ends, the inward normal. CPU reference:
// `render::light::node_gradients`.

#import lib/array

struct Gradients {
    nodes: u32,
    tets: u32,
    // Length of the normal at a boundary of the body or a region.
    edge: f32,
}

const NONE: u32 = 0xffffffffu;

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var scalars: texture_2d<f32>;
// Row offsets: `around[firsts[i]]` to `around[firsts[i + 1] - 1]` are the entries of node i.
@group(0) @binding(2) var firsts: texture_2d<u32>;
// The tets at each node; boundary faces are numbered after the tets.
@group(0) @binding(3) var around: texture_2d<u32>;
// The four nodes of each tet.
@group(0) @binding(4) var tets: texture_2d<u32>;
// The three nodes of each boundary face, ordered so that its normal points inwards, and NONE.
@group(0) @binding(5) var ends: texture_2d<u32>;
@group(0) @binding(6) var gradients: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var<uniform> params: Gradients;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    var rise = vec3(0.0);
    var volume = 0.0;
    var area = vec3(0.0);
    var areas = 0.0;
    let last = textureLoad(firsts, array_texel(i + 1u), 0).x;
    for (var k = textureLoad(firsts, array_texel(i), 0).x; k < last; k++) {
        let t = textureLoad(around, array_texel(k), 0).x;
        var v: vec4<u32>;
        if t < params.tets {
            v = textureLoad(tets, array_texel(t), 0);
        } else {
            v = textureLoad(ends, array_texel(t - params.tets), 0);
        }
        let p = textureLoad(positions, array_texel(v.x), 0).xyz;
        let a = textureLoad(positions, array_texel(v.y), 0).xyz - p;
        let b = textureLoad(positions, array_texel(v.z), 0).xyz - p;
        if v.w == NONE {
            let normal = cross(a, b);
            area += normal;
            areas += length(normal);
            continue;
        }
        let c = textureLoad(positions, array_texel(v.w), 0).xyz - p;
        let s = textureLoad(scalars, array_texel(v.x), 0).x;
        rise += (textureLoad(scalars, array_texel(v.y), 0).x - s) * cross(b, c)
            + (textureLoad(scalars, array_texel(v.z), 0).x - s) * cross(c, a)
            + (textureLoad(scalars, array_texel(v.w), 0).x - s) * cross(a, b);
        volume += dot(a, cross(b, c));
    }
    var gradient = vec3(0.0);
    // If the tet volumes cancel, as in an inverted body, the gradient is undefined.
    if abs(volume) > 1e-20 {
        gradient = rise / volume;
    }
    if areas > 0.0 {
        gradient += params.edge / areas * area;
    }
    textureStore(gradients, array_texel(i), vec4(gradient, 0.0));
}
