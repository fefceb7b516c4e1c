// Tool contact forces and Hessian blocks (node diagonal and edge blocks), computed beforehand by
// `physics/contact_faces` and `physics/contact_nodes`.
#term contact

#for physics/forces physics/implicit_euler_begin physics/implicit_euler_direction
@group(0) @binding(next) var contact_shares: texture_2d<f32>;

#for physics/forces physics/implicit_euler_begin
// Returns the contact force on a node; w is the number of its points that penetrate too deeply.
fn contact_force(i: u32) -> vec4<f32> {
    return textureLoad(contact_shares, array_texel(3u * i), 0);
}

#for physics/implicit_euler_begin physics/implicit_euler_direction
// Returns the row sum of a node's contact blocks: xx xy xz yy, yz zz.
fn contact_block(i: u32) -> array<vec4<f32>, 2> {
    return array(
        textureLoad(contact_shares, array_texel(3u * i + 1u), 0),
        textureLoad(contact_shares, array_texel(3u * i + 2u), 0),
    );
}

#for physics/edge_blocks
const NO_FACE: u32 = 0xffffffffu;

// For each edge, the boundary faces on either side, as three times the face plus the local edge.
@group(0) @binding(next) var contact_sides: texture_2d<u32>;
@group(0) @binding(next) var contact_faces: texture_2d<f32>;

// Returns the contact Hessian block between the nodes of an edge.
fn contact_edge(n: u32) -> mat3x3<f32> {
    let sides = textureLoad(contact_sides, array_texel(n), 0).xy;
    var a = vec4(0.0);
    var b = vec4(0.0);
    for (var s = 0u; s < 2u; s++) {
        let side = sides[s];
        if side == NO_FACE {
            continue;
        }
        let first = 15u * (side / 3u);
        if textureLoad(contact_faces, array_texel(first + 2u), 0).w > 0.0 {
            let block = first + 9u + 2u * (side % 3u);
            a += textureLoad(contact_faces, array_texel(block), 0);
            b += textureLoad(contact_faces, array_texel(block + 1u), 0);
        }
    }
    return mat3x3(a.x, a.y, a.z, a.y, a.w, b.x, a.z, b.x, b.y);
}
