// For each tet, the affine map from places in the deformed body to a vector that each node has, such as
// its rest position: three texels, dot(row.xyz, place) + row.w along each axis.

#import lib/array

struct Maps {
    tets: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var vectors: texture_2d<f32>;
@group(0) @binding(2) var tets: texture_2d<u32>;
@group(0) @binding(3) var maps: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: Maps;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation_index(id, groups);
    if t >= params.tets {
        return;
    }
    let ids = textureLoad(tets, array_texel(t), 0);
    var p: array<vec3<f32>, 4>;
    var r: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        p[k] = textureLoad(positions, array_texel(ids[k]), 0).xyz;
        r[k] = textureLoad(vectors, array_texel(ids[k]), 0).xyz;
    }
    let a = p[1] - p[0];
    let b = p[2] - p[0];
    let c = p[3] - p[0];
    let volume = dot(a, cross(b, c));
    // A degenerate tet keeps the vector of its first node.
    let over = select(1.0 / volume, 0.0, abs(volume) < 1e-30);
    let x = cross(b, c) * over;
    let y = cross(c, a) * over;
    let z = cross(a, b) * over;
    for (var axis = 0u; axis < 3u; axis++) {
        let row = x * (r[1][axis] - r[0][axis]) + y * (r[2][axis] - r[0][axis]) + z * (r[3][axis] - r[0][axis]);
        textureStore(maps, array_texel(3u * t + axis), vec4(row, r[0][axis] - dot(row, p[0])));
    }
}
