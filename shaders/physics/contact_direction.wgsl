// Stores the Newton direction: the velocity change from the linear solve.

#import lib/cg

struct DirectionParams {
    nodes: u32,
}

// Solution after an even and after an odd number of iterations.
@group(0) @binding(0) var even: texture_2d<f32>;
@group(0) @binding(1) var odd: texture_2d<f32>;
@group(0) @binding(2) var masses: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> scalars: CgScalars;
@group(0) @binding(4) var<storage, read> status: Status;
@group(0) @binding(5) var direction: texture_storage_2d<rgba32float, write>;
@group(0) @binding(6) var<uniform> params: DirectionParams;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes || status.failed != 0u || status.solving != 0u {
        return;
    }
    var change = vec4(0.0);
    if scalars.iterations != 0u && textureLoad(masses, array_texel(i), 0).y != 0.0 {
        if (scalars.iterations & 1u) == 0u {
            change = textureLoad(even, array_texel(i), 0);
        } else {
            change = textureLoad(odd, array_texel(i), 0);
        }
    }
    textureStore(direction, array_texel(i), change);
}
