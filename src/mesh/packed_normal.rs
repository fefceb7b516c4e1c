//! Unit vectors packed into 32 bits, the storage format of node normals on the GPU.

use glam::{DVec2, DVec3};

/// Value of a packed normal for a node without normal.
pub const NO_NORMAL: u32 = u32::MAX;

/// Packs the direction of `n`: octahedral coordinates of 16 bits each, x in the lower half. The
/// error is at most 7·10⁻⁵ rad; [`NO_NORMAL`] for the zero vector and for NaN. Reference
/// implementation of `shaders/lib/normals.wgsl`.
pub fn pack_normal(n: DVec3) -> u32 {
    let size = n.abs().element_sum();
    if !(size > 0.0 && size.is_finite()) {
        return NO_NORMAL;
    }
    let p = n.truncate() / size;
    let q = if n.z >= 0.0 { p } else { folded(p) };
    let bits = ((0.5 * q + 0.5) * 65534.0 + 0.5).floor().as_uvec2();
    bits.x | bits.y << 16
}

/// Unpacks the unit vector in `packed`; `None` for [`NO_NORMAL`].
pub fn unpack_normal(packed: u32) -> Option<DVec3> {
    if packed == NO_NORMAL {
        return None;
    }
    let p = DVec2::new(f64::from(packed & 0xffff), f64::from(packed >> 16)) / 32767.0 - 1.0;
    let z = 1.0 - p.abs().element_sum();
    let q = if z >= 0.0 { p } else { folded(p) };
    Some(q.extend(z).normalize())
}

/// Folds the lower half of the octahedron over the corners of the square.
fn folded(p: DVec2) -> DVec2 {
    let sign = |x: f64| if x >= 0.0 { 1.0 } else { -1.0 };
    DVec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_normals_round_trip() {
        let mut worst = 0.0f64;
        for i in 0..20_000u32 {
            let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 20_000.0;
            let turn = f64::from(i) * 2.399_963;
            let r = (1.0 - z * z).sqrt();
            let n = DVec3::new(r * turn.cos(), r * turn.sin(), z);
            let found = unpack_normal(pack_normal(3.0 * n));
            worst = worst.max(found.map_or(9.0, |f| f.distance(n)));
        }
        assert!(worst < 7e-5 && worst > 1e-6, "{worst}");
        for axis in DVec3::AXES {
            assert!(unpack_normal(pack_normal(-axis)).is_some_and(|n| n.distance(-axis) < 1e-9));
        }
        assert_eq!(pack_normal(DVec3::ZERO), NO_NORMAL);
        assert_eq!(pack_normal(DVec3::NAN), NO_NORMAL);
        assert_eq!(unpack_normal(NO_NORMAL), None);
    }
}
