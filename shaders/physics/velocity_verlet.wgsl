// Velocity Verlet, first half: x' = x + h (v + ½h a), and the predicted velocity v + h a for the
// damping at x'. The prediction is first order in h, which keeps the scheme second order.

#import lib/explicit_state

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u {
        return;
    }
    let x = textureLoad(positions, array_texel(i), 0);
    let v = textureLoad(velocities, array_texel(i), 0);
    let change = params.kick * acceleration(i);
    store(i, x, params.dt * (v.xyz + change), vec4(v.xyz + 2.0 * change, v.w));
}
