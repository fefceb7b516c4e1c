// What its matter adds to the system of a node.
struct MaterialContribution {
    // The diagonal block, mass included: xx, yy, zz, and xy, xz, yz.
    diagonal: vec3<f32>,
    mixed: vec3<f32>,
    // K̃ v: over h², what is on the right beside the forces over h.
    ahead: vec3<f32>,
    // The velocity with which the node goes on from where the forces were taken, as far as is
    // known before the solve.
    motion: vec3<f32>,
}
