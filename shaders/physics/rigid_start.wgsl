// Computes the poses of rigid bodies at the start of an implicit step, and the poses closest to the
// extrapolated node positions: with constant velocities, and with constant accelerations.
//
// Six texels per body: current displacement of the anchor and rotation; translation and rotation
// over the step for the second guess (`lib/initial_guess`); the same for the third. The first
// guess is rest.

#import lib/rigid_members
#import lib/workgroup_sum
#import lib/initial_guess
#import lib/status

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var velocities_before: texture_2d<f32>;
@group(0) @binding(3) var masses: texture_2d<f32>;
@group(0) @binding(4) var rest: texture_2d<f32>;
@group(0) @binding(5) var<storage, read> status: Status;
@group(0) @binding(6) var motions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var<uniform> params: RigidParams;

fn shift_of(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz - textureLoad(rest, array_texel(i), 0).xyz;
}

// Returns the rotation that best maps arms b with Σ m b bᵀ = second to y with Σ m (y − b) bᵀ =
// change.
fn closest_rotation(shape: RigidShape, axis: vec3<f32>, second: mat3x3<f32>, change: mat3x3<f32>) -> vec4<f32> {
    var q = IDENTITY_ROTATION;
    for (var k = 0u; k < 6u; k++) {
        let back = transpose(rotation_minus_identity(q));
        // The rotated-back matrix minus `second`, which exerts no moment.
        let beside = back * second + change + back * change;
        let moment = vec3(beside[1].z - beside[2].y, beside[2].x - beside[0].z, beside[0].y - beside[1].x);
        let whole = second + 0.5 * (beside + transpose(beside));
        q = quat_normalize(quat_mul(q, quat_exp(angular_response(shape, axis, inertia_of(whole), moment))));
    }
    if !(finite(q.x) && finite(q.y) && finite(q.z) && finite(q.w)) {
        return IDENTITY_ROTATION;
    }
    return q;
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    for (var b = group.x; b < params.bodies; b += groups.x) {
        let shape = shape_of(b);
        let range = textureLoad(rigid_ranges, array_texel(2u * b), 0);
        let far = textureLoad(rigid_ranges, array_texel(2u * b + 1u), 0);
        let r0 = textureLoad(rigid_arms, array_texel(far.x), 0).xyz;
        let r1 = textureLoad(rigid_arms, array_texel(far.y), 0).xyz;
        let r2 = textureLoad(rigid_arms, array_texel(far.z), 0).xyz;
        let x0 = textureLoad(positions, array_texel(far.x), 0).xyz;
        let x1 = textureLoad(positions, array_texel(far.y), 0).xyz;
        let x2 = textureLoad(positions, array_texel(far.z), 0).xyz;
        let now = orthonormal_frame(x1 - x0, x2 - x0);
        let near = quat_from_matrix(now * transpose(orthonormal_frame(r1 - r0, r2 - r0)));
        var shift = shift_of(far.x) - rotation_displacement(near, r0 - shape.anchor);
        if range.z != INVALID_NODE {
            shift = shift_of(range.z);
        }
        var error = vec3(0.0);
        var moment = vec3(0.0);
        var sums = array<vec3<f32>, 8>();
        for (var k = lane; k < range.y; k += WORKGROUP) {
            let i = textureLoad(members, array_texel(range.x + k), 0).x;
            let m = textureLoad(masses, array_texel(i), 0).x;
            let r = textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor;
            let a = quat_rotate(near, r);
            // Residual due to rounding, or to the f32 positions of the three nodes.
            let e = shift_of(i) - shift - rotation_displacement(near, r);
            error += m * e;
            moment += m * cross(a, e);
            let v = textureLoad(velocities, array_texel(i), 0).xyz;
            let before = textureLoad(velocities_before, array_texel(i), 0).xyz;
            let go = m * guess_velocity(1u, v, before, true);
            let swerve = m * guess_velocity(2u, v, before, true);
            sums[0] += go;
            sums[1] += go * a.x;
            sums[2] += go * a.y;
            sums[3] += go * a.z;
            sums[4] += swerve;
            sums[5] += swerve * a.x;
            sums[6] += swerve * a.y;
            sums[7] += swerve * a.z;
        }
        error = reduce(vec4(error, 0.0), lane).xyz;
        moment = reduce(vec4(moment, 0.0), lane).xyz;
        for (var k = 0u; k < 8u; k++) {
            sums[k] = reduce(vec4(sums[k], 0.0), lane).xyz;
        }
        if lane == 0u {
            let free = shape.freedom == FREE;
            if range.z == INVALID_NODE {
                shift += error / shape.mass;
            }
            let inertia = inertia_of(second_moment(shape, near));
            let turn = quat_normalize(quat_mul(quat_exp(solve_symmetric(inertia, moment)), near));
            let second = second_moment(shape, turn);
            let axis = quat_rotate(turn, shape.axis);
            textureStore(motions, array_texel(6u * b), vec4(shift, 0.0));
            textureStore(motions, array_texel(6u * b + 1u), turn);
            for (var c = 0u; c < 2u; c++) {
                let change = params.dt * mat3x3(sums[4u * c + 1u], sums[4u * c + 2u], sums[4u * c + 3u]);
                let go = select(vec3(0.0), params.dt / shape.mass * sums[4u * c], free);
                textureStore(motions, array_texel(6u * b + 2u * c + 2u), vec4(go, 0.0));
                textureStore(motions, array_texel(6u * b + 2u * c + 3u), closest_rotation(shape, axis, second, change));
            }
        }
    }
}
