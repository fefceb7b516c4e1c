// What a point looks like along a ray: its distance from the ray, sideways and upwards. The ray is
// the origin of a plane, and signed areas there tell on which side of an edge it passes. Starts
// and walks use the same arithmetic, so that they agree about every face. Needs lib/view.

// A ray as the walk sees it.
struct RayFrame {
    slope: vec2<f32>,
    origin: vec2<f32>,
}

fn ray_frame(view: View, pixel: vec2<f32>) -> RayFrame {
    return RayFrame(view.slope.xy * pixel + view.slope.zw, view.base.xy * pixel + view.base.zw);
}

// A point of camera space as seen along the ray.
fn project_to_ray_plane(q: vec3<f32>, sight: RayFrame) -> vec2<f32> {
    return q.xy - sight.origin - sight.slope * q.z;
}

fn cross2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

// Whether the ray passes on the inner side of the edge from a to b; of two faces that share an
// edge exactly one says so of a ray that meets it.
fn edge_test(w: f32, from_: u32, to: u32) -> bool {
    return w > 0.0 || (w == 0.0 && from_ < to);
}
