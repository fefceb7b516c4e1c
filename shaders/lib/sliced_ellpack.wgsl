// Sliced ELLPACK rows of the nodes: directed edges, or corners of tets. Host side:
// `physics::gpu::sliced_ellpack`.
//
// Needs the globals `rows` (for row t: its node, the first texel of its slice, its number of
// texels) and `columns` (four entries per texel).

#import lib/array

// Rows per slice.
const SLICE_HEIGHT: u32 = 32u;

// Returns for row t: its node, the first texel of its slice, its number of texels.
fn row_of(t: u32) -> vec3<u32> {
    return textureLoad(rows, array_texel(t), 0).xyz;
}

// Returns the texel of the q-th group of four entries of row t, in the slice that starts at `base`.
fn column_texel(base: u32, t: u32, q: u32) -> vec2<u32> {
    return array_texel(base + q * SLICE_HEIGHT + (t & (SLICE_HEIGHT - 1u)));
}

// Returns the item index of the data of entry e of the row.
fn entry_item(base: u32, t: u32, e: u32) -> u32 {
    return base * 4u + e * SLICE_HEIGHT + (t & (SLICE_HEIGHT - 1u));
}

// Returns the texel of the data of entry e of the row.
fn entry_texel(base: u32, t: u32, e: u32) -> vec2<u32> {
    return array_texel(entry_item(base, t, e));
}
