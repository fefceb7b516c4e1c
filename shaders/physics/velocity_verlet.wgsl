// Velocity Verlet, first half: v½ = v + ½h a, x' = x + h v½.

#import lib/move

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = item(id, groups);
    if i >= params.nodes || status.failed != 0u {
        return;
    }
    let x = textureLoad(positions, at(i), 0);
    let v = textureLoad(velocities, at(i), 0);
    let w = v.xyz + params.kick * acceleration(i);
    store(i, x, params.dt * w, vec4(w, v.w));
}
