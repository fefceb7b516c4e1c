// Draws a skin at its deformed position, with clip planes and two-sided lighting.

#import lib/skin
#import lib/view
#import lib/light
#import lib/clip

// Whether a tangent-space normal map is used.
override NORMAL_MAP: bool = false;
// Whether a height map is used.
override HEIGHT_MAP: bool = false;
// Whether only fragments behind `nearer` are drawn (depth peeling).
override DEPTH_PEELED: bool = false;

struct SkinParams {
    view: View,
    opacity: f32,
    // Depth of the height map, in texture units.
    parallax_depth: f32,
    _pad0: u32,
    _pad1: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var node_normals: texture_2d<u32>;
@group(0) @binding(2) var vertices: texture_2d<u32>;
@group(0) @binding(3) var uvs: texture_2d<f32>;
@group(0) @binding(4) var colours: texture_2d<f32>;
@group(0) @binding(5) var normal_map: texture_2d<f32>;
@group(0) @binding(6) var height_map: texture_2d<f32>;
@group(0) @binding(7) var smooth_sampler: sampler;
@group(0) @binding(8) var nearer: texture_depth_2d;
@group(0) @binding(9) var<uniform> params: SkinParams;

struct Corner {
    @builtin(position) @invariant position: vec4<f32>,
    // In camera space: position, outward normal, and tangent along the first texture coordinate.
    @location(0) place: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) tangent: vec4<f32>,
    @location(3) colour: vec3<f32>,
    @location(4) uv: vec2<f32>,
    // In the local frame: current position and rest position.
    @location(5) local: vec3<f32>,
    @location(6) rest: vec3<f32>,
}

fn turned(v: vec3<f32>) -> vec3<f32> {
    let view = params.view;
    return vec3(dot(view.right.xyz, v), dot(view.up.xyz, v), dot(view.forward.xyz, v));
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    let v = skin_vertex(index);
    let q = to_camera(params.view, v.position);
    var rest = v.position;
    if USE_REST_POSITIONS {
        rest = textureLoad(rests, array_texel(index), 0).xyz;
    }
    return Corner(
        to_clip(params.view, q),
        q,
        turned(v.normal),
        vec4(turned(v.tangent.xyz), v.tangent.w),
        textureLoad(colours, array_texel(index), 0).rgb,
        textureLoad(uvs, array_texel(index), 0).xy,
        v.position,
        rest,
    );
}

// Image rows run downwards, the second texture coordinate upwards.
fn texel_at(uv: vec2<f32>) -> vec2<f32> {
    return vec2(uv.x, 1.0 - uv.y);
}

fn depth_at(uv: vec2<f32>) -> f32 {
    return 1.0 - textureSampleLevel(height_map, smooth_sampler, texel_at(uv), 0.0).r;
}

// Parallax mapping by ray marching: returns the texture coordinates at which the line of sight
// intersects the height field. `eye` points to the eye, in the tangent, bitangent, normal frame.
const PARALLAX_STEPS: u32 = 24u;
fn parallax_offset(uv: vec2<f32>, eye: vec3<f32>) -> vec2<f32> {
    let run = -eye.xy / max(eye.z, 0.15) * params.parallax_depth;
    var before = 0.0;
    var above = depth_at(uv);
    for (var i = 1u; i <= PARALLAX_STEPS; i++) {
        let now = f32(i) / f32(PARALLAX_STEPS);
        let gap = depth_at(uv + now * run) - now;
        if gap <= 0.0 {
            // Linear interpolation between the two steps.
            let share = above / max(above - gap, 1e-6);
            return uv + mix(before, now, share) * run;
        }
        before = now;
        above = gap;
    }
    return uv + run;
}

@fragment
fn fragment(corner: Corner, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    if CLIP_PLANE_COUNT > 0u && is_clipped(corner.local, corner.rest) {
        discard;
    }
    let pixel = vec2<u32>(corner.position.xy);
    if DEPTH_PEELED && corner.position.z >= textureLoad(nearer, pixel, 0) {
        discard;
    }
    let eye = view_direction(params.view, corner.place);
    var normal = normalize(corner.normal);
    let tangent = unit_or_zero(corner.tangent.xyz - normal * dot(normal, corner.tangent.xyz));
    // Bitangent, along the second texture coordinate; camera space is left-handed.
    let other = select(1.0, -1.0, corner.tangent.w > 0.0) * cross(normal, tangent);
    let side = select(-1.0, 1.0, front);
    var uv = corner.uv;
    if HEIGHT_MAP {
        uv = parallax_offset(uv, vec3(dot(eye, tangent), dot(eye, other), side * dot(eye, normal)));
    }
    if NORMAL_MAP {
        let texel = textureSampleLevel(normal_map, smooth_sampler, texel_at(uv), 0.0).xyz;
        let n = texel * 2.0 - 1.0;
        normal = unit_or_zero(n.x * tangent + n.y * other + n.z * normal);
    }
    let colour = shade_surface_point(corner.colour, side * normal, eye);
    return vec4(colour * params.opacity, params.opacity);
}
