// Computes the fraction of light that reaches each node by marching through the shadow grid; it is
// stored with the gradient.

#import lib/array
#import lib/shadow_grid

struct March {
    nodes: u32,
    cells: u32,
    // Number of directions, and of steps of one cell along each.
    directions: u32,
    steps: u32,
    // Largest extinction per local unit, times log2(e).
    opacity: f32,
    // Normalisation of the light from an open sky.
    normalisation: f32,
    // Strength of full shadow.
    strength: f32,
    // Offset from surfaces in cells, for gradients of at least the half-saturation magnitude.
    surface_offset: f32,
    gradient_half_saturation: f32,
}

@group(0) @binding(0) var positions: texture_2d<f32>;
@group(0) @binding(1) var gradients: texture_2d<f32>;
@group(0) @binding(2) var ways: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> grid: array<u32>;
@group(0) @binding(4) var lit: texture_storage_2d<rgba32float, write>;
@group(0) @binding(5) var<uniform> params: March;

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = invocation_index(id, groups);
    if i >= params.nodes {
        return;
    }
    let low = vec3(bits_to_float(grid[0]), bits_to_float(grid[1]), bits_to_float(grid[2]));
    let high = vec3(bits_to_float(grid[3]), bits_to_float(grid[4]), bits_to_float(grid[5]));
    let through = grid_over(low, high, params.cells);
    let gradient = textureLoad(gradients, array_texel(i), 0).xyz;
    // Offset out of the node's own surface, which prevents self-shadowing.
    let out = params.surface_offset * gradient / max(length(gradient), params.gradient_half_saturation);
    let start = (textureLoad(positions, array_texel(i), 0).xyz - through.low) / through.cell - out;
    let depth_a_step = params.opacity * through.cell / EXTINCTION_SCALE;
    var light = 0.0;
    for (var k = 0u; k < params.directions; k++) {
        let way = textureLoad(ways, array_texel(k), 0).xyz;
        var passed = 0.0;
        // Skips the starting cell.
        for (var step = 1u; step <= params.steps; step++) {
            let word = cell_at(through, start + f32(step) * way);
            if word == 0u {
                break;
            }
            passed += f32(grid[word]);
        }
        light += exp2(-passed * depth_a_step);
    }
    let share = min(params.normalisation * light / f32(params.directions), 1.0);
    textureStore(lit, array_texel(i), vec4(gradient, 1.0 - params.strength * (1.0 - share)));
}
