// Contribution of the material to the system of a node.
struct MaterialContribution {
    // The diagonal block, mass included: xx, yy, zz, and xy, xz, yz.
    diagonal: vec3<f32>,
    mixed: vec3<f32>,
    // K̃ v: right-hand side over h², beside the forces over h.
    ahead: vec3<f32>,
    // Velocity of the node relative to the state at which forces are evaluated, as known before the
    // solve.
    motion: vec3<f32>,
}
