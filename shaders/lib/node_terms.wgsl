// What a term that acts on each node by itself adds to the matrix of a step.
struct NodeBlock {
    // xx, yy, zz.
    diagonal: vec3<f32>,
    // xy, xz, yz.
    mixed: vec3<f32>,
}

// Two of each such term; see their files.
@group(0) @binding(next) var<storage, read> node_terms: array<vec4<f32>>;
