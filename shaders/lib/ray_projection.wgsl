// Projection of points along a ray: the ray is the origin of the projection plane, and signed areas
// there determine on which side of an edge it passes. Ray starts and traversals share this
// arithmetic, so their face tests are consistent. Needs lib/view.

// A ray as a line in camera space.
struct RayFrame {
    slope: vec2<f32>,
    origin: vec2<f32>,
}

fn ray_frame(view: View, pixel: vec2<f32>) -> RayFrame {
    return RayFrame(view.slope.xy * pixel + view.slope.zw, view.base.xy * pixel + view.base.zw);
}

// Returns the offset of a camera-space point from the ray.
fn project_to_ray_plane(q: vec3<f32>, frame: RayFrame) -> vec2<f32> {
    return q.xy - frame.origin - frame.slope * q.z;
}

fn cross2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// Whether the ray passes on the inner side of the edge from a to b. For a ray exactly on an edge,
// exactly one of the two adjacent faces accepts it.
fn edge_test(w: f32, from_: u32, to: u32) -> bool {
    return w > 0.0 || (w == 0.0 && from_ < to);
}
