// Computes face planes and scalar gradient of every tet from its node positions, after each step.
//
// The record of a tet has eight texels: 0..3 the plane of face i (outward unit normal n, n · v); 4
// the scalar's gradient and its value at v0; 5 v0 and the range of the scalar (two 16-bit numbers);
// 6 the neighbours, as 4 tet + face with the neighbour's face numbering; 7 unused.

#import lib/array
#import lib/tet

struct Refresh {
    tets: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var scalars: texture_2d<f32>;
@group(0) @binding(2) var nodes: texture_2d<u32>;
@group(0) @binding(3) var records: texture_storage_2d<rgba32uint, write>;
@group(0) @binding(4) var<uniform> params: Refresh;

// Returns the plane through three nodes, computed in the order of their ids, so that both tets of a
// face get identical bits up to the sign, which `turn` sets.
fn plane(ids: vec3<u32>, p: array<vec3<f32>, 3>) -> vec4<f32> {
    var id = ids;
    var v = p;
    var turn = 1.0;
    if id.x > id.y {
        id = id.yxz;
        v = array(v[1], v[0], v[2]);
        turn = -turn;
    }
    if id.y > id.z {
        id = id.xzy;
        v = array(v[0], v[2], v[1]);
        turn = -turn;
    }
    if id.x > id.y {
        v = array(v[1], v[0], v[2]);
        turn = -turn;
    }
    let across = cross(v[1] - v[0], v[2] - v[0]);
    let normal = across * inverseSqrt(max(dot(across, across), 1e-37));
    return turn * vec4(normal, dot(normal, v[0]));
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation_index(id, groups);
    if t >= params.tets {
        return;
    }
    let ids = textureLoad(nodes, array_texel(t), 0);
    var v: array<vec3<f32>, 4>;
    var s: vec4<f32>;
    for (var i = 0u; i < 4u; i++) {
        v[i] = textureLoad(positions, array_texel(ids[i]), 0).xyz;
        s[i] = textureLoad(scalars, array_texel(ids[i]), 0).x;
    }
    for (var f = 0u; f < 4u; f++) {
        let c = face_corners(f);
        let face = plane(vec3(ids[c.x], ids[c.y], ids[c.z]), array(v[c.x], v[c.y], v[c.z]));
        textureStore(records, array_texel(t * 8u + f), bitcast<vec4<u32>>(face));
    }
    let a = v[1] - v[0];
    let b = v[2] - v[0];
    let c = v[3] - v[0];
    let rise = (s.y - s.x) * cross(b, c) + (s.z - s.x) * cross(c, a) + (s.w - s.x) * cross(a, b);
    let volume = dot(a, cross(b, c));
    // A degenerate tet has no gradient; clamping to its range limits the exaggerated gradient of a
    // sliver.
    let flat_tet = abs(volume) < 1e-24;
    let gradient = select(rise / select(volume, 1.0, flat_tet), vec3(0.0), flat_tet);
    let range = vec2(min(min(s.x, s.y), min(s.z, s.w)), max(max(s.x, s.y), max(s.z, s.w)));
    textureStore(records, array_texel(t * 8u + 4u), bitcast<vec4<u32>>(vec4(gradient, s.x)));
    textureStore(records, array_texel(t * 8u + 5u), vec4(bitcast<vec3<u32>>(v[0]), pack2x16unorm(range)));
}
