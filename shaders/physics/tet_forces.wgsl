// Computes forces and energy of every finite element: four texels per tet, with the nodal force −V
// P g of each corner. The last component is the energy at the first corner, and 1 at the second if
// the tet is inverted. P includes stiffness-proportional damping: the time τ times the rate of P
// due to the velocities.

#each law #import terms/TERM
#import lib/status

struct TetForceParams {
    tets: u32,
    // Damping time τ.
    damping_time: f32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> status: Status;
@group(0) @binding(3) var tet_forces: texture_storage_2d<rgba32float, write>;
@group(0) @binding(4) var<uniform> params: TetForceParams;

fn shift_of(i: u32) -> vec3<f32> {
    return textureLoad(positions, array_texel(i), 0).xyz - textureLoad(rest, array_texel(i), 0).xyz;
}

fn velocity_of(i: u32) -> vec3<f32> {
    return textureLoad(velocities, array_texel(i), 0).xyz;
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let e = invocation_index(id, groups);
    if e >= params.tets || status.failed != 0u || status.solving != 0u {
        return;
    }
    let tet = load_tet(e);
    let n = tet.nodes;
    let g = displacement_gradient(tet, shift_of(n.x), shift_of(n.y), shift_of(n.z), shift_of(n.w));
#each law     var stress = TERM_stress(g, tet.mu, tet.lambda);
#each law     let energy = TERM_energy(g, tet.mu, tet.lambda);
    if params.damping_time > 0.0 {
        let rate = displacement_gradient(tet, velocity_of(n.x), velocity_of(n.y), velocity_of(n.z), velocity_of(n.w));
        let frame = frame_of(g);
#each law         let curvature = project_psd(TERM_curvature(frame.strain, tet.mu, tet.lambda));
        stress += params.damping_time * stress_differential(curvature, frame, rate);
    }
    let inverted = select(0.0, 1.0, 1.0 + volume_change(g, cofactor(g)) < 0.0);
    let f = stress * tet.gradients;
    textureStore(tet_forces, array_texel(4u * e), vec4(f[0] + f[1] + f[2], energy));
    textureStore(tet_forces, array_texel(4u * e + 1u), vec4(-f[0], inverted));
    textureStore(tet_forces, array_texel(4u * e + 2u), vec4(-f[1], 0.0));
    textureStore(tet_forces, array_texel(4u * e + 3u), vec4(-f[2], 0.0));
}
