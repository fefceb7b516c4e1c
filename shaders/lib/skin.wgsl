// Skin vertices embedded in base triangles: equations 4 to 9 of Mosegaard & Sørensen. CPU
// reference: `skin::basis`.
//
// Needs the globals `positions`, `node_normals` (packed) and `vertices`: four texels per vertex
// with nodes and flags; offset and second weight; normal and third weight; tangent and handedness.

#import lib/array
#import lib/normals

// Sines and lengths (of sums of unit vectors) below this count as zero.
const DEGENERATE: f32 = 1e-4;
// Flag: the basis follows the interpolated node normals.
const INTERPOLATED: u32 = 1u;

struct SkinnedVertex {
    position: vec3<f32>,
    normal: vec3<f32>,
    // Along the first texture coordinate; w is 1, or -1 if the texture is mirrored.
    tangent: vec4<f32>,
}

fn unit_or_zero(v: vec3<f32>) -> vec3<f32> {
    let size = length(v);
    return select(vec3(0.0), v / size, size > 0.0);
}

fn node_normal(i: u32) -> vec3<f32> {
    let packed = textureLoad(node_normals, array_texel(i), 0).x;
    return select(unpack_normal(packed), vec3(0.0), packed == NO_NORMAL);
}

// Returns T, N and B of a triangle whose edges from p1 have the directions `along` (p2) and `other`
// (p3); `normal` is the weighted sum of the node normals.
fn carrier_frame(interpolated: bool, along: vec3<f32>, other: vec3<f32>, normal: vec3<f32>) -> mat3x3<f32> {
    if interpolated {
        // Equation 8, normalised.
        let n = unit_or_zero(normal);
        let across = cross(n, along);
        let size = length(across);
        if length(normal) > DEGENERATE && size > DEGENERATE {
            return mat3x3(cross(across / size, n), n, across / size);
        }
    }
    // Equation 6, N normalised.
    let flat_normal = cross(along, other);
    let size = length(flat_normal);
    if size > DEGENERATE {
        let n = flat_normal / size;
        return mat3x3(along, n, cross(n, along));
    }
    // Degenerate triangle: any basis with the edge as T.
    let t = select(along, vec3(1.0, 0.0, 0.0), all(along == vec3(0.0)));
    let axis = select(vec3(0.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0), abs(t.x) < 0.7);
    let n = normalize(cross(t, axis));
    return mat3x3(t, n, cross(n, t));
}

// Evaluates equation 9.
fn skin_vertex(vertex: u32) -> SkinnedVertex {
    let nodes = textureLoad(vertices, array_texel(4u * vertex), 0);
    let offset = bitcast<vec4<f32>>(textureLoad(vertices, array_texel(4u * vertex + 1u), 0));
    let normal = bitcast<vec4<f32>>(textureLoad(vertices, array_texel(4u * vertex + 2u), 0));
    let tangent = bitcast<vec4<f32>>(textureLoad(vertices, array_texel(4u * vertex + 3u), 0));
    let w = vec3(1.0 - offset.w - normal.w, offset.w, normal.w);
    let p1 = textureLoad(positions, array_texel(nodes.x), 0).xyz;
    let p2 = textureLoad(positions, array_texel(nodes.y), 0).xyz;
    let p3 = textureLoad(positions, array_texel(nodes.z), 0).xyz;
    let interpolated = (nodes.w & INTERPOLATED) != 0u;
    var sum = vec3(0.0);
    if interpolated {
        sum = w.x * node_normal(nodes.x) + w.y * node_normal(nodes.y) + w.z * node_normal(nodes.z);
    }
    let frame = carrier_frame(interpolated, unit_or_zero(p2 - p1), unit_or_zero(p3 - p1), sum);
    return SkinnedVertex(
        w.x * p1 + w.y * p2 + w.z * p3 + frame * offset.xyz,
        frame * normal.xyz,
        vec4(frame * tangent.xyz, tangent.w),
    );
}
