// After the system of a state was made: whether that is the end of the step. One workgroup.

#import lib/cg
#import lib/tool_way

struct DecideParams {
    // Workgroups that wrote a partial sum.
    groups: u32,
    // 1 where a tool has friction.
    rubs: u32,
}

@group(0) @binding(next) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(next) var<storage, read_write> scalars: CgScalars;
@group(0) @binding(next) var<storage, read_write> status: Status;
@group(0) @binding(next) var<storage, read_write> pushing: Pushing;
@group(0) @binding(next) var<uniform> params: DecideParams;

// Square of the residual to reach, over the forces on what tools touch; and of that at which friction takes
// over normal forces.
const TOLERANCE: f32 = 1e-6;
const ROUGH: f32 = 100.0;

// How often it does so in a step at most.
const MOST_RUBS: u32 = 6u;

// Iterations of a step at most after the last stage, and of those that come no nearer in a row.
const MOST: u32 = 100u;
const STALE: u32 = 10u;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var share = vec4(0.0);
    for (var k = lane; k < params.groups; k += WORKGROUP) {
        share += partials[k];
    }
    let total = reduce(share, lane);
    if lane != 0u || status.failed != 0u || status.solving != 0u {
        return;
    }
    status.solving = 1u;
    let rubbed = pushing.rub != 0u;
    pushing.rub = 0u;
    let touches = total.z > 0.0;
    let bare = pushing.bare != 0u;
    pushing.bare = select(1u, 0u, touches);
    if pushing.fresh != 0u {
        pushing.fresh = 0u;
        // Tools that come near nothing go all their way at once.
        if pushing.near == 0u {
            pushing.stage = pushing.stages;
            pushing.follows = 0u;
            pushing.wide = 0.0;
            go_to_stage(pushing.stage, pushing.stages);
        }
        return;
    }
    if pushing.follows != 0u || pushing.wide > 0.0 {
        return;
    }
    let square = total.x;
    status.residual = select(0.0, sqrt(max(square, 0.0) / total.z), touches);
    let goal = TOLERANCE * total.z;
    let rubs = params.rubs != 0u && touches && pushing.rubs < MOST_RUBS;
    if square < 0.7 * pushing.least {
        pushing.least = square;
        pushing.stale = 0u;
    } else {
        pushing.stale += 1u;
    }
    // What touches nothing from the first is found in one iteration, as without tools.
    let free = bare && !touches && pushing.tried >= 1.0;
    let near = square <= goal && (rubbed || !rubs);
    let spent = pushing.round >= pushing.stages + MOST || pushing.stale >= STALE;
    if free || near || spent || !finite(square) {
        pushing.done = 1u;
        scalars.done = MET;
        if total.w > 0.0 {
            status.failed = PIERCED;
        }
        return;
    }
    pushing.rub = select(0u, 1u, rubs && square <= ROUGH * goal);
}
