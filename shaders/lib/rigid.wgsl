// Rigid bodies and rotations. Host side: `physics::gpu::rigid`.
//
// A body is described relative to its anchor: its centre of mass if it is free, otherwise the first
// of its fixed nodes. Node positions are displacements from rest, which keeps full precision for
// bodies at rest.

#import lib/array
#import lib/rotation

// For each node: its rest position relative to its body's centre of mass; w is the body number plus
// one, 0 for a node without a body.
@group(0) @binding(next) var rigid_arms: texture_2d<f32>;
// Four texels per body: see `shape_of`.
@group(0) @binding(next) var rigid_shapes: texture_2d<f32>;

// Degrees of freedom: unconstrained, rotation about the anchor, rotation about an axis, none.
const FREE: u32 = 0u;
const FIXED_POINT: u32 = 1u;
const HINGE: u32 = 2u;
const FIXED: u32 = 3u;

struct RigidShape {
    // Relative to the centre of mass at rest.
    anchor: vec3<f32>,
    mass: f32,
    // Σ m r rᵀ about the anchor at rest: the diagonal, and xy, xz, yz.
    on: vec3<f32>,
    off: vec3<f32>,
    // The radius of gyration about the anchor.
    radius: f32,
    freedom: u32,
    // Hinge axis at rest.
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

const IDENTITY_ROTATION: vec4<f32> = vec4<f32>(0.0, 0.0, 0.0, 1.0);

// Returns the rotation that applies b first, then a.
fn quat_mul(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

// Normalises to a few units in the last place; square roots of the device may be less accurate.
fn quat_normalize(q: vec4<f32>) -> vec4<f32> {
    let near = q * inverseSqrt(dot(q, q));
    return near * (1.5 - 0.5 * dot(near, near));
}

// Returns the quaternion of a rotation vector. Device sines are too imprecise, so a series is
// evaluated for a quarter of the angle.
fn quat_exp(w: vec3<f32>) -> vec4<f32> {
    let half = 0.125 * w;
    let s = dot(half, half);
    let sine = half * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0)));
    let once = vec4(sine, sqrt(max(1.0 - dot(sine, sine), 0.0)));
    let twice = quat_mul(once, once);
    return quat_normalize(quat_mul(twice, twice));
}

// Returns R − I as a matrix.
fn rotation_minus_identity(q: vec4<f32>) -> mat3x3<f32> {
    return mat3x3(
        rotation_displacement(q, vec3(1.0, 0.0, 0.0)),
        rotation_displacement(q, vec3(0.0, 1.0, 0.0)),
        rotation_displacement(q, vec3(0.0, 0.0, 1.0)),
    );
}

// Returns Σ m r rᵀ of a body rotated by q.
fn second_moment(shape: RigidShape, q: vec4<f32>) -> mat3x3<f32> {
    let r = mat3x3(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0) + rotation_minus_identity(q);
    let m = r * sym_matrix(shape.on, shape.off) * transpose(r);
    return 0.5 * (m + transpose(m));
}

// Returns the inertia tensor tr(m) I − m of a second moment m.
fn inertia_of(m: mat3x3<f32>) -> mat3x3<f32> {
    let t = m[0].x + m[1].y + m[2].z;
    return mat3x3(t - m[0].x, -m[0].y, -m[0].z, -m[1].x, t - m[1].y, -m[1].z, -m[2].x, -m[2].y, t - m[2].z);
}

// Returns m⁻¹ v for a symmetric positive definite m.
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

// Returns the angular response to `moment` of a body with this inertia and current hinge axis.
fn angular_response(shape: RigidShape, axis: vec3<f32>, inertia: mat3x3<f32>, moment: vec3<f32>) -> vec3<f32> {
    if shape.freedom == FIXED {
        return vec3(0.0);
    }
    if shape.freedom == HINGE {
        return axis * (dot(axis, moment) / max(dot(axis, inertia * axis), 1e-37));
    }
    return solve_symmetric(inertia, moment);
}
