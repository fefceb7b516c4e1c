// Draws the lit boundary of the deformed mesh, with clip planes and two-sided lighting.

#import lib/array
#import lib/view
#import lib/light
#import lib/clip

// Whether node normals are used instead of face normals.
override SMOOTH: bool = true;

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var boundary: texture_2d<u32>;
@group(0) @binding(2) var normals: texture_2d<f32>;
@group(0) @binding(3) var colours: texture_2d<f32>;
@group(0) @binding(4) var<uniform> params: View;

struct Corner {
    @builtin(position) position: vec4<f32>,
    // In camera space: position and outward normal.
    @location(0) place: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec3<f32>,
    // In the local frame: current position and rest position.
    @location(3) local: vec3<f32>,
    @location(4) rest: vec3<f32>,
}

fn turned(v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(params.right.xyz, v), dot(params.up.xyz, v), dot(params.forward.xyz, v));
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    let face = textureLoad(boundary, array_texel(index / 3u), 0);
    let node = face[index % 3u];
    let p = textureLoad(positions, array_texel(node), 0).xyz;
    var normal = textureLoad(normals, array_texel(node), 0).xyz;
    if !SMOOTH {
        let a = textureLoad(positions, array_texel(face.x), 0).xyz;
        let b = textureLoad(positions, array_texel(face.y), 0).xyz;
        let c = textureLoad(positions, array_texel(face.z), 0).xyz;
        normal = cross(b - a, c - a);
        normal *= inverseSqrt(max(dot(normal, normal), 1e-37));
    }
    let q = to_camera(params, p);
    var rest = p;
    if USE_REST_POSITIONS {
        rest = textureLoad(rests, array_texel(node), 0).xyz;
    }
    return Corner(to_clip(params, q), q, turned(normal), textureLoad(colours, array_texel(node), 0).rgb, p, rest);
}

@fragment
fn fragment(corner: Corner, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    if CLIP_PLANE_COUNT > 0u && is_clipped(corner.local, corner.rest) {
        discard;
    }
    let normal = normalize(corner.normal) * select(-1.0, 1.0, front);
    return vec4(shade_surface_point(corner.colour, normal, view_direction(params, corner.place)), 1.0);
}
