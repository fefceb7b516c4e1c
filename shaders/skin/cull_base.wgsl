// Computes bounds for each base triangle, once per image: the minimum angle between the view
// direction and the normals that its skin vertices use, the maximum strain of the skin, and the
// frustum planes that it lies outside of. CPU reference: `skin::culling`.

#import lib/array
#import lib/normals
#import lib/view

// Upper bound of the strain, so that products with it stay finite.
const MAX_STRAIN: f32 = 1e6;
const MAX_CURVATURE: f32 = 0.999;

struct CullBase {
    view: View,
    triangles: u32,
    _pad0: u32,
    _pad1: u32,
    _pad2: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var node_normals: texture_2d<u32>;
// Three texels per base triangle: (1) nodes, and the maximum offset of skin vertices; (2) inverse
// of the rest Gram matrix of the edges (xx, xy, yy), and flags: bit 0 if a vertex follows the node
// normals, bit 1 if one follows the face normal; (3) offset times curvature along each side at
// rest.
@group(0) @binding(2) var base: texture_2d<u32>;
// Angle, strain and outcode of each base triangle.
@group(0) @binding(3) var outlooks: texture_storage_2d<rgba32uint, write>;
// Draw arguments; word 5 is set if geometry lies behind the near plane, so the eye may be inside.
@group(0) @binding(4) var<storage, read_write> arguments: array<atomic<u32>, 6>;
@group(0) @binding(5) var<uniform> params: CullBase;

fn eye_direction(q: vec3<f32>) -> vec3<f32> {
    let view = params.view;
    return select(vec3(0.0, 0.0, -1.0), vec3(0.0, 0.0, -view.depth.w) - q, view.depth.z > 0.0);
}

// Returns the angle between two vectors of any length.
fn angle(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return atan2(length(cross(a, b)), dot(a, b));
}

fn turned(v: vec3<f32>) -> vec3<f32> {
    let view = params.view;
    return vec3(dot(view.right.xyz, v), dot(view.up.xyz, v), dot(view.forward.xyz, v));
}

// Whether everything within `reach` lies outside the plane with this value and gradient.
fn is_outside(value: f32, slope: vec3<f32>, reach: f32) -> bool {
    return value < -reach * length(slope);
}

fn frustum_outcode(q: vec3<f32>, reach: f32) -> u32 {
    let view = params.view;
    let w = view.depth.z * q.z + view.depth.w;
    let x = view.clip.x * q.x;
    let y = view.clip.y * q.y;
    let right = is_outside((1.0 - view.clip.z) * w - x, vec3(-view.clip.x, 0.0, (1.0 - view.clip.z) * view.depth.z), reach);
    let left = is_outside((1.0 + view.clip.z) * w + x, vec3(view.clip.x, 0.0, (1.0 + view.clip.z) * view.depth.z), reach);
    let top = is_outside((1.0 - view.clip.w) * w - y, vec3(0.0, -view.clip.y, (1.0 - view.clip.w) * view.depth.z), reach);
    let bottom = is_outside((1.0 + view.clip.w) * w + y, vec3(0.0, view.clip.y, (1.0 + view.clip.w) * view.depth.z), reach);
    let behind = q.z + reach < view.near;
    return u32(right) | (u32(left) << 1u) | (u32(top) << 2u) | (u32(bottom) << 3u) | (u32(behind) << 4u);
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.triangles {
        return;
    }
    let nodes = textureLoad(base, array_texel(3u * i), 0);
    let second = textureLoad(base, array_texel(3u * i + 1u), 0);
    let rest = bitcast<vec4<f32>>(second);
    let rest_bends = bitcast<vec4<f32>>(textureLoad(base, array_texel(3u * i + 2u), 0));
    let offset = bitcast<f32>(nodes.w);
    var p: array<vec3<f32>, 3>;
    var n: array<vec3<f32>, 3>;
    var known = true;
    for (var k = 0u; k < 3u; k++) {
        p[k] = textureLoad(positions, array_texel(nodes[k]), 0).xyz;
        let packed = textureLoad(node_normals, array_texel(nodes[k]), 0).x;
        known = known && packed != NO_NORMAL;
        n[k] = unpack_normal(packed);
    }
    let u = p[1] - p[0];
    let v = p[2] - p[0];
    let edges = vec3(dot(u, u), dot(v - u, v - u), dot(v, v));
    let longest = sqrt(max(edges.x, max(edges.y, edges.z)));
    let reach = offset + longest;

    // The squared principal stretches are the eigenvalues of (edges at rest)⁻¹ (edges now).
    let uv = dot(u, v);
    let trace = rest.x * edges.x + 2.0 * rest.y * uv + rest.z * edges.z;
    let det = (rest.x * rest.z - rest.y * rest.y) * (edges.x * edges.z - uv * uv);
    let root = sqrt(max(trace * trace - 4.0 * det, 0.0));
    let largest = 0.5 * (trace + root);
    let smallest = det / max(largest, 1e-30);
    let stretch = sqrt(max(largest, 1.0) / max(min(smallest, 1.0), 1e-12));
    // Curvature stretches offset geometry along a side by the factor 1 + offset · curvature.
    var bent = 1.0;
    for (var k = 0u; k < 3u; k++) {
        let next = (k + 1u) % 3u;
        let side = p[next] - p[k];
        let bend = clamp(offset * dot(n[next] - n[k], side) / max(dot(side, side), 1e-30), -MAX_CURVATURE, MAX_CURVATURE);
        let outwards = (1.0 + bend) / (1.0 + rest_bends[k]);
        let inwards = (1.0 - bend) / (1.0 - rest_bends[k]);
        bent = max(bent, max(max(outwards, 1.0 / outwards), max(inwards, 1.0 / inwards)));
    }
    let strain = min(stretch * bent, MAX_STRAIN);

    let face = turned(cross(u, v));
    var least = 4.0;
    for (var k = 0u; k < 3u; k++) {
        let eye = eye_direction(to_camera(params.view, p[k]));
        // Bound on the change of the view direction between points within `reach`.
        var aside = 0.0;
        if params.view.depth.z > 0.0 {
            aside = asin(min(reach / max(length(eye), 1e-30), 1.0));
        }
        let smooth_ = select(4.0, angle(turned(n[k]), eye), (second.w & 1u) != 0u);
        let flat_ = select(4.0, angle(face, eye), (second.w & 2u) != 0u);
        least = min(least, min(smooth_, flat_) - aside);
    }
    let q = to_camera(params.view, p[0]);
    if q.z - reach < params.view.near {
        atomicStore(&arguments[5], 1u);
    }
    let angle_ = select(-1.0, least, known);
    textureStore(outlooks, array_texel(i), vec4(bitcast<u32>(angle_), bitcast<u32>(strain), frustum_outcode(q, reach), 0u));
}
