// Forces on every node at a state, and that state's energies: equations 2 and 3 of Tejada & Ertl,
// and what terms that it is composed with add.
//
// f_i = Σ κ(|x_ij| − L) x̂ − κ_d(v_i − v_j) + m_i g + external + terms, in local units.

#import lib/springs
#import lib/reduce
#import lib/status
#any #import lib/node_terms
#each #import terms/TERM

struct ForceParams {
    gravity: vec4<f32>,
    nodes: u32,
    // κ_d = damping + damping_time · κ, along the spring's axis or of the whole relative velocity.
    damping: f32,
    damping_time: f32,
    axial: u32,
    // Local units of force in a newton.
    newton: f32,
    _pad0: u32,
    _pad1: u32,
    _pad2: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var external_forces: texture_2d<f32>;
@group(0) @binding(4) var rows: texture_2d<u32>;
@group(0) @binding(5) var columns: texture_2d<u32>;
@group(0) @binding(6) var springs: texture_2d<f32>;
@group(0) @binding(7) var<storage, read> status: Status;
@group(0) @binding(8) var forces: texture_storage_2d<rgba32float, write>;
// A workgroup's kinetic energy, elastic energy, power of the external forces, non-finite nodes.
@group(0) @binding(9) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(10) var<uniform> params: ForceParams;
// Two of each term; see their files.
#any @group(0) @binding(11) var<storage, read> node_terms: array<vec4<f32>>;

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
        let row = textureLoad(rows, at(t), 0).xyz;
        let i = row.x;
        let x = textureLoad(positions, at(i), 0).xyz;
        let v = textureLoad(velocities, at(i), 0).xyz;
        var f = vec3(0.0);
        var elastic = 0.0;
        for (var q = 0u; q < row.z; q++) {
            let neighbours = textureLoad(columns, column_texel(row.y, t, q), 0);
            for (var k = 0u; k < 4u; k++) {
                let j = at(neighbours[k]);
                let spring = textureLoad(springs, spring_texel(row.y, t, q * 4u + k), 0);
                let d = textureLoad(positions, j, 0).xyz - x;
                let w = textureLoad(velocities, j, 0).xyz - v;
                let l = length(d);
                let n = along(d, l);
                let stretch = l - spring.y;
                let damping = params.damping + params.damping_time * spring.x;
                let braked = select(w, n * dot(n, w), params.axial != 0u);
                f += spring.x * stretch * n + damping * braked;
                elastic += spring.x * stretch * stretch;
            }
        }
        let m = textureLoad(masses, at(i), 0).x;
#any         var share = vec4(0.0);
#each         share += TERM_force(INDEX, m, x);
#any         f += share.xyz;
        // Each spring is met from both ends.
        var energy = 0.25 * elastic;
#any         energy += share.w;
        let pull = m * params.gravity.xyz + params.newton * textureLoad(external_forces, at(i), 0).xyz;
        f += pull;
        textureStore(forces, at(i), vec4(f, 0.0));
        let bad = select(1.0, 0.0, finite3(x) && finite3(v) && finite3(f));
        sum += vec4(0.5 * m * dot(v, v), energy, dot(pull, v), bad);
    }
    let total = reduce(sum, lane);
    if lane == 0u {
        partials[group.x] = total;
    }
}
