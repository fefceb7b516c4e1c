// The camera in the local frame. Host side: `render::view`.
//
// Camera space: x to the right, y up, z along the view, measured from the plane through the local
// origin, so that a distant camera loses no accuracy. Pixel p sees the line (x, y)(z) = origin(p) +
// slope(p) * z, with slope 0 in an orthographic view.

struct View {
    // Axes of camera space; w is the translation.
    right: vec4<f32>,
    up: vec4<f32>,
    forward: vec4<f32>,
    // slope(p) = slope.xy * p + slope.zw, origin(p) = base.xy * p + base.zw
    slope: vec4<f32>,
    base: vec4<f32>,
    // x and y of clip space: clip.xy * (x, y) + clip.zw * w
    clip: vec4<f32>,
    // z and w of clip space: depth.x * z + depth.y and depth.z * z + depth.w. Depth decreases from
    // 1 at the near plane (reversed), which preserves relative accuracy in 32 bits.
    depth: vec4<f32>,
    // Scalar (0 to 1 over the field's range) to table coordinate: scalar.x * s + scalar.y
    scalar: vec2<f32>,
    // z of the near plane.
    near: f32,
    // File units per local unit.
    unit: f32,
    // Largest extinction per local unit, times log2(e).
    opacity: f32,
    nodes: u32,
    // Vertices of the boundary: three per face.
    corners: u32,
    // Maximum number of traversal steps.
    max_steps: u32,
    // Number of layers of the table, and the depth of the last layer in the paper's form.
    layers: u32,
    table_max_depth: f32,
    // Pixel size in clip space (w = 1).
    pixel: vec2<f32>,
    // Unit direction towards the light, in the local frame; w is 1 for a headlight.
    light: vec4<f32>,
    // X-ray parameters: normalised values of air and water, attenuation of water per file unit, and
    // the relative slope beyond water.
    xray: vec4<f32>,
}

fn to_camera(view: View, p: vec3<f32>) -> vec3<f32> {
    return vec3(dot(view.right.xyz, p) + view.right.w, dot(view.up.xyz, p) + view.up.w, dot(view.forward.xyz, p) + view.forward.w);
}

fn to_clip(view: View, q: vec3<f32>) -> vec4<f32> {
    let w = view.depth.z * q.z + view.depth.w;
    return vec4(view.clip.xy * q.xy + view.clip.zw * w, view.depth.x * q.z + view.depth.y, w);
}

// Returns the z of a depth value of this view.
fn z_of_depth(view: View, depth: f32) -> f32 {
    // depth = (a z + b) / (c z + d), solved for z
    let below = view.depth.x - depth * view.depth.z;
    return (depth * view.depth.w - view.depth.y) / select(below, -1e-30, abs(below) < 1e-30);
}

// Returns the depth of a point at z.
fn depth_of_z(view: View, z: f32) -> f32 {
    return (view.depth.x * z + view.depth.y) / (view.depth.z * z + view.depth.w);
}
