// Assembles the finite element matrix blocks of each mesh edge from the Hessians of the surrounding
// tets, for both directions of the edge: three texels, the rows of (h² + hτ) K_ij.

#import lib/array
#import lib/status
#each contact #import terms/TERM

struct EdgeParams {
    edges: u32,
    // h² + hτ.
    scale: f32,
}

// For each edge: its first entry in `around`, the number of entries, and the matrix entries of its
// two directions.
@group(0) @binding(0) var edges: texture_2d<u32>;
// Tets around edges: 16 times the tet number, plus 4 times the local corner at one end, plus the
// local corner at the other.
@group(0) @binding(1) var around: texture_2d<u32>;
@group(0) @binding(2) var curvatures: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> status: Status;
@group(0) @binding(4) var matrix: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: EdgeParams;

// Returns the gradient of a corner in the frame of its tet, whose texels start at `first`.
fn corner_gradient(first: u32, corner: u32) -> vec3<f32> {
    if corner == 0u {
        let a = textureLoad(curvatures, array_texel(first + 3u), 0).xyz;
        let b = textureLoad(curvatures, array_texel(first + 4u), 0).xyz;
        return -(a + b + textureLoad(curvatures, array_texel(first + 5u), 0).xyz);
    }
    return textureLoad(curvatures, array_texel(first + 2u + corner), 0).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let n = invocation_index(id, groups);
    if n >= params.edges || status.failed != 0u || status.solving != 0u {
        return;
    }
    let edge = textureLoad(edges, array_texel(n), 0);
    var block = mat3x3(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (var k = edge.x; k < edge.x + edge.y; k++) {
        let tet = textureLoad(around, array_texel(k), 0).x;
        let first = 8u * (tet >> 4u);
        let a = corner_gradient(first, (tet >> 2u) & 3u);
        let b = corner_gradient(first, tet & 3u);
        let c0 = textureLoad(curvatures, array_texel(first), 0);
        let c1 = textureLoad(curvatures, array_texel(first + 1u), 0);
        let c2 = textureLoad(curvatures, array_texel(first + 2u), 0);
        let off = vec3(
            textureLoad(curvatures, array_texel(first + 3u), 0).w,
            textureLoad(curvatures, array_texel(first + 4u), 0).w,
            textureLoad(curvatures, array_texel(first + 5u), 0).w,
        );
        let flip = textureLoad(curvatures, array_texel(first + 6u), 0).xyz;
        let twist = textureLoad(curvatures, array_texel(first + 7u), 0).xyz;
        // δP_lm is proportional to δF_lm with factor `same`, and to δF_ml with factor `other`.
        let same = 0.5 * (flip + twist);
        let other = 0.5 * (flip - twist);
        // In the local frame: B_lk = a_l A_lk b_k + other a_k b_l, plus the `same` contribution on
        // the diagonal.
        let ab = a * b;
        let on = vec3(c0.w, c1.w, c2.w) * ab + vec3(
            same.z * ab.y + same.y * ab.z,
            same.x * ab.z + same.z * ab.x,
            same.y * ab.x + same.x * ab.y,
        );
        let framed = mat3x3(
            vec3(on.x, a.y * off.z * b.x + other.z * a.x * b.y, a.z * off.y * b.x + other.y * a.x * b.z),
            vec3(a.x * off.z * b.y + other.z * a.y * b.x, on.y, a.z * off.x * b.y + other.x * a.y * b.z),
            vec3(a.x * off.y * b.z + other.y * a.z * b.x, a.y * off.x * b.z + other.x * a.z * b.y, on.z),
        );
        let u = mat3x3(c0.xyz, c1.xyz, c2.xyz);
        block += u * framed * transpose(u);
    }
    block = params.scale * block;
#each contact     block += TERM_edge(n);
    let rows = transpose(block);
    for (var k = 0u; k < 3u; k++) {
        textureStore(matrix, array_texel(3u * edge.z + k), vec4(rows[k], 0.0));
        textureStore(matrix, array_texel(3u * edge.w + k), vec4(block[k], 0.0));
    }
}
