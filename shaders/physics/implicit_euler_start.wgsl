// Selects the initial guess of least potential for an implicit finite element step. Every workgroup
// sums the potentials itself and makes the same choice.

#each rigid #import terms/TERM
#import lib/workgroup_sum
#import lib/initial_guess
#import lib/status

struct StartParams {
    nodes: u32,
    // Number of workgroups that wrote a partial sum.
    groups: u32,
    dt: f32,
    _pad0: u32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var velocities: texture_2d<f32>;
@group(0) @binding(2) var velocities_before: texture_2d<f32>;
@group(0) @binding(3) var masses: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> status: Status;
@group(0) @binding(6) var start_positions: texture_storage_2d<rgba32float, write>;
@group(0) @binding(7) var start_velocities: texture_storage_2d<rgba32float, write>;
@group(0) @binding(8) var<uniform> params: StartParams;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    if status.failed != 0u || status.solving != 0u {
        return;
    }
    var share = vec4(0.0);
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        share += partials[k];
    }
    let total = reduce(share, lane);
    var choice = 0u;
    for (var c = 1u; c < GUESS_COUNT; c++) {
        if finite(total[c]) && (!finite(total[choice]) || total[c] < total[choice]) {
            choice = c;
        }
    }
#each rigid     if id.x == 0u {
#each rigid         TERM_choice[0] = choice;
#each rigid     }
    for (var i = id.x; i < params.nodes; i += groups.x * WORKGROUP) {
        let x = textureLoad(positions, array_texel(i), 0);
        let v = textureLoad(velocities, array_texel(i), 0);
        let before = textureLoad(velocities_before, array_texel(i), 0).xyz;
        let free = textureLoad(masses, array_texel(i), 0).y != 0.0;
        var w = guess_velocity(choice, v.xyz, before, free);
#each rigid         if free {
#each rigid             w = TERM_velocity(i, choice, params.dt, w);
#each rigid         }
        textureStore(start_positions, array_texel(i), vec4(x.xyz + params.dt * w, x.w));
        textureStore(start_velocities, array_texel(i), vec4(w, v.w));
    }
}
