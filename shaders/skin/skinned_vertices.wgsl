// Writes the deformed skin vertices, three texels each: position, normal, tangent.

#import lib/skin

struct Place {
    vertices: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var node_normals: texture_2d<u32>;
@group(0) @binding(2) var vertices: texture_2d<u32>;
@group(0) @binding(3) var result: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: Place;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.vertices {
        return;
    }
    let vertex = skin_vertex(i);
    textureStore(result, array_texel(3u * i), vec4(vertex.position, 1.0));
    textureStore(result, array_texel(3u * i + 1u), vec4(vertex.normal, 0.0));
    textureStore(result, array_texel(3u * i + 2u), vertex.tangent);
}
