// Contribution of a nodal term to the matrix of a step.
struct NodeBlock {
    // xx, yy, zz.
    diagonal: vec3<f32>,
    // xy, xz, yz.
    mixed: vec3<f32>,
}

// Two vectors per term; see the files of the terms.
@group(0) @binding(next) var<storage, read> node_terms: array<vec4<f32>>;
