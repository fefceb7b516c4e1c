// Conjugate gradients, second half of an iteration: x += αp, r −= αq, z = D⁻¹ r.

#import lib/cg

@group(0) @binding(0) var direction: texture_2d<f32>;
@group(0) @binding(1) var product: texture_2d<f32>;
@group(0) @binding(2) var solution: texture_2d<f32>;
@group(0) @binding(3) var residual: texture_2d<f32>;
@group(0) @binding(4) var preconditioner: texture_2d<f32>;
@group(0) @binding(5) var<storage, read> status: Status;
@group(0) @binding(6) var<storage, read> pq_partials: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> before: CgScalars;
@group(0) @binding(8) var<storage, read> after: CgScalars;
@group(0) @binding(9) var next_solution: texture_storage_2d<rgba32float, write>;
@group(0) @binding(10) var next_residual: texture_storage_2d<rgba32float, write>;
@group(0) @binding(11) var next_preconditioned: texture_storage_2d<rgba32float, write>;
@group(0) @binding(12) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(13) var<uniform> params: CgParams;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    // The first half did nothing, so this half does nothing either.
    if status.failed != 0u || after.iterations == before.iterations {
        return;
    }
    var share = vec4(0.0);
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        share += pq_partials[k];
    }
    let pq = reduce(share, lane).x;
    // The matrix is positive definite; if rounding makes pq non-positive, x is left unchanged.
    let alpha = select(0.0, after.rz / pq, pq > 0.0);
    let first = before.iterations == 0u;
    var sum = 0.0;
    for (var i = id.x; i < params.nodes; i += groups.x * WORKGROUP) {
        var x = alpha * textureLoad(direction, array_texel(i), 0).xyz;
        if !first {
            x += textureLoad(solution, array_texel(i), 0).xyz;
        }
        let r = textureLoad(residual, array_texel(i), 0).xyz - alpha * textureLoad(product, array_texel(i), 0).xyz;
        let a0 = textureLoad(preconditioner, array_texel(2u * i), 0);
        let a1 = textureLoad(preconditioner, array_texel(2u * i + 1u), 0);
        let z = sym_mul(a0, a1, r);
        textureStore(next_solution, array_texel(i), vec4(x, 0.0));
        textureStore(next_residual, array_texel(i), vec4(r, 0.0));
        textureStore(next_preconditioned, array_texel(i), vec4(z, 0.0));
        sum += dot(r, z);
    }
    let rz = reduce(vec4(sum, 0.0, 0.0, 0.0), lane);
    if lane == 0u {
        partials[group.x] = rz;
    }
}
