//! Memory on the device, in bytes a tet.

use super::{Case, Row};
use crate::generate;
use crate::study::scaling::{DEVICE_PARTS, part_bytes};

pub(super) const ABOUT: &str = "Arrays of the benchmark cube on the device, without the driver's \
    overhead, which the notes give.";

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let sizes: &[usize] = match quick {
        true => &[10_000],
        false => &[100_000, 1_000_000],
    };
    let mut all = Vec::new();
    for &tets in sizes {
        for part in DEVICE_PARTS {
            let row = Row::new(part, "gpu", "bytes a tet").size(tets, "tets");
            all.push(Case::new(row, move |context, row| {
                let cells = (tets as f64 / 6.0).cbrt().round() as usize;
                let mesh = generate::benchmark_cube(cells, false)?;
                let (made, given) = part_bytes(context.gpu, part, &mesh)?;
                let count = mesh.tets.len();
                let row = row.size(count, "tets").value(made / count as f64);
                Ok(match given.is_finite() {
                    true => row.note(format!("{:.1} taken by the driver", given / count as f64)),
                    false => row,
                })
            }));
        }
    }
    all
}
