// Deforms a fine mesh with its cage: interpolates the node positions of the cage tets with
// barycentric weights. CPU reference: `BarycentricMap::apply`.

#import lib/array

struct Carry {
    // Transform from the cage's frame to the fine mesh's frame: translation in xyz, scale in w.
    to_fine: vec4<f32>,
    nodes: u32,
}

@group(0) @binding(0) var cage: texture_2d<f32>;
// Nodes of the cage tet that contains each fine node, and their barycentric weights.
@group(0) @binding(1) var corners: texture_2d<u32>;
@group(0) @binding(2) var weights: texture_2d<f32>;
@group(0) @binding(3) var positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: Carry;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let v = textureLoad(corners, array_texel(i), 0);
    let w = textureLoad(weights, array_texel(i), 0);
    // Interpolates differences, so that rounded weights reproduce translations exactly.
    let a = textureLoad(cage, array_texel(v.x), 0).xyz;
    let b = textureLoad(cage, array_texel(v.y), 0).xyz - a;
    let c = textureLoad(cage, array_texel(v.z), 0).xyz - a;
    let d = textureLoad(cage, array_texel(v.w), 0).xyz - a;
    let p = a + (w.y * b + w.z * c + w.w * d);
    textureStore(positions, array_texel(i), vec4(params.to_fine.w * p + params.to_fine.xyz, 1.0));
}
