// Computes the Hessian of the energy of every tet in its principal frame: eight texels per tet. U,
// with the diagonal of ∂²Ψ/∂σ² in w; the gradients of its last three nodes in the frame of V, with
// the off-diagonal entries (1 2), (2 0), (0 1) in w; flips; twists. All but U and the gradients are
// scaled by the volume.

#each law #import terms/TERM
#import lib/status

struct CurvatureParams {
    tets: u32,
    _pad0: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var<storage, read> status: Status;
@group(0) @binding(2) var curvatures: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var<uniform> params: CurvatureParams;

fn shift_of(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz - textureLoad(rest, array_texel(i), 0).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let e = invocation_index(id, groups);
    if e >= params.tets || status.failed != 0u || status.solving != 0u {
        return;
    }
    let tet = load_tet(e);
    let n = tet.nodes;
    let frame = frame_of(displacement_gradient(tet, shift_of(n.x), shift_of(n.y), shift_of(n.z), shift_of(n.w)));
#each law     let c = project_psd(TERM_curvature(frame.strain, tet.mu, tet.lambda));
    let g = transpose(frame.v) * tet.gradients;
    let first = 8u * e;
    textureStore(curvatures, array_texel(first), vec4(frame.u[0], c.stretch[0].x));
    textureStore(curvatures, array_texel(first + 1u), vec4(frame.u[1], c.stretch[1].y));
    textureStore(curvatures, array_texel(first + 2u), vec4(frame.u[2], c.stretch[2].z));
    textureStore(curvatures, array_texel(first + 3u), vec4(g[0], c.stretch[1].z));
    textureStore(curvatures, array_texel(first + 4u), vec4(g[1], c.stretch[2].x));
    textureStore(curvatures, array_texel(first + 5u), vec4(g[2], c.stretch[0].y));
    textureStore(curvatures, array_texel(first + 6u), vec4(c.flip, 0.0));
    textureStore(curvatures, array_texel(first + 7u), vec4(c.twist, 0.0));
}
