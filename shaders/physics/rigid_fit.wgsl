// Fits rigid motions after the host set node positions and velocities: mass-weighted least squares
// for pose and momentum. If nodes follow a target, the body follows them and its pinned nodes, with
// the smallest rotation that this leaves open.
//
// Writes the first four of six texels per body: displacement of the anchor, rotation, velocity of
// the anchor, angular velocity.

#import lib/rigid_members
#import lib/workgroup_sum

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var rest: texture_2d<f32>;
@group(0) @binding(4) var motions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: RigidParams;

// Least squares iterations: first with all nodes, then with the constrained nodes.
const FIT_ITERATIONS: u32 = 6u;

// Regularisation of rotations that the nodes leave undetermined, relative to their inertia.
const CONSTRAINT_WEIGHT: f32 = 1e-3;

struct Pose {
    shift: vec3<f32>,
    turn: vec4<f32>,
}

fn shift_of(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz - textureLoad(rest, array_texel(i), 0).xyz;
}

// One iteration: with the constrained nodes if `staying`, otherwise with the masses of nodes that
// do not follow a target.
fn refine_pose(range: vec4<u32>, anchor: vec3<f32>, known: Pose, staying: bool, lane: u32) -> Pose {
    var error = vec4(0.0);
    var arm = vec3(0.0);
    var moment = vec3(0.0);
    var on = vec3(0.0);
    var off = vec3(0.0);
    for (var k = lane; k < range.y; k += WORKGROUP) {
        let member = textureLoad(members, array_texel(range.x + k), 0);
        let i = member.x;
        let follows = range.w != 0u && member.z != 0u;
        let weight = select(select(textureLoad(masses, array_texel(i), 0).x, 0.0, follows), f32(member.z), staying);
        let r = textureLoad(rigid_arms, array_texel(i), 0).xyz - anchor;
        let b = quat_rotate(known.turn, r);
        let e = shift_of(i) - known.shift - rotation_displacement(known.turn, r);
        error += weight * vec4(e, 1.0);
        arm += weight * b;
        moment += weight * cross(b, e);
        on += weight * b * b;
        off += weight * b.xxy * b.yzz;
    }
    let sum = reduce(error, lane);
    let arms = reduce(vec4(arm, 0.0), lane).xyz;
    let moments = reduce(vec4(moment, 0.0), lane).xyz;
    let ons = reduce(vec4(on, 0.0), lane).xyz;
    let offs = reduce(vec4(off, 0.0), lane).xyz;
    if !(sum.w > 0.0) {
        return known;
    }
    // Relative to the mean.
    let b = arms / sum.w;
    let e = sum.xyz / sum.w;
    let m = sym_matrix(ons - sum.w * b * b, offs - sum.w * b.xxy * b.yzz);
    var inertia = inertia_of(m);
    let hold = CONSTRAINT_WEIGHT * (ons.x + ons.y + ons.z) + 1e-30;
    inertia += mat3x3(hold, 0.0, 0.0, 0.0, hold, 0.0, 0.0, 0.0, hold);
    let w = solve_symmetric(inertia, moments - sum.w * cross(b, e));
    let shift = known.shift + e - cross(w, b);
    return Pose(shift, quat_normalize(quat_mul(quat_exp(w), known.turn)));
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
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
        let turn = quat_from_matrix(now * transpose(orthonormal_frame(r1 - r0, r2 - r0)));
        var stand = Pose(shift_of(far.x) - rotation_displacement(turn, r0 - shape.anchor), turn);
        for (var k = 0u; k < FIT_ITERATIONS; k++) {
            stand = refine_pose(range, shape.anchor, stand, false, lane);
        }
        for (var k = 0u; k < FIT_ITERATIONS; k++) {
            let led = refine_pose(range, shape.anchor, stand, true, lane);
            if range.w != 0u {
                stand = led;
            }
        }
        if range.w == 0u && range.z != INVALID_NODE {
            stand.shift = shift_of(range.z);
        }
        var momentum = vec3(0.0);
        var moment = vec3(0.0);
        for (var k = lane; k < range.y; k += WORKGROUP) {
            let i = textureLoad(members, array_texel(range.x + k), 0).x;
            let r = quat_rotate(stand.turn, textureLoad(rigid_arms, array_texel(i), 0).xyz - shape.anchor);
            let p = textureLoad(masses, array_texel(i), 0).x * textureLoad(velocities, array_texel(i), 0).xyz;
            momentum += p;
            moment += cross(r, p);
        }
        momentum = reduce(vec4(momentum, 0.0), lane).xyz;
        moment = reduce(vec4(moment, 0.0), lane).xyz;
        let inertia = inertia_of(second_moment(shape, stand.turn));
        let spin = angular_response(shape, quat_rotate(stand.turn, shape.axis), inertia, moment);
        let free = shape.freedom == FREE;
        if lane == 0u {
            textureStore(motions, array_texel(6u * b), vec4(stand.shift, 0.0));
            textureStore(motions, array_texel(6u * b + 1u), stand.turn);
            textureStore(motions, array_texel(6u * b + 2u), vec4(select(vec3(0.0), momentum / shape.mass, free), 0.0));
            textureStore(motions, array_texel(6u * b + 3u), vec4(spin, 0.0));
        }
    }
}
