// Tetrahedral finite elements: rest shape and deformation. CPU reference:
// `physics::model::elements`.
//
// All quantities are computed from G = F − I, from displacements, so that small strains stay
// accurate in f32: G is exactly zero without motion.

#import lib/array

@group(0) @binding(next) var tets: texture_2d<u32>;
// Three texels per tet: the shape function gradients of its last three nodes; w holds μ and λ as
// they enter the energy, times the volume.
@group(0) @binding(next) var shapes: texture_2d<f32>;
// Rest positions of the nodes.
@group(0) @binding(next) var rest: texture_2d<f32>;

struct Tet {
    nodes: vec4<u32>,
    // Columns: gradients of the last three nodes; the gradient of the first is minus their sum.
    gradients: mat3x3<f32>,
    mu: f32,
    lambda: f32,
}

fn load_tet(e: u32) -> Tet {
    let a = textureLoad(shapes, array_texel(3u * e), 0);
    let b = textureLoad(shapes, array_texel(3u * e + 1u), 0);
    let c = textureLoad(shapes, array_texel(3u * e + 2u), 0);
    return Tet(textureLoad(tets, array_texel(e), 0), mat3x3(a.xyz, b.xyz, c.xyz), a.w, b.w);
}

// Returns the gradient of a field from its four nodal values.
fn displacement_gradient(tet: Tet, first: vec3<f32>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(a - first, b - first, c - first) * transpose(tet.gradients);
}

// J below which a tet counts as crushed, and the added stiffness relative to μ.
const CRUSH_THRESHOLD_J: f32 = 0.1;
const CRUSH_STIFFNESS_RATIO: f32 = 100.0;

// Returns the energy of a volume change J − 1.
fn volumetric_energy(volume_strain: f32, mu: f32, lambda: f32) -> f32 {
    let c = clamp((CRUSH_THRESHOLD_J - 1.0 - volume_strain) / CRUSH_THRESHOLD_J, 0.0, 1.0);
    let crush_term = CRUSH_THRESHOLD_J * c * c * c * c * (1.0 / 12.0 + c * (c / 30.0 - 0.1)) + max(-1.0 - volume_strain, 0.0) / 30.0;
    return 0.5 * lambda * volume_strain * volume_strain + 16.0 * CRUSH_STIFFNESS_RATIO * CRUSH_THRESHOLD_J * mu * crush_term;
}

// Returns the first and second derivatives of `volumetric_energy`.
fn volumetric_derivatives(volume_strain: f32, mu: f32, lambda: f32) -> vec2<f32> {
    let c = clamp((CRUSH_THRESHOLD_J - 1.0 - volume_strain) / CRUSH_THRESHOLD_J, 0.0, 1.0);
    let crush_term = 16.0 * CRUSH_STIFFNESS_RATIO * CRUSH_THRESHOLD_J * mu * c * c * c * (1.0 / 3.0 + c * (0.2 * c - 0.5));
    let bump = c * (1.0 - c);
    return vec2(lambda * volume_strain - crush_term, lambda + 16.0 * CRUSH_STIFFNESS_RATIO * mu * bump * bump);
}

fn trace(m: mat3x3<f32>) -> f32 {
    return m[0].x + m[1].y + m[2].z;
}

fn cofactor(m: mat3x3<f32>) -> mat3x3<f32> {
    return mat3x3(cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]));
}

fn unit_matrix() -> mat3x3<f32> {
    return mat3x3(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
}

// Returns the double contraction a : b.
fn double_dot(a: mat3x3<f32>, b: mat3x3<f32>) -> f32 {
    return dot(a[0], b[0]) + dot(a[1], b[1]) + dot(a[2], b[2]);
}

// Returns J − 1 of F = I + G; c is the cofactor matrix of G.
fn volume_change(g: mat3x3<f32>, c: mat3x3<f32>) -> f32 {
    return trace(g) + trace(c) + dot(g[0], c[0]);
}

// Returns the cofactor matrix of F = I + G minus the identity.
fn cofactor_minus_identity(g: mat3x3<f32>, c: mat3x3<f32>) -> mat3x3<f32> {
    return trace(g) * unit_matrix() - transpose(g) + c;
}
