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
