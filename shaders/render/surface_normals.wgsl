// Computes area-weighted normals of the boundary nodes, whenever the boundary is drawn.

#import lib/array

struct Normals {
    nodes: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var boundary: texture_2d<u32>;
// Row offsets: `around[firsts[i]]` to `around[firsts[i + 1] - 1]` are the faces around node i.
@group(0) @binding(2) var firsts: texture_2d<u32>;
// Boundary faces around each node.
@group(0) @binding(3) var around: texture_2d<u32>;
@group(0) @binding(4) var normals: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: Normals;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let last = textureLoad(firsts, array_texel(i + 1u), 0).x;
    var sum = vec3(0.0);
    for (var k = textureLoad(firsts, array_texel(i), 0).x; k < last; k++) {
        let face = textureLoad(boundary, array_texel(textureLoad(around, array_texel(k), 0).x), 0);
        let a = textureLoad(positions, array_texel(face.x), 0).xyz;
        let b = textureLoad(positions, array_texel(face.y), 0).xyz;
        let c = textureLoad(positions, array_texel(face.z), 0).xyz;
        sum += cross(b - a, c - a);
    }
    textureStore(normals, array_texel(i), vec4(sum * inverseSqrt(max(dot(sum, sum), 1e-37)), 0.0));
}
