// Computes the incremental potential of each initial guess of an implicit finite element step.

#each law #import terms/TERM
#each rigid #import terms/TERM
#any node #import lib/node_terms
#each node #import terms/TERM
#import lib/workgroup_sum
#import lib/initial_guess
#import lib/status

struct GuessParams {
    gravity: vec4<f32>,
    nodes: u32,
    tets: u32,
    dt: f32,
    // h α, for mass-proportional damping with the force −α m v.
    drag: f32,
    // Local units of force per newton.
    newton: f32,
    _pad0: u32,
    _pad1: u32,
    _pad2: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
// Velocities at the start of the previous step.
@group(0) @binding(2) var velocities_before: texture_2d<f32>;
@group(0) @binding(3) var masses: texture_2d<f32>;
@group(0) @binding(4) var external_forces: texture_2d<f32>;
@group(0) @binding(5) var<storage, read> status: Status;
// Contribution of a workgroup to each potential.
@group(0) @binding(6) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(7) var<uniform> params: GuessParams;

// Returns the displacement of the node for each guess, one per column.
fn guess_displacements(i: u32) -> mat3x3<f32> {
    let v = textureLoad(velocities, array_texel(i), 0).xyz;
    let before = textureLoad(velocities_before, array_texel(i), 0).xyz;
    let free = textureLoad(masses, array_texel(i), 0).y != 0.0;
    var all = mat3x3(
        guess_velocity(0u, v, before, free),
        guess_velocity(1u, v, before, free),
        guess_velocity(2u, v, before, free),
    );
#each rigid     if free {
#each rigid         all[1] = TERM_velocity(i, 1u, params.dt, all[1]);
#each rigid         all[2] = TERM_velocity(i, 2u, params.dt, all[2]);
#each rigid     }
    return all;
}

fn displacement_of(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz - textureLoad(rest, array_texel(i), 0).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    var sum = vec4(0.0);
    for (var e = id.x; e < params.tets; e += groups.x * WORKGROUP) {
        let tet = load_tet(e);
        let n = tet.nodes;
        let g = displacement_gradient(tet, displacement_of(n.x), displacement_of(n.y), displacement_of(n.z), displacement_of(n.w));
        let w0 = guess_displacements(n.x);
        let w1 = guess_displacements(n.y);
        let w2 = guess_displacements(n.z);
        let w3 = guess_displacements(n.w);
        for (var c = 0u; c < GUESS_COUNT; c++) {
            let moved = g + params.dt * displacement_gradient(tet, w0[c], w1[c], w2[c], w3[c]);
#each law             sum[c] += TERM_energy(moved, tet.mu, tet.lambda);
        }
    }
    for (var i = id.x; i < params.nodes; i += groups.x * WORKGROUP) {
        let m = textureLoad(masses, array_texel(i), 0);
        if m.y != 0.0 {
            let x = textureLoad(positions, array_texel(i), 0).xyz;
            let v = textureLoad(velocities, array_texel(i), 0).xyz;
            let pull = m.x * params.gravity.xyz + params.newton * textureLoad(external_forces, array_texel(i), 0).xyz;
            let w = guess_displacements(i);
            for (var c = 0u; c < GUESS_COUNT; c++) {
                let change = w[c] - v;
                sum[c] += 0.5 * m.x * (dot(change, change) + params.drag * dot(w[c], w[c]));
                sum[c] -= params.dt * dot(w[c], pull);
#each node                 sum[c] += TERM_force(INDEX, m.x, x + params.dt * w[c]).w;
            }
        }
    }
    let total = reduce(sum, lane);
    if lane == 0u {
        partials[group.x] = total;
    }
}
