// Splats the extinction of every tet into the shadow grid, at points distributed uniformly inside
// it. Clipped and hidden parts cast no shadow.

#import lib/array
#import lib/shadow_grid

struct Fill {
    tets: u32,
    cells: u32,
    points: u32,
}

// Whether scalars are constant per tet, and whether each region has its own transfer function.
override CELL_SCALARS: bool = false;
override REGIONS: bool = false;
// As in lib/sections and lib/segment.
const COLOUR_LUT_SIZE: u32 = 1024u;
const HIDDEN: u32 = 0xffffu;
const TRANSPARENT_FLAG: u32 = 0x8000u;
// Maximum number of points per tet.
const MAX_POINTS: u32 = 1024u;

@group(0) @binding(next) var positions: texture_2d<f32>;
@group(0) @binding(next) var scalars: texture_2d<f32>;
@group(0) @binding(next) var tets: texture_2d<u32>;
@group(0) @binding(next) var cells: texture_2d<f32>;
// w: extinction, relative to the largest.
@group(0) @binding(next) var colours: texture_2d<f32>;
@group(0) @binding(next) var rows: texture_2d<u32>;
#import lib/clip
#each scan #import terms/TERM
@group(0) @binding(next) var<storage, read_write> grid: array<atomic<u32>>;
@group(0) @binding(next) var<uniform> params: Fill;

// Returns the barycentric weights of point i: a low-discrepancy sequence in the cube, folded into a
// tet.
fn sample_weights(i: u32) -> vec4<f32> {
    var p = fract(0.5 + f32(i) * vec3(0.8191725, 0.6710436, 0.5497005));
    if p.x + p.y > 1.0 {
        p = vec3(1.0 - p.x, 1.0 - p.y, p.z);
    }
    if p.y + p.z > 1.0 {
        p = vec3(p.x, 1.0 - p.z, 1.0 - p.x - p.y);
    } else if p.x + p.y + p.z > 1.0 {
        p = vec3(1.0 - p.y - p.z, p.y, p.x + p.y + p.z - 1.0);
    }
    return vec4(p, 1.0 - p.x - p.y - p.z);
}

@compute @workgroup_size(WORKGROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let t = invocation_index(id, groups);
    if t >= params.tets {
        return;
    }
    var row = 0u;
    if REGIONS {
        row = textureLoad(rows, array_texel(t), 0).x;
        if (row == HIDDEN) | ((row & TRANSPARENT_FLAG) != 0u) {
            return;
        }
    }
    let low = vec3(bits_to_float(atomicLoad(&grid[0])), bits_to_float(atomicLoad(&grid[1])), bits_to_float(atomicLoad(&grid[2])));
    let high = vec3(bits_to_float(atomicLoad(&grid[3])), bits_to_float(atomicLoad(&grid[4])), bits_to_float(atomicLoad(&grid[5])));
    let over = grid_over(low, high, params.cells);
    let v = textureLoad(tets, array_texel(t), 0);
    var p: array<vec3<f32>, 4>;
    var s: vec4<f32>;
    var rest: array<vec3<f32>, 4>;
    for (var k = 0u; k < 4u; k++) {
        p[k] = textureLoad(positions, array_texel(v[k]), 0).xyz;
        s[k] = textureLoad(scalars, array_texel(v[k]), 0).x;
        if USE_REST_POSITIONS {
            rest[k] = textureLoad(rests, array_texel(v[k]), 0).xyz;
        }
    }
    if CELL_SCALARS {
        s = vec4(textureLoad(cells, array_texel(t), 0).x);
    }
    let volume = abs(dot(p[1] - p[0], cross(p[2] - p[0], p[3] - p[0]))) / 6.0;
    let cells_wide = volume / (over.cell * over.cell * over.cell);
    // The number of points grows with the size of the tet relative to a cell.
    let points = clamp(u32(ceil(min(f32(params.points) * cells_wide, f32(MAX_POINTS)))), params.points, MAX_POINTS);
    let share = EXTINCTION_SCALE * cells_wide / f32(points);
    // Each tet uses a different part of the sequence, which avoids aliasing with the cells.
    let first = ((v.x + v.y + v.z + v.w) & 255u) * params.points;
    for (var i = 0u; i < points; i++) {
        let w = sample_weights(first + i);
        let place = w.x * p[0] + w.y * p[1] + w.z * p[2] + w.w * p[3];
        var resting = vec3(0.0);
        if USE_REST_POSITIONS {
            resting = w.x * rest[0] + w.y * rest[1] + w.z * rest[2] + w.w * rest[3];
        }
        let word = cell_at(over, (place - over.low) / over.cell);
        if word == 0u || is_clipped(place, resting) {
            continue;
        }
        let nearest = u32(clamp(dot(w, s), 0.0, 1.0) * f32(COLOUR_LUT_SIZE - 1u) + 0.5);
        var extinction = textureLoad(colours, array_texel(row * COLOUR_LUT_SIZE + nearest), 0).w;
#any scan         extinction = scans_extinction(resting, row);
        atomicAdd(&grid[word], u32(min(share * extinction, 1e9) + 0.5));
    }
}
