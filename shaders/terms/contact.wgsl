// What tools exert on nodes, made before by `physics/contact_faces` and `physics/contact_nodes`:
// forces, and blocks of the matrix, those of a node with its neighbours along the edges between.
#term contact

#for physics/forces physics/implicit_euler_begin physics/implicit_euler_direction
@group(0) @binding(next) var contact_shares: texture_2d<f32>;

#for physics/forces physics/implicit_euler_begin
// The force on a node, and in w how many points there are too deep inside.
fn contact_force(i: u32) -> vec4<f32> {
    return textureLoad(contact_shares, array_texel(3u * i), 0);
}

#for physics/implicit_euler_begin physics/implicit_euler_direction
// The rows of a node added up: xx xy xz yy, yz zz.
fn contact_block(i: u32) -> array<vec4<f32>, 2> {
    return array(
        textureLoad(contact_shares, array_texel(3u * i + 1u), 0),
        textureLoad(contact_shares, array_texel(3u * i + 2u), 0),
    );
}

#for physics/edge_blocks
const NO_FACE: u32 = 0xffffffffu;

// Of each edge: the faces of the boundary on either side, as three times the face and which of its
// edges it is.
@group(0) @binding(next) var contact_sides: texture_2d<u32>;
@group(0) @binding(next) var contact_faces: texture_2d<f32>;

// What is between the nodes of an edge.
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
