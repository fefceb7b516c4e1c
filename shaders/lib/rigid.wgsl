// Rigid bodies, and rotations. The twin of `physics::gpu_rigid`.
//
// A body is reckoned from its anchor: its centre of mass where it is free, else the first of its
// nodes that stays. Where its nodes are is told by displacements from rest, so that what is at rest
// keeps its digits.

#import lib/array

// Of each node: where it rests from its body's centre of mass; in w one more than the number of the
// body, 0 where it belongs to none.
@group(0) @binding(next) var rigid_arms: texture_2d<f32>;
// Four texels a body: see `shape_of`.
@group(0) @binding(next) var rigid_shapes: texture_2d<f32>;

// How a body can move: as it likes, about its anchor, about an axis through that, not at all.
const FREE: u32 = 0u;
const FIXED_POINT: u32 = 1u;
const HINGE: u32 = 2u;
const FIXED: u32 = 3u;

struct RigidShape {
    // From the centre of mass at rest.
    anchor: vec3<f32>,
    mass: f32,
    // Σ m r rᵀ about the anchor at rest: the diagonal, and xy, xz, yz.
    on: vec3<f32>,
    off: vec3<f32>,
    // The radius of gyration about it.
    radius: f32,
    freedom: u32,
    // Of a hinge, at rest.
    axis: vec3<f32>,
}

fn shape_of(b: u32) -> RigidShape {
    let a = textureLoad(rigid_shapes, array_texel(4u * b), 0);
    let on = textureLoad(rigid_shapes, array_texel(4u * b + 1u), 0);
    let off = textureLoad(rigid_shapes, array_texel(4u * b + 2u), 0);
    let axis = textureLoad(rigid_shapes, array_texel(4u * b + 3u), 0).xyz;
    return RigidShape(a.xyz, a.w, on.xyz, off.xyz, on.w, u32(off.w), axis);
}

fn sym_matrix(on: vec3<f32>, off: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(on.x, off.x, off.y, off.x, on.y, off.z, off.y, off.z, on.z);
}

// Rotations are unit quaternions, the real part last.

const IDENTITY_ROTATION: vec4<f32> = vec4<f32>(0.0, 0.0, 0.0, 1.0);

// First b, then a.
fn quat_mul(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

// How far the rotation takes v.
fn rotation_displacement(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v);
}

fn quat_rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return v + rotation_displacement(q, v);
}

// To a few units in the last place: square roots may be off by more.
fn quat_normalize(q: vec4<f32>) -> vec4<f32> {
    let near = q * inverseSqrt(dot(q, q));
    return near * (1.5 - 0.5 * dot(near, near));
}

// By a rotation vector. Sines of the device are not precise enough: a series for a quarter of it.
fn quat_exp(w: vec3<f32>) -> vec4<f32> {
    let half = 0.125 * w;
    let s = dot(half, half);
    let sine = half * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0)));
    let once = vec4(sine, sqrt(max(1.0 - dot(sine, sine), 0.0)));
    let twice = quat_mul(once, once);
    return quat_normalize(quat_mul(twice, twice));
}

// The matrix of `rotation_displacement`.
fn rotation_minus_identity(q: vec4<f32>) -> mat3x3<f32> {
    return mat3x3(
        rotation_displacement(q, vec3(1.0, 0.0, 0.0)),
        rotation_displacement(q, vec3(0.0, 1.0, 0.0)),
        rotation_displacement(q, vec3(0.0, 0.0, 1.0)),
    );
}

// Σ m r rᵀ of a body turned by q.
fn second_moment(shape: RigidShape, q: vec4<f32>) -> mat3x3<f32> {
    let r = mat3x3(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0) + rotation_minus_identity(q);
    let m = r * sym_matrix(shape.on, shape.off) * transpose(r);
    return 0.5 * (m + transpose(m));
}

// tr(m) I − m: the inertia that goes with a second moment.
fn inertia_of(m: mat3x3<f32>) -> mat3x3<f32> {
    let t = m[0].x + m[1].y + m[2].z;
    return mat3x3(t - m[0].x, -m[0].y, -m[0].z, -m[1].x, t - m[1].y, -m[1].z, -m[2].x, -m[2].y, t - m[2].z);
}

// m⁻¹ v of a symmetric positive m.
fn solve_symmetric(m: mat3x3<f32>, v: vec3<f32>) -> vec3<f32> {
    let scale = 1.0 / max(m[0].x + m[1].y + m[2].z, 1e-37);
    let a = m[0] * scale;
    let b = m[1] * scale;
    let c = m[2] * scale;
    let bc = cross(b, c);
    let determinant = dot(a, bc);
    let x = vec3(dot(v, bc), dot(a, cross(v, c)), dot(a, cross(b, v)));
    return select(vec3(0.0), x * (scale / determinant), determinant > 1e-20);
}

// The turn that `moment` gives a body of this inertia, whose hinge stands at `axis` now.
fn angular_response(shape: RigidShape, axis: vec3<f32>, inertia: mat3x3<f32>, moment: vec3<f32>) -> vec3<f32> {
    if shape.freedom == FIXED {
        return vec3(0.0);
    }
    if shape.freedom == HINGE {
        return axis * (dot(axis, moment) / max(dot(axis, inertia * axis), 1e-37));
    }
    return solve_symmetric(inertia, moment);
}
