//! Surfaces of skins and tools in light paths, and the tree of boxes with which a path finds them
//! (`shaders/lib/path_walls.wgsl`).

use crate::gpu::{Array, Gpu, Texel};
use crate::{Error, Result};
use glam::Vec3;

/// Triangles per leaf; as in `lib/path_boxes`.
const LEAF_TRIANGLES: usize = 4;
/// Bits of a Morton code along each axis.
const MORTON_BITS: u32 = 10;

/// A triangle of a skin or a tool, in the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wall {
    pub corners: [Vec3; 3],
    pub normals: [Vec3; 3],
    /// Colours of the corners, in linear light.
    pub colours: [Vec3; 3],
    /// Probability that a path meets it.
    pub opacity: f32,
}

/// The tree on the device.
pub(super) struct Walls {
    pub items: Array,
    pub count: u32,
    pub leaves: u32,
}

impl Walls {
    /// Sorts the triangles along a Morton curve, and builds the boxes.
    pub fn new(gpu: &Gpu, walls: &[Wall]) -> Result<Walls> {
        if walls.iter().flat_map(|w| w.corners).any(|p| !p.is_finite()) {
            return Err(Error::Input(
                "a skin or tool has vertices that are not finite; light paths need finite surfaces"
                    .into(),
            ));
        }
        let items = items(walls);
        Ok(Walls {
            items: gpu.array_of("surfaces for paths", Texel::F32x4, &items)?,
            count: walls.len() as u32,
            leaves: leaves(walls.len()) as u32,
        })
    }
}

fn leaves(count: usize) -> usize {
    count.div_ceil(LEAF_TRIANGLES).max(1).next_power_of_two()
}

/// Returns the items of `lib/path_walls`.
fn items(walls: &[Wall]) -> Vec<[f32; 4]> {
    let centre = |w: &Wall| (w.corners[0] + w.corners[1] + w.corners[2]) / 3.0;
    let centres: Vec<Vec3> = walls.iter().map(centre).collect();
    let low = centres.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = centres.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let extent = (high - low).max(Vec3::splat(f32::MIN_POSITIVE));
    let mut order: Vec<usize> = (0..walls.len()).collect();
    order.sort_by_key(|k| morton((centres[*k] - low) / extent));
    let leaves = leaves(walls.len());
    let mut boxes = vec![[Vec3::splat(1e30), Vec3::splat(-1e30)]; 2 * leaves];
    for (leaf, part) in order.chunks(LEAF_TRIANGLES).enumerate() {
        for p in part.iter().flat_map(|k| walls[*k].corners) {
            let [a, b] = boxes[leaves + leaf];
            boxes[leaves + leaf] = [a.min(p), b.max(p)];
        }
    }
    for i in (1..leaves).rev() {
        let [[a, b], [c, d]] = [boxes[2 * i], boxes[2 * i + 1]];
        boxes[i] = [a.min(c), b.max(d)];
    }
    let mut items: Vec<[f32; 4]> = boxes
        .iter()
        .flat_map(|ends| ends.map(|p| p.extend(0.0).to_array()))
        .collect();
    for wall in order.iter().map(|k| &walls[*k]) {
        items.extend(wall.corners.map(|p| p.extend(wall.opacity).to_array()));
        items.extend(wall.normals.map(|n| n.extend(0.0).to_array()));
        items.extend(wall.colours.map(|c| c.extend(0.0).to_array()));
    }
    items
}

/// Returns the Morton code of a place in the unit cube.
fn morton(share: Vec3) -> u32 {
    let top = ((1u32 << MORTON_BITS) - 1) as f32;
    let cells = (share.clamp(Vec3::ZERO, Vec3::ONE) * top).to_array();
    let mut code = 0;
    for bit in (0..MORTON_BITS).rev() {
        for cell in cells {
            code = 2 * code + (cell as u32 >> bit & 1);
        }
    }
    code
}
