// What clip planes leave of a surface: fragments beyond one are dropped. Needs lib/array.

// Planes that cut off what lies beyond them.
override CLIP_PLANE_COUNT: u32 = 0u;
// Whether any is given where the body rests.
override USE_REST_POSITIONS: bool = false;

// As in lib/inside: two texels a plane.
@group(0) @binding(next) var cuts: texture_2d<f32>;
// Where the nodes rest, in the local frame; if RESTING.
@group(0) @binding(next) var rests: texture_2d<f32>;

// Whether a place, which lies at `rest` when the body rests, is cut off.
fn is_clipped(place: vec3<f32>, rest: vec3<f32>) -> bool {
    var gone = false;
    for (var k = 0u; k < CLIP_PLANE_COUNT; k++) {
        let plane = textureLoad(cuts, array_texel(2u * k), 0);
        let resting = textureLoad(cuts, array_texel(2u * k + 1u), 0).x > 0.5;
        gone = gone || dot(plane.xyz, select(place, rest, resting)) > plane.w;
    }
    return gone;
}
