// Computes the bounds of the deformed body for the shadow grid.

#import lib/array
#import lib/shadow_grid

struct Bounds {
    nodes: u32,
}

// Nodes farther than this from the local origin are ignored.
const MAX_COORDINATE: f32 = 1e6;

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> grid: array<atomic<u32>>;
@group(0) @binding(2) var<uniform> params: Bounds;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let p = textureLoad(positions, array_texel(i), 0).xyz;
    if !all(abs(p) < vec3(MAX_COORDINATE)) {
        return;
    }
    for (var k = 0u; k < 3u; k++) {
        let x = order_preserving_bits(p[k]);
        // Avoids most atomic operations: nearly all nodes are inside the bounds found so far.
        if x < atomicLoad(&grid[k]) {
            atomicMin(&grid[k], x);
        }
        if x > atomicLoad(&grid[3u + k]) {
            atomicMax(&grid[3u + k], x);
        }
    }
}
