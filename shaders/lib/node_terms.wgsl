// What a term that acts on each node by itself adds to the matrix of a step.
struct NodeBlock {
    // xx, yy, zz.
    diagonal: vec3<f32>,
    // xy, xz, yz.
    mixed: vec3<f32>,
}
