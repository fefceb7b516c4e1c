// Conjugate gradients, first half of an iteration: the new direction p = z + βp, and q = A p.
//
// Every workgroup sums the partial sums of r·z itself and obtains the same β and the same
// convergence decision. The p of neighbours is recomputed, so one dispatch does both.

#import lib/cg
#each matter #import terms/TERM

@group(0) @binding(0) var preconditioned: texture_2d<f32>;
@group(0) @binding(1) var direction: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> status: Status;
@group(0) @binding(4) var<storage, read> rz_partials: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> before: CgScalars;
@group(0) @binding(6) var next_direction: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var product: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> after: CgScalars;
@group(0) @binding(10) var<uniform> params: CgParams;
// The second half holds two texels per node: the blocks of nodal terms.
#any node @group(0) @binding(next) var preconditioner: texture_2d<f32>;
#each contact #import terms/TERM

// Returns the direction z + βp of the node at texel j.
fn direction_of(j: vec2<u32>, beta: f32, first: bool) -> vec3<f32> {
    let z = textureLoad(preconditioned, j, 0).xyz;
    if first {
        return z;
    }
    return z + beta * textureLoad(direction, j, 0).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || before.done != 0u || before.iterations >= params.max_iterations {
        if id.x == 0u {
            after = before;
        }
        return;
    }
    var share = vec4(0.0);
    for (var k = lane; k < params.groups + params.rigid_groups; k += WORKGROUP) {
        share += rz_partials[k];
    }
    let total = reduce(share, lane);
    let rz = total.x;
    let first = before.iterations == 0u;
    let start = select(before.rz_start, rz, first);
    let floor = select(before.rz_floor, total.y * params.negligible, first);
    let broken = !finite(rz);
    if broken || rz <= max(params.tolerance * start, floor) {
        if id.x == 0u {
            after = CgScalars(rz, start, floor, before.iterations, select(CONVERGED, BREAKDOWN, broken), 0u, 0u, 0u);
        }
        return;
    }
    let beta = select(rz / before.rz, 0.0, first);
    var sum = 0.0;
    for (var t = id.x; t < params.nodes; t += groups.x * WORKGROUP) {
        let i = row_of(t).x;
        let mass = textureLoad(masses, array_texel(i), 0).xy;
        let p = direction_of(array_texel(i), beta, first);
#each matter         var q = TERM_product(t, mass.x * p, p, beta, first);
#any node         let b0 = textureLoad(preconditioner, array_texel(2u * (params.nodes + i)), 0);
#any node         let b1 = textureLoad(preconditioner, array_texel(2u * (params.nodes + i) + 1u), 0);
#any node         q += sym_mul(b0, b1, p);
#each contact         let pressed = TERM_block(i);
#each contact         q += sym_mul(pressed[0], pressed[1], p);
        q = select(vec3(0.0), q, mass.y != 0.0);
        textureStore(next_direction, array_texel(i), vec4(p, 0.0));
        textureStore(product, array_texel(i), vec4(q, 0.0));
        sum += dot(p, q);
    }
    let pq = reduce(vec4(sum, 0.0, 0.0, 0.0), lane);
    if lane == 0u {
        partials[group.x] = pq;
    }
    if id.x == 0u {
        after = CgScalars(rz, start, floor, before.iterations + 1u, 0u, 0u, 0u, 0u);
    }
}
