// Prescribed displacements (Dirichlet condition): sets nodes to their targets after every step.

#import lib/array

struct PrescribedPositionsParams {
    count: u32,
}

// Number of each constrained node (bits of a u32), and its target in local units.
@group(0) @binding(0) var node_indices: texture_2d<u32>;
@group(0) @binding(1) var targets: texture_2d<f32>;
@group(0) @binding(2) var next: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var<uniform> params: PrescribedPositionsParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.count {
        return;
    }
    textureStore(next, array_texel(textureLoad(node_indices, array_texel(n), 0).x), textureLoad(targets, array_texel(n), 0));
}
