// Transforms the nodes to camera space, with their scalars as table coordinates. Once per frame.
//
// Sets a flag if a node lies behind the near plane: only then can the eye be inside the mesh.

#import lib/array
#import lib/view

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var scalars: texture_2d<f32>;
@group(0) @binding(2) var projected: texture_storage_2d<rgba32float, write>;
// Arguments of the draws that find back faces in front of an eye inside the mesh, and that traverse
// the mesh from there.
@group(0) @binding(3) var<storage, read_write> inside: array<atomic<u32>, 8>;
@group(0) @binding(4) var<uniform> params: View;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let q = to_camera(params, textureLoad(positions, array_texel(i), 0).xyz);
    let s = textureLoad(scalars, array_texel(i), 0).x;
    textureStore(projected, array_texel(i), vec4(q, params.scalar.x * s + params.scalar.y));
    if q.z < params.near {
        atomicStore(&inside[1], 1u);
        atomicStore(&inside[5], 1u);
    }
}
