// Records each ray segment through a piece of a body separately; the segments of all pieces along a
// ray are composited once all are known.
#term intervals

struct RaySegment {
    // Column in bits 0 to 15, row from bit 16 on.
    pixel: u32,
    // Camera-space z at which the segment begins and ends.
    front: f32,
    back: f32,
    _pad: u32,
    // Premultiplied colour, and opacity.
    seen: vec4<f32>,
}

struct RaySegments {
    // Number of segments, including those that did not fit into `items`.
    count: atomic<u32>,
    items: array<RaySegment>,
}

@group(0) @binding(next) var<storage, read_write> intervals: RaySegments;

// Appends a ray segment unless it is fully transparent.
fn append_segment(pixel: vec2<u32>, walked: TraversalResult) {
    if all(walked.sum == vec4(0.0)) {
        return;
    }
    let slot = atomicAdd(&intervals.count, 1u);
    if slot < arrayLength(&intervals.items) {
        intervals.items[slot] = RaySegment(pixel.x | (pixel.y << 16u), walked.depth_range.x, walked.depth_range.y, 0u, walked.sum);
    }
}
