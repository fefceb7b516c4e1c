// Lists of the nodes, in sliced rows: directed edges, or corners of tets. The twin of
// `physics::rows`.
//
// Needs the globals `rows` (of row t: its node, the first texel of its slice, its texels) and
// `columns` (four entries a texel).

#import lib/array

// Rows in a slice.
const SLICE_HEIGHT: u32 = 32u;

// Row t: its node, the first texel of its slice, its texels.
fn row_of(t: u32) -> vec3<u32> {
    return textureLoad(rows, array_texel(t), 0).xyz;
}

// Where the q-th four entries of row t lie, in the slice that begins at `base`.
fn column_texel(base: u32, t: u32, q: u32) -> vec2<u32> {
    return array_texel(base + q * SLICE_HEIGHT + (t & (SLICE_HEIGHT - 1u)));
}

// The item of the data of the row's entry number e.
fn entry_item(base: u32, t: u32, e: u32) -> u32 {
    return base * 4u + e * SLICE_HEIGHT + (t & (SLICE_HEIGHT - 1u));
}

// Where the data of the row's entry number e lies.
fn entry_texel(base: u32, t: u32, e: u32) -> vec2<u32> {
    return array_texel(entry_item(base, t, e));
}
