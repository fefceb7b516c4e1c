// Evaluates the table for a list of segments, with the look-up of the traversals, for comparison
// with the exact integral.

#import lib/array
#import lib/view

// Each segment: scalars (0 to 1 over the field's range) at front and back, length in local units.
@group(0) @binding(0) var segments: texture_2d<f32>;
@group(0) @binding(1) var found: texture_storage_2d<rgba32float, write>;
// `nodes` is the number of segments.
@group(0) @binding(2) var<uniform> params: View;

#each table #import terms/TERM

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let given = textureLoad(segments, array_texel(i), 0);
    let s = params.scalar.x * given.xy + params.scalar.y;
    textureStore(found, array_texel(i), segment(s.x, s.y, given.z * params.opacity, 0u));
}
