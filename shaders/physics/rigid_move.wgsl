// Final update of rigid bodies once Δv is known: translates and rotates each body from the start of
// the step, and places its nodes by their rest shape and the new pose. Velocities are these
// displacements over the step, from which the next step derives the inertial motion.

#import lib/rigid_members
#import lib/workgroup_sum
#import lib/status

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var rest: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var motions: texture_2d<f32>;
// Δv: in the first texture after an even number of iterations, otherwise in the second.
@group(0) @binding(4) var even: texture_2d<f32>;
@group(0) @binding(5) var odd: texture_2d<f32>;
@group(0) @binding(6) var<storage, read> choice: array<u32>;
@group(0) @binding(7) var<storage, read> status: Status;
@group(0) @binding(8) var next_positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(9) var next_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(10) var<uniform> params: RigidParams;

fn change_of(i: u32, iterations: u32) -> vec3<f32> {
    if iterations == 0u {
        return vec3(0.0);
    }
    if (iterations & 1u) == 0u {
        return textureLoad(even, array_texel(i), 0).xyz;
    }
    return textureLoad(odd, array_texel(i), 0).xyz;
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
        let shifted = textureLoad(motions, array_texel(6u * b), 0).xyz;
        let now = textureLoad(motions, array_texel(6u * b + 1u), 0);
        var shift = vec3(0.0);
        var by = IDENTITY_ROTATION;
        if choice[0] != 0u {
            shift = textureLoad(motions, array_texel(6u * b + 2u * choice[0]), 0).xyz;
            by = textureLoad(motions, array_texel(6u * b + 2u * choice[0] + 1u), 0);
        }
        let start = quat_normalize(quat_mul(by, now));
        var momentum = vec3(0.0);
        var moment = vec3(0.0);
        for (var k = lane; k < range.y; k += WORKGROUP) {
            let i = textureLoad(members, array_texel(range.x + k), 0).x;
            let a = quat_rotate(start, textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor);
            let p = textureLoad(masses, array_texel(i), 0).x * change_of(i, status.iterations);
            momentum += p;
            moment += cross(a, p);
        }
        momentum = reduce(vec4(momentum, 0.0), lane).xyz;
        moment = reduce(vec4(moment, 0.0), lane).xyz;
        if shape.freedom == FREE {
            shift += params.dt / shape.mass * momentum;
        }
        let inertia = inertia_of(second_moment(shape, start));
        let w = angular_response(shape, quat_rotate(start, shape.axis), inertia, moment);
        by = quat_normalize(quat_mul(quat_exp(params.dt * w), by));
        let then = quat_normalize(quat_mul(by, now));
        for (var k = lane; k < range.y; k += WORKGROUP) {
            if shape.freedom == FIXED {
                break;
            }
            let i = textureLoad(members, array_texel(range.x + k), 0).x;
            let r = textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor;
            let u = shifted + shift + rotation_displacement(then, r);
            let v = (shift + rotation_displacement(by, quat_rotate(now, r))) / params.dt;
            let x = textureLoad(rest, array_texel(i), 0).xyz + u;
            textureStore(next_positions, array_texel(i), vec4(x, textureLoad(positions, array_texel(i), 0).w));
            textureStore(next_velocities, array_texel(i), vec4(v, 0.0));
        }
    }
}
