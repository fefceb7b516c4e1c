//! Milliseconds a frame of a scan in a bent body.

use super::raycast::frames;
use super::{Case, Context, Row};
use crate::Result;
use crate::generate;
use crate::render::{Light, RaycastOptions};
use crate::study::scan::{BALL, ScanRepresentation, Subject};
use std::cell::RefCell;
use std::rc::Rc;

pub(super) const ABOUT: &str = "A bent ball with a CT-like phantom, as in `palpate study scan`: the \
    scan carried by the cells of a cage, sampled at its own resolution, without and with a light at \
    the eye; and its values at the nodes of a finer mesh.";

/// Voxels and pixels along a side, cells across the cages and across the mesh of nodal values.
struct Sizes {
    voxels: usize,
    pixels: usize,
    cages: &'static [usize],
    nodal: &'static [usize],
}

const FULL: Sizes = Sizes {
    voxels: 224,
    pixels: 320,
    cages: &[8, 12, 20],
    nodal: &[26, 55],
};
const QUICK: Sizes = Sizes {
    voxels: 96,
    pixels: 160,
    cages: &[10],
    nodal: &[16],
};

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let sizes = if quick { QUICK } else { FULL };
    let subject = Rc::new(RefCell::new(None));
    let in_cages = sizes.cages.iter().flat_map(|cells| {
        [Light::None, Light::Head].map(|light| (*cells, ScanRepresentation::Scan, light))
    });
    let at_nodes = sizes.nodal.iter();
    let at_nodes = at_nodes.map(|cells| (*cells, ScanRepresentation::Samples, Light::None));
    let case = |(cells, representation, light)| {
        let name = match (representation, light) {
            (ScanRepresentation::Scan, Light::None) => "cage",
            (ScanRepresentation::Scan, _) => "cage, lit",
            _ => "values at nodes",
        };
        let what = format!(
            "{name}, {}³ voxels, {} pixels a side",
            sizes.voxels, sizes.pixels
        );
        let row = Row::new(what, "gpu", "ms");
        let subject = Rc::clone(&subject);
        Case::new(row, move |context, row| {
            let mut kept = subject.borrow_mut();
            let made = match kept.take() {
                Some(made) => made,
                None => Subject::new(sizes.voxels, sizes.pixels)?,
            };
            frame(
                context,
                row,
                kept.insert(made),
                (cells, representation, light),
            )
        })
    };
    in_cages.chain(at_nodes).map(case).collect()
}

fn frame(
    context: &Context,
    row: Row,
    subject: &Subject,
    (cells, representation, light): (usize, ScanRepresentation, Light),
) -> Result<Row> {
    let mesh = generate::ball(BALL, cells)?;
    let options = RaycastOptions {
        light,
        ..Default::default()
    };
    let (mut caster, notes) = subject.raycaster(context.gpu, &mesh, representation, options)?;
    let spread = frames(context, &mut caster, subject.camera, subject.size)?;
    let row = row.size(mesh.tets.len(), "tets").spread(spread);
    Ok(row.note(notes.join("; ")))
}
