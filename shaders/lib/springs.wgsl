// The springs of a node: sliced rows of directed edges. The twin of `physics::rows`.
//
// Needs the globals `rows` (of row t: its node, the first texel of its slice, its texels) and
// `columns` (four neighbours a texel). A row is filled up with its node, on springs without
// stiffness.

#import lib/array

// Rows in a slice.
const LANES: u32 = 32u;

// Where the q-th four neighbours of row t lie, in the slice that begins at `base`.
fn column_texel(base: u32, t: u32, q: u32) -> vec2<u32> {
    return at(base + q * LANES + (t & (LANES - 1u)));
}

// Where the data of the row's spring number e lies.
fn spring_texel(base: u32, t: u32, e: u32) -> vec2<u32> {
    return at(base * 4u + e * LANES + (t & (LANES - 1u)));
}

// The unit vector along d, whose length is l; zero for coincident nodes.
fn along(d: vec3<f32>, l: f32) -> vec3<f32> {
    return d * select(0.0, 1.0 / l, l > 0.0);
}
