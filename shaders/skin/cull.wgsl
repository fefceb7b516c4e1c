// Skin triangle culling: computes the visibility bitmask, 32 triangles per invocation. A triangle
// is culled if its base triangles prove that it faces away or lies outside the view frustum,
// without reading its vertices. CPU reference: `skin::culling::is_skipped`.

#import lib/array

struct Cull {
    triangles: u32,
    // Whether back faces are culled: the skin is opaque and has no holes.
    closed: u32,
}

// A right angle plus a small tolerance, in radians.
const BACKFACE_ANGLE: f32 = 1.5707964 + 0.035;

// Base triangles of the three vertices, and the tangent of half the largest angle at rest between
// the triangle's normal and the base normals of its vertices.
@group(0) @binding(0) var triangles: texture_2d<u32>;
@group(0) @binding(1) var outlooks: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> arguments: array<u32, 6>;
// For every 32 triangles: the bitmask of drawn triangles, and the number drawn before them (from
// `gpu/bitmask_prefix_sum`).
@group(0) @binding(3) var<storage, read_write> marks: array<u32>;
@group(0) @binding(4) var<uniform> params: Cull;

fn is_skipped(i: u32, closed: bool) -> bool {
    let triangle = textureLoad(triangles, array_texel(i), 0);
    var outlook = textureLoad(outlooks, array_texel(triangle.x), 0);
    var sides = outlook.z;
    var least = bitcast<f32>(outlook.x);
    var strain = bitcast<f32>(outlook.y);
    for (var k = 1u; k < 3u; k++) {
        if triangle[k] != triangle.x {
            outlook = textureLoad(outlooks, array_texel(triangle[k]), 0);
            sides &= outlook.z;
            least = min(least, bitcast<f32>(outlook.x));
            strain = max(strain, bitcast<f32>(outlook.y));
        }
    }
    if sides != 0u {
        return true;
    }
    // A strain s maps an angle a to at most 2 atan(s tan(a / 2)).
    return closed && least > BACKFACE_ANGLE && least > BACKFACE_ANGLE + 2.0 * atan(strain * bitcast<f32>(triangle.w));
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let run = invocation_index(id, groups);
    if 32u * run >= params.triangles {
        return;
    }
    let closed = params.closed != 0u && arguments[5] == 0u;
    var mask = 0u;
    for (var k = 0u; k < min(32u, params.triangles - 32u * run); k++) {
        mask |= u32(!is_skipped(32u * run + k, closed)) << k;
    }
    marks[2u * run] = mask;
}
