// Directional derivative of the incremental potential at the start of the line search and at the
// trial: dot products of residuals and directions.

#import lib/workgroup_sum
#import lib/status

struct SlopeParams {
    nodes: u32,
    dt: f32,
    // First row of the right side in `preconditioner`.
    right: u32,
    _pad0: u32,
}

@group(0) @binding(0) var trial_velocities: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var direction: texture_2d<f32>;
@group(0) @binding(3) var masses: texture_2d<f32>;
@group(0) @binding(4) var forces: texture_2d<f32>;
// Residual at the start, from `physics/implicit_euler_begin`.
@group(0) @binding(5) var preconditioner: texture_2d<f32>;
@group(0) @binding(6) var<storage, read> status: Status;
@group(0) @binding(7) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(8) var<uniform> params: SlopeParams;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    var sum = vec4(0.0);
    for (var i = id.x; i < params.nodes; i += groups.x * WORKGROUP) {
        // Zero for pinned nodes.
        let velocity_change = textureLoad(direction, array_texel(i), 0).xyz;
        let change = textureLoad(velocities, array_texel(i), 0).xyz - textureLoad(trial_velocities, array_texel(i), 0).xyz;
        let residual = textureLoad(masses, array_texel(i), 0).x * change + params.dt * textureLoad(forces, array_texel(i), 0).xyz;
        let initial_residual = textureLoad(preconditioner, array_texel(params.right + i), 0).xyz;
        sum += vec4(dot(velocity_change, initial_residual), dot(velocity_change, residual), 0.0, 0.0);
    }
    let total = reduce(sum, lane);
    if lane == 0u {
        partials[group.x] = total;
    }
}
