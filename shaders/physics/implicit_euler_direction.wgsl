// Conjugate gradients, first half of an iteration: the new direction p = z + βp, and q = A p.
//
// Every workgroup adds up the partial sums of r·z for itself and comes to the same β and the same
// answer to "converged?". A neighbour's p is made on the way, so one dispatch does both.

#import lib/springs
#import lib/cg

@group(0) @binding(0) var preconditioned: texture_2d<f32>;
@group(0) @binding(1) var direction: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var rows: texture_2d<u32>;
@group(0) @binding(4) var columns: texture_2d<u32>;
@group(0) @binding(5) var edges: texture_2d<f32>;
@group(0) @binding(6) var<storage, read> status: Status;
@group(0) @binding(7) var<storage, read> rz_partials: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> before: CgScalars;
@group(0) @binding(9) var next_direction: texture_storage_2d<rgba32float, write>;
@group(0) @binding(10) var product: texture_storage_2d<rgba32float, write>;
@group(0) @binding(11) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> after: CgScalars;
@group(0) @binding(13) var<uniform> params: CgParams;
// In its second half, two texels a node: what terms add to its block.
#any @group(0) @binding(14) var preconditioner: texture_2d<f32>;

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
    for (var k = lane; k < params.groups; k += WORKGROUP) {
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
            after = CgScalars(rz, start, floor, before.iterations, select(MET, BROKEN, broken), 0u, 0u, 0u);
        }
        return;
    }
    let beta = select(rz / before.rz, 0.0, first);
    var sum = 0.0;
    for (var t = id.x; t < params.nodes; t += groups.x * WORKGROUP) {
        let row = textureLoad(rows, at(t), 0).xyz;
        let i = row.x;
        let mass = textureLoad(masses, at(i), 0).xy;
        var p = textureLoad(preconditioned, at(i), 0).xyz;
        if !first {
            p += beta * textureLoad(direction, at(i), 0).xyz;
        }
        var q = mass.x * p;
        for (var k = 0u; k < row.z; k++) {
            let neighbours = textureLoad(columns, column_texel(row.y, t, k), 0);
            for (var c = 0u; c < 4u; c++) {
                let j = at(neighbours[c]);
                let edge = textureLoad(edges, spring_texel(row.y, t, k * 4u + c), 0);
                var d = p - textureLoad(preconditioned, j, 0).xyz;
                if !first {
                    d -= beta * textureLoad(direction, j, 0).xyz;
                }
                q += edge.xyz * dot(edge.xyz, d) + edge.w * d;
            }
        }
#any         let b0 = textureLoad(preconditioner, at(2u * (params.nodes + i)), 0);
#any         let b1 = textureLoad(preconditioner, at(2u * (params.nodes + i) + 1u), 0);
#any         q += symmetric(b0, b1, p);
        q = select(vec3(0.0), q, mass.y != 0.0);
        textureStore(next_direction, at(i), vec4(p, 0.0));
        textureStore(product, at(i), vec4(q, 0.0));
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
