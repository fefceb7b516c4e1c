// Clip planes for surfaces: fragments beyond a plane are discarded. Needs lib/array.

// Number of clip planes.
override CLIP_PLANE_COUNT: u32 = 0u;
// Whether any plane is defined in the rest configuration.
override USE_REST_POSITIONS: bool = false;

// Two texels per plane, as in lib/sections.
@group(0) @binding(next) var cuts: texture_2d<f32>;
// Rest positions of the nodes, in the local frame; if USE_REST_POSITIONS.
@group(0) @binding(next) var rests: texture_2d<f32>;

// Whether a point, whose rest position is `rest`, is clipped.
fn is_clipped(place: vec3<f32>, rest: vec3<f32>) -> bool {
    var clipped = false;
    for (var k = 0u; k < CLIP_PLANE_COUNT; k++) {
        let plane = textureLoad(cuts, array_texel(2u * k), 0);
        let resting = textureLoad(cuts, array_texel(2u * k + 1u), 0).x > 0.5;
        clipped = clipped || dot(plane.xyz, select(place, rest, resting)) > plane.w;
    }
    return clipped;
}
