// Rotations as unit quaternions with the real part last.

// Returns the displacement of v under the rotation.
fn rotation_displacement(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

fn quat_rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return v + rotation_displacement(q, v);
}

// Returns the inverse rotation.
fn quat_conjugate(q: vec4<f32>) -> vec4<f32> {
    return vec4(-q.xyz, q.w);
}
