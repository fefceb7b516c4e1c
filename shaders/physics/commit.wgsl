// Copies the candidate state to the current state if it was accepted.

#import lib/array
#import lib/status

@group(0) @binding(0) var next_positions: texture_2d<f32>;
@group(0) @binding(1) var next_velocities: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> status: Status;
@group(0) @binding(3) var positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var velocities: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    if status.failed != 0u || status.accepted == 0u {
        return;
    }
    // Items past the last node write to texels that are never read.
    let i = invocation_index(id, groups);
    textureStore(positions, array_texel(i), textureLoad(next_positions, array_texel(i), 0));
    textureStore(velocities, array_texel(i), textureLoad(next_velocities, array_texel(i), 0));
}
