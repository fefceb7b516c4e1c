// Accepts the trial state for the next iteration, and updates the friction state when required.

#import lib/array
#import lib/status
#import lib/tool

struct AcceptParams {
    nodes: u32,
}

@group(0) @binding(0) var trial_positions: texture_2d<f32>;
@group(0) @binding(1) var trial_velocities: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> status: Status;
@group(0) @binding(3) var<storage, read> contact_state: ContactStepState;
@group(0) @binding(4) var next_positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var next_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var lagged_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var<uniform> params: AcceptParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u || status.solving != 0u {
        return;
    }
    let velocity = textureLoad(trial_velocities, array_texel(i), 0);
    textureStore(next_positions, array_texel(i), textureLoad(trial_positions, array_texel(i), 0));
    textureStore(next_velocities, array_texel(i), velocity);
    if contact_state.update_lagged_friction != 0u {
        // Before the first system: the start of the step.
        textureStore(lagged_velocities, array_texel(i), select(velocity, vec4(0.0), contact_state.is_first_system != 0u));
    }
}
