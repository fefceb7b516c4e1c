// Data that mesh traversal reads at each step, loaded from sampled textures, which GPUs cache.
#term reads

#for render/walk_vertices
@group(0) @binding(next) var projected: texture_2d<f32>;
// At 4 t + k, across the face opposite the k-th smallest node of tet t: the neighbour, and the
// exclusive or of its nodes.
@group(0) @binding(next) var links: texture_2d<u32>;
// The gradient at each node, if PER_NODE_LIGHT; w is the fraction of light that reaches it, if
// SHADOWS.
@group(0) @binding(next) var gradients: texture_2d<f32>;

fn projected_at(i: u32) -> vec4<f32> {
    return textureLoad(projected, array_texel(i), 0);
}

fn link_at(i: u32) -> vec2<u32> {
    return textureLoad(links, array_texel(i), 0).xy;
}

fn gradient_at(i: u32) -> vec4<f32> {
    return textureLoad(gradients, array_texel(i), 0);
}

#for render/walk_planes render/path
// Eight texels per tet; see refresh_geometry.wgsl.
@group(0) @binding(next) var records: texture_2d<u32>;

fn record_at(i: u32) -> vec4<u32> {
    return textureLoad(records, array_texel(i), 0);
}

#for render/path
// Lower and upper corner of each box of lib/path_boxes.
@group(0) @binding(next) var boxes: texture_2d<f32>;
// Of each boundary face: a corner and 4 tet + face, then the sides from there.
@group(0) @binding(next) var faces: texture_2d<f32>;
// Largest extinction in each tet, relative to the largest of all.
@group(0) @binding(next) var majorants: texture_2d<f32>;

// Colour of each table row over its range; w is the extinction relative to the largest.
@group(0) @binding(next) var colours: texture_2d<f32>;
// Map from places in each tet to the gradient (render/path_maps), if NODE_GRADIENTS.
@group(0) @binding(next) var gradients: texture_2d<f32>;
// The surroundings (lib/path_sky).
@group(0) @binding(next) var sky: texture_2d<f32>;
// Skins and tools (lib/path_walls).
@group(0) @binding(next) var walls: texture_2d<f32>;

fn box_at(i: u32) -> vec3<f32> {
    return textureLoad(boxes, array_texel(i), 0).xyz;
}

fn face_at(i: u32) -> vec4<f32> {
    return textureLoad(faces, array_texel(i), 0);
}

fn colour_at(i: u32) -> vec4<f32> {
    return textureLoad(colours, array_texel(i), 0);
}

fn gradient_map_at(i: u32) -> vec4<f32> {
    return textureLoad(gradients, array_texel(i), 0);
}

fn sky_item(i: u32) -> vec4<f32> {
    return textureLoad(sky, array_texel(i), 0);
}

fn wall_item(i: u32) -> vec4<f32> {
    return textureLoad(walls, array_texel(i), 0);
}

fn majorant_at(t: u32) -> f32 {
    return textureLoad(majorants, array_texel(t), 0).x;
}

#for render/start
@group(0) @binding(next) var projected: texture_2d<f32>;
// Nodes of each boundary face, counter-clockwise from outside, and 4 tet + face; sorted by the
// latter.
@group(0) @binding(next) var boundary: texture_2d<u32>;
// Corners of the triangles that cover faces; see cover.wgsl.
@group(0) @binding(next) var covers: texture_2d<u32>;

fn projected_at(i: u32) -> vec4<f32> {
    return textureLoad(projected, array_texel(i), 0);
}

fn boundary_at(i: u32) -> vec4<u32> {
    return textureLoad(boundary, array_texel(i), 0);
}

fn cover_at(i: u32) -> vec4<u32> {
    return textureLoad(covers, array_texel(i), 0);
}
