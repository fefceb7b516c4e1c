// Data that mesh traversal reads at each step, read from storage textures: half the instructions on
// a software driver, because storage textures have no mip levels.
#term reads

#for render/walk_vertices
@group(0) @binding(next) var projected: texture_storage_2d<rgba32float, read>;
// At 4 t + k, across the face opposite the k-th smallest node of tet t: the neighbour, and the
// exclusive or of its nodes.
@group(0) @binding(next) var links: texture_storage_2d<rg32uint, read>;
// The gradient at each node, if PER_NODE_LIGHT; w is the fraction of light that reaches it, if
// SHADOWS.
@group(0) @binding(next) var gradients: texture_storage_2d<rgba32float, read>;

fn projected_at(i: u32) -> vec4<f32> {
    return textureLoad(projected, array_texel(i));
}

fn link_at(i: u32) -> vec2<u32> {
    return textureLoad(links, array_texel(i)).xy;
}

fn gradient_at(i: u32) -> vec4<f32> {
    return textureLoad(gradients, array_texel(i));
}

#for render/walk_planes render/path
// Eight texels per tet; see refresh_geometry.wgsl.
@group(0) @binding(next) var records: texture_storage_2d<rgba32uint, read>;

fn record_at(i: u32) -> vec4<u32> {
    return textureLoad(records, array_texel(i));
}

#for render/path
// Lower and upper corner of each box of lib/path_boxes.
@group(0) @binding(next) var boxes: texture_storage_2d<rgba32float, read>;
// Of each boundary face: a corner and 4 tet + face, then the sides from there.
@group(0) @binding(next) var faces: texture_storage_2d<rgba32float, read>;
// Largest extinction in each tet, relative to the largest of all.
@group(0) @binding(next) var majorants: texture_storage_2d<r32float, read>;

// Colour of each table row over its range; w is the extinction relative to the largest.
@group(0) @binding(next) var colours: texture_storage_2d<rgba32float, read>;
// Map from places in each tet to the gradient (render/path_maps), if NODE_GRADIENTS.
@group(0) @binding(next) var gradients: texture_storage_2d<rgba32float, read>;
// The surroundings (lib/path_sky).
@group(0) @binding(next) var sky: texture_storage_2d<rgba32float, read>;
// Skins and tools (lib/path_walls).
@group(0) @binding(next) var walls: texture_storage_2d<rgba32float, read>;

fn box_at(i: u32) -> vec3<f32> {
    return textureLoad(boxes, array_texel(i)).xyz;
}

fn face_at(i: u32) -> vec4<f32> {
    return textureLoad(faces, array_texel(i));
}

fn colour_at(i: u32) -> vec4<f32> {
    return textureLoad(colours, array_texel(i));
}

fn gradient_map_at(i: u32) -> vec4<f32> {
    return textureLoad(gradients, array_texel(i));
}

fn sky_item(i: u32) -> vec4<f32> {
    return textureLoad(sky, array_texel(i));
}

fn wall_item(i: u32) -> vec4<f32> {
    return textureLoad(walls, array_texel(i));
}

fn majorant_at(t: u32) -> f32 {
    return textureLoad(majorants, array_texel(t)).x;
}

#for render/start
@group(0) @binding(next) var projected: texture_storage_2d<rgba32float, read>;
// Nodes of each boundary face, counter-clockwise from outside, and 4 tet + face; sorted by the
// latter.
@group(0) @binding(next) var boundary: texture_storage_2d<rgba32uint, read>;
// Corners of the triangles that cover faces; see cover.wgsl.
@group(0) @binding(next) var covers: texture_storage_2d<rgba32uint, read>;

fn projected_at(i: u32) -> vec4<f32> {
    return textureLoad(projected, array_texel(i));
}

fn boundary_at(i: u32) -> vec4<u32> {
    return textureLoad(boundary, array_texel(i));
}

fn cover_at(i: u32) -> vec4<u32> {
    return textureLoad(covers, array_texel(i));
}
