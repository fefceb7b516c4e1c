// Counts how often each ray leaves the mesh: sums its back-facing boundary faces, in 255ths, by
// blending. Used for reports.

#import lib/array
#import lib/view
#import lib/tet
#import lib/ray_projection

@group(0) @binding(0) var projected: texture_2d<f32>;
// Nodes of each boundary face, counter-clockwise from outside, and 4 tet + face.
@group(0) @binding(1) var boundary: texture_2d<u32>;
@group(0) @binding(2) var<uniform> params: View;

fn projected_at(i: u32) -> vec4<f32> {
    return textureLoad(projected, array_texel(i), 0);
}

fn boundary_at(i: u32) -> vec4<u32> {
    return textureLoad(boundary, array_texel(i), 0);
}

#import lib/face

struct Corner {
    @invariant @builtin(position) position: vec4<f32>,
    // Nodes of the face and their ids, the same at its three corners.
    @location(0) @interpolate(flat) a: vec3<f32>,
    @location(1) @interpolate(flat) b: vec3<f32>,
    @location(2) @interpolate(flat) c: vec3<f32>,
    @location(3) @interpolate(flat) ids: vec4<u32>,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    let face = face_of(index / 3u);
    let position = vec4(face.corners[index % 3u], 0.5, 1.0);
    return Corner(position, face.nodes[0], face.nodes[1], face.nodes[2], face.ids);
}

@fragment
fn fragment(corner: Corner) -> @location(0) vec4<f32> {
    if !intersect_face(corner.a, corner.b, corner.c, corner.ids, ray_frame(params, corner.position.xy)).found {
        discard;
    }
    return vec4(1.0 / 255.0, 0.0, 0.0, 0.0);
}
