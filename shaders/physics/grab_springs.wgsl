// Springs from nodes to their targets, with a force limit: added to the external forces.

#import lib/array

struct GrabSpringParams {
    count: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
// Node numbers.
@group(0) @binding(1) var node_indices: texture_2d<u32>;
// Targets in local units; w: stiffness in newtons per local unit.
@group(0) @binding(2) var targets: texture_2d<f32>;
// External forces without the springs, N; w: the maximum spring force, N.
@group(0) @binding(3) var loads: texture_2d<f32>;
@group(0) @binding(4) var external_forces: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: GrabSpringParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.count {
        return;
    }
    let i = textureLoad(node_indices, array_texel(n), 0).x;
    let target_and_stiffness = textureLoad(targets, array_texel(n), 0);
    let load = textureLoad(loads, array_texel(n), 0);
    let spring_force = target_and_stiffness.w * (target_and_stiffness.xyz - textureLoad(positions, array_texel(i), 0).xyz);
    let limited_force = spring_force * min(1.0, load.w / max(length(spring_force), 1e-30));
    textureStore(external_forces, array_texel(i), vec4(load.xyz + limited_force, 0.0));
}
