// Nodal forces and energies of a state: material forces, nodal terms, weight and external forces,
// in local units.

#import lib/workgroup_sum
#import lib/status
#each matter #import terms/TERM
#any node #import lib/node_terms
#each node #import terms/TERM
#each contact #import terms/TERM

struct ForceParams {
    gravity: vec4<f32>,
    nodes: u32,
    // Local units of force per newton.
    newton: f32,
    _pad0: u32,
    _pad1: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var external_forces: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> status: Status;
@group(0) @binding(5) var forces: texture_storage_2d<rgba32float, write>;
// Per workgroup: kinetic energy, elastic energy, power of the external forces, number of inverted
// tets plus NON_FINITE_WEIGHT for each non-finite node.
@group(0) @binding(6) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(7) var<uniform> params: ForceParams;

// Number of inverted tets that this invocation has gathered.
var<private> inverted_tets: f32 = 0.0;

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
    for (var t = id.x; t < params.nodes; t += groups.x * WORKGROUP) {
        let i = row_of(t).x;
        let x = textureLoad(positions, array_texel(i), 0).xyz;
        let v = textureLoad(velocities, array_texel(i), 0).xyz;
        let m = textureLoad(masses, array_texel(i), 0).x;
#each matter         let gathered = TERM_force(t, m, x, v);
        var f = gathered.xyz;
        var energy = gathered.w;
#any node         var share = vec4(0.0);
#each node         share += TERM_force(INDEX, m, x);
#any node         f += share.xyz;
#any node         energy += share.w;
        let external_force = m * params.gravity.xyz + params.newton * textureLoad(external_forces, array_texel(i), 0).xyz;
        f += external_force;
#each contact         let pressed = TERM_force(i).xyz;
#each contact         f += pressed;
        textureStore(forces, array_texel(i), vec4(f, 0.0));
        let bad = select(NON_FINITE_WEIGHT, 0.0, finite3(x) && finite3(v) && finite3(f));
        sum += vec4(0.5 * m * dot(v, v), energy, dot(external_force, v), bad);
        // Tools do external work.
#each contact         sum.z += dot(pressed, v);
    }
    sum.w += inverted_tets;
    let total = reduce(sum, lane);
    if lane == 0u {
        partials[group.x] = total;
    }
}
