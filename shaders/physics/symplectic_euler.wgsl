// Symplectic Euler: v' = v + h a, x' = x + h v'.

#import lib/explicit_state

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u {
        return;
    }
    let x = textureLoad(positions, array_texel(i), 0);
    let v = textureLoad(velocities, array_texel(i), 0);
    let w = v.xyz + params.dt * acceleration(i);
    store(i, x, params.dt * w, vec4(w, v.w));
}
