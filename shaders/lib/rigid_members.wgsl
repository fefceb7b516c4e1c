// The nodes of each rigid body, for passes with one workgroup per body.

#import lib/rigid

// For each member: its node, its row among the edges, whether it is pinned or constrained.
@group(0) @binding(next) var members: texture_2d<u32>;
// Two texels per body: its first member, the number of members, its anchor node (or INVALID_NODE),
// whether any of its nodes follows a target; three of its nodes that are far apart.
@group(0) @binding(next) var rigid_ranges: texture_2d<u32>;

const INVALID_NODE: u32 = 0xffffffffu;

struct RigidParams {
    bodies: u32,
    members: u32,
    nodes: u32,
    // Number of workgroups of the passes over all nodes, whose partial sums come first.
    groups: u32,
    dt: f32,
    // h α, for mass-proportional damping with the force −α m v.
    drag: f32,
    // Whether nodal terms add blocks.
    terms: u32,
    // Whether the pass runs before the first iteration.
    first: u32,
}

// Returns an orthonormal frame from two edges of a body.
fn orthonormal_frame(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> {
    let x = normalize(a);
    let z = normalize(cross(x, b));
    return mat3x3(x, cross(z, x), z);
}

// Returns the quaternion of a rotation matrix.
fn quat_from_matrix(m: mat3x3<f32>) -> vec4<f32> {
    let t = m[0].x + m[1].y + m[2].z;
    // Four times the square of each component; dividing by the largest is safe.
    let parts = vec4(
        1.0 + 2.0 * m[0].x - t,
        1.0 + 2.0 * m[1].y - t,
        1.0 + 2.0 * m[2].z - t,
        1.0 + t,
    );
    let skew = vec3(m[1].z - m[2].y, m[2].x - m[0].z, m[0].y - m[1].x);
    let even = vec3(m[0].y + m[1].x, m[2].x + m[0].z, m[1].z + m[2].y);
    var q = vec4(skew, parts.w);
    if parts.x > parts.w && parts.x >= parts.y && parts.x >= parts.z {
        q = vec4(parts.x, even.x, even.y, skew.x);
    } else if parts.y > parts.w && parts.y >= parts.z {
        q = vec4(even.x, parts.y, even.z, skew.y);
    } else if parts.z > parts.w {
        q = vec4(even.y, even.z, parts.z, skew.z);
    }
    let length = dot(q, q);
    // Collinear nodes, or non-finite positions.
    if !(length > 1e-12 && length < 1e12) {
        return IDENTITY_ROTATION;
    }
    return quat_normalize(q);
}
