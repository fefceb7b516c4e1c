// Unit vectors packed in 32 bits: octahedral encoding, 16 bits per coordinate. Matches
// `mesh::pack_normal`.

// No normal: the contributions cancel, or there are none.
const NO_NORMAL: u32 = 0xffffffffu;

fn sign_not_zero(v: vec2<f32>) -> vec2<f32> {
    return select(vec2(-1.0), vec2(1.0), v >= vec2(0.0));
}

fn pack_normal(n: vec3<f32>) -> u32 {
    let size = abs(n.x) + abs(n.y) + abs(n.z);
    if !(size > 0.0) {
        return NO_NORMAL;
    }
    let p = n.xy / size;
    let folded = (vec2(1.0) - abs(p.yx)) * sign_not_zero(p);
    let q = select(folded, p, n.z >= 0.0);
    let bits = vec2<u32>(floor((q * 0.5 + 0.5) * 65534.0 + 0.5));
    return bits.x | (bits.y << 16u);
}

// Unpacks a normal; undefined for NO_NORMAL.
fn unpack_normal(packed: u32) -> vec3<f32> {
    let p = vec2(f32(packed & 0xffffu), f32(packed >> 16u)) / 32767.0 - 1.0;
    let z = 1.0 - abs(p.x) - abs(p.y);
    let folded = (vec2(1.0) - abs(p.yx)) * sign_not_zero(p);
    return normalize(vec3(select(folded, p, z >= 0.0), z));
}
