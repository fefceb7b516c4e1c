// Coarse shadow grid: cubic cells over the bounds of the deformed body. Its buffer holds the
// bounds, encoded by `order_preserving_bits`, and the extinction splatted into each cell. CPU
// reference: `render::shadows::Grid`.

// Words of the buffer before the cells: the minimum and maximum of x, y and z.
const BOUNDS: u32 = 6u;
// Fixed-point value of a cell filled with the largest extinction.
const EXTINCTION_SCALE: f32 = 65536.0;
// Tolerance that prevents an extra cell due to rounding.
const CELL_EPSILON: f32 = 1e-3;
// Minimum extent along an axis, relative to the largest.
const MIN_EXTENT_RATIO: f32 = 0.015625;

struct Grid {
    low: vec3<f32>,
    // Cell size.
    cell: f32,
    dims: vec3<u32>,
}

// Maps floats to integers with the same order.
fn order_preserving_bits(x: f32) -> u32 {
    let bits = bitcast<u32>(x);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

fn bits_to_float(bits: u32) -> f32 {
    return bitcast<f32>(select(~bits, bits & 0x7fffffffu, (bits & 0x80000000u) != 0u));
}

// Returns a grid over these bounds with at most `cells` cells.
fn grid_over(low: vec3<f32>, high: vec3<f32>, cells: u32) -> Grid {
    let largest = max(max(high.x - low.x, high.y - low.y), max(high.z - low.z, 1e-6));
    let extent = max(high - low, vec3(MIN_EXTENT_RATIO * largest));
    var cell = pow(extent.x * extent.y * extent.z / f32(cells), 1.0 / 3.0);
    var dims = vec3<u32>(ceil(extent / cell - CELL_EPSILON));
    for (var i = 0; i < 64 && dims.x * dims.y * dims.z > cells; i++) {
        cell *= 1.05;
        dims = vec3<u32>(ceil(extent / cell - CELL_EPSILON));
    }
    return Grid(low, cell, dims);
}

// Returns the buffer word of the cell at a position in cells from `low`; 0 if outside.
fn cell_at(grid: Grid, place: vec3<f32>) -> u32 {
    let k = vec3<i32>(floor(place));
    if any(k < vec3(0)) || any(k >= vec3<i32>(grid.dims)) {
        return 0u;
    }
    let u = vec3<u32>(k);
    return BOUNDS + u.x + grid.dims.x * (u.y + grid.dims.y * u.z);
}
