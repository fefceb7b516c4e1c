// Each way of a ray through a piece of a body, told by itself: what pieces make of one ray is
// composited when all are known.
#term intervals

struct RaySegment {
    // Column, and row from bit 16 on.
    pixel: u32,
    // z of camera space where it begins and ends.
    front: f32,
    back: f32,
    _pad: u32,
    // Premultiplied colour, and opacity.
    seen: vec4<f32>,
}

struct RaySegments {
    // How many there are, also where there was no room for all.
    count: atomic<u32>,
    items: array<RaySegment>,
}

@group(0) @binding(next) var<storage, read_write> intervals: RaySegments;

// Tells a way, unless nothing is seen on it.
fn append_segment(pixel: vec2<u32>, walked: TraversalResult) {
    if all(walked.sum == vec4(0.0)) {
        return;
    }
    let slot = atomicAdd(&intervals.count, 1u);
    if slot < arrayLength(&intervals.items) {
        intervals.items[slot] = RaySegment(pixel.x | (pixel.y << 16u), walked.reach.x, walked.reach.y, 0u, walked.sum);
    }
}
