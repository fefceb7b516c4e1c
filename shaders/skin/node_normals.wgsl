// Computes packed area-weighted normals at the nodes of the base triangles, whenever a skin is
// drawn. CPU reference: `skin::basis::node_normals`.

#import lib/array
#import lib/normals

struct Normals {
    nodes: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var triangles: texture_2d<u32>;
// Row offsets: `around[firsts[i]]` to `around[firsts[i + 1] - 1]` are the triangles around node i.
@group(0) @binding(2) var firsts: texture_2d<u32>;
// Triangles around each node.
@group(0) @binding(3) var around: texture_2d<u32>;
@group(0) @binding(4) var normals: texture_storage_2d<r32uint, write>;
@group(0) @binding(5) var<uniform> params: Normals;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let last = textureLoad(firsts, array_texel(i + 1u), 0).x;
    var sum = vec3(0.0);
    for (var k = textureLoad(firsts, array_texel(i), 0).x; k < last; k++) {
        let triangle = textureLoad(triangles, array_texel(textureLoad(around, array_texel(k), 0).x), 0);
        let a = textureLoad(positions, array_texel(triangle.x), 0).xyz;
        let b = textureLoad(positions, array_texel(triangle.y), 0).xyz;
        let c = textureLoad(positions, array_texel(triangle.z), 0).xyz;
        sum += cross(b - a, c - a);
    }
    textureStore(normals, array_texel(i), vec4(pack_normal(sum), 0u, 0u, 0u));
}
