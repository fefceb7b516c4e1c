// Runs before every few iterations: sets the indirect dispatch sizes, zero once the solve has
// finished.

#import lib/cg

struct GateParams {
    groups: u32,
    max_iterations: u32,
    // Number of workgroups of passes over rigid bodies.
    rigid_groups: u32,
    _pad0: u32,
}

@group(0) @binding(0) var<storage, read> status: Status;
@group(0) @binding(1) var<storage, read> scalars: CgScalars;
@group(0) @binding(2) var<storage, read_write> arguments: array<u32, 6>;
@group(0) @binding(3) var<uniform> params: GateParams;

@compute @workgroup_size(1)
fn main() {
    let over = status.failed != 0u || scalars.done != 0u || scalars.iterations >= params.max_iterations;
    let groups = select(vec2(params.groups, params.rigid_groups), vec2(0u), over);
    arguments = array(groups.x, 1u, 1u, groups.y, 1u, 1u);
}
