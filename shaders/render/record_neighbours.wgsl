// Writes the neighbours in the records of tets (refresh_geometry.wgsl), from the links of the
// traversal over projected vertices.

#import lib/array
#import lib/tet

struct Neighbours {
    tets: u32,
}

// The four nodes of each tet.
@group(0) @binding(0) var tets: texture_2d<u32>;
// At 4 t + k, across the face opposite the k-th smallest node of tet t: the neighbour, and the
// exclusive or of its nodes.
@group(0) @binding(1) var links: texture_2d<u32>;
@group(0) @binding(2) var records: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(3) var<uniform> params: Neighbours;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation_index(id, groups);
    if t >= params.tets {
        return;
    }
    let own = textureLoad(tets, array_texel(t), 0);
    let all = own.x ^ own.y ^ own.z ^ own.w;
    var codes = vec4(NONE);
    for (var f = 0u; f < 4u; f++) {
        let smaller = own < vec4(own[f]);
        let rank = dot(select(vec4(0u), vec4(1u), smaller), vec4(1u));
        let link = textureLoad(links, array_texel(t * 4u + rank), 0).xy;
        if link.x == NONE {
            continue;
        }
        // The neighbour's node that is not in the shared face.
        let opposite = link.y ^ all ^ own[f];
        let nodes = textureLoad(tets, array_texel(link.x), 0);
        var face = 0u;
        for (var k = 1u; k < 4u; k++) {
            face = select(face, k, nodes[k] == opposite);
        }
        codes[f] = 4u * link.x + face;
    }
    textureStore(records, array_texel(t * 8u + 6u), codes);
}
