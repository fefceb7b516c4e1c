// Lighting of surfaces, in camera space. Needs lib/view.

// Returns the unit vector to the eye, which is at z = -depth.w, or at infinity if orthographic.
fn view_direction(view: View, place: vec3<f32>) -> vec3<f32> {
    let eye = vec3(0.0, 0.0, -view.depth.w);
    return normalize(select(vec3(0.0, 0.0, -1.0), eye - place, view.depth.z > 0.0));
}

// A key light from above the viewer's left shoulder, and a weak headlight.
fn shade_surface_point(colour: vec3<f32>, normal: vec3<f32>, eye: vec3<f32>) -> vec3<f32> {
    let key = normalize(vec3(-0.45, 0.65, -0.65));
    let light = 0.18 + 0.62 * max(dot(normal, key), 0.0) + 0.2 * max(dot(normal, eye), 0.0);
    let shine = 0.12 * pow(max(dot(normal, normalize(key + eye)), 0.0), 40.0);
    return min(colour * light + shine, vec3(1.0));
}
