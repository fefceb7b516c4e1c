// Computes the next trial state: the maximum allowed step along the direction.

#import lib/workgroup_min
#import lib/status
#import lib/tool

struct TrialParams {
    nodes: u32,
    // Number of workgroups that wrote a fraction of the direction, and whether it comes near a
    // tool.
    groups: u32,
    dt: f32,
    _pad0: u32,
}

@group(0) @binding(0) var start_positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var direction: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> partial_minima: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> status: Status;
@group(0) @binding(5) var<storage, read_write> contact_state: ContactStepState;
@group(0) @binding(6) var trial_positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var trial_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var<uniform> params: TrialParams;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    var fraction = 1.0;
    var is_far = 1.0;
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        fraction = min(fraction, partial_minima[k].x);
        is_far = min(is_far, partial_minima[k].y);
    }
    let step_length = min(workgroup_min(fraction, lane), contact_state.trial_length);
    let is_far_from_tools = workgroup_min(is_far, lane);
    if id.x == 0u {
        contact_state.last_length = step_length;
        if contact_state.is_first_system != 0u {
            contact_state.may_contact = select(0u, 1u, is_far_from_tools <= 0.0);
        }
    }
    for (var i = id.x; i < params.nodes; i += groups.x * WORKGROUP) {
        let x = textureLoad(start_positions, array_texel(i), 0);
        var v = step_length * textureLoad(direction, array_texel(i), 0).xyz;
        if contact_state.is_first_system == 0u {
            v += textureLoad(velocities, array_texel(i), 0).xyz;
        }
        textureStore(trial_positions, array_texel(i), vec4(x.xyz + params.dt * v, x.w));
        textureStore(trial_velocities, array_texel(i), vec4(v, 0.0));
    }
}
