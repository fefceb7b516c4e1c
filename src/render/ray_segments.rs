//! Ray segments in the pieces of a partitioned body, composited when all pieces are available.
//!
//! Compositing is associative: the colour and opacity of a ray segment do not depend on what is in
//! front of or behind it, so the segments of the pieces, sorted by depth, give the image of the
//! whole body. Touching segments are merged, so the data exchanged between machines depend on the
//! number of layers of the body, not on the number of pieces.

use super::{AbsoluteTransferFunction, Image, Ray, ReferenceRaycaster};
use crate::{Error, Result};

/// Maximum gap between the end of one segment and the start of the next for merging, in local
/// units: above the rounding error of f32 depths and below any visible thickness.
const MERGE_DISTANCE: f32 = 4e-6;
/// The same in float64, relative to the larger distance.
const TOUCHING_EXACTLY: f64 = 1e-9;

/// Segment of a ray in a piece.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RaySegment {
    /// Pixel index: column + width · row, from the upper left.
    pub pixel: u32,
    /// Depth along the view at the start and end, relative to the centre of the whole body and in
    /// units of its extent.
    pub depths: [f32; 2],
    /// Premultiplied colour, and opacity.
    pub rgba: [f32; 4],
}

/// Ray segments of an image, sorted by pixel and then front to back.
#[derive(Clone, Debug, PartialEq)]
pub struct RaySegments {
    size: [u32; 2],
    items: Vec<RaySegment>,
}

/// Composites `front` over `back`.
fn over(front: [f32; 4], back: [f32; 4]) -> [f32; 4] {
    let clear = 1.0 - front[3];
    std::array::from_fn(|k| front[k] + clear * back[k])
}

fn order(a: &RaySegment, b: &RaySegment) -> std::cmp::Ordering {
    let by_pixel = a.pixel.cmp(&b.pixel);
    let by_front = by_pixel.then(a.depths[0].total_cmp(&b.depths[0]));
    by_front.then(a.depths[1].total_cmp(&b.depths[1]))
}

impl RaySegments {
    /// Creates the segments of an image of `size` pixels from `items` in any order.
    ///
    /// # Errors
    /// [`Error::Input`] for a pixel outside the image.
    pub fn new(size: [u32; 2], mut items: Vec<RaySegment>) -> Result<RaySegments> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        if let Some(bad) = items.iter().find(|i| u64::from(i.pixel) >= pixels) {
            return Err(Error::Input(format!(
                "ray segment at pixel {} is outside the image of {} x {} pixels",
                bad.pixel, size[0], size[1]
            )));
        }
        items.sort_unstable_by(order);
        Ok(RaySegments { size, items })
    }

    /// Returns width and height of the image, in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns the segments.
    pub fn items(&self) -> &[RaySegment] {
        &self.items
    }

    /// Merges the segments of two pieces, sorted by depth; touching segments are joined. Linear in
    /// the number of segments.
    ///
    /// # Errors
    /// [`Error::Input`] if the image sizes differ.
    pub fn merged(&self, other: &RaySegments) -> Result<RaySegments> {
        if self.size != other.size {
            return Err(Error::Input(format!(
                "image sizes of the pieces differ: {} x {} and {} x {} pixels; render all pieces at the same size",
                self.size[0], self.size[1], other.size[0], other.size[1]
            )));
        }
        let mut items: Vec<RaySegment> = Vec::with_capacity(self.items.len() + other.items.len());
        let (mut ours, mut theirs) = (self.items.iter().peekable(), other.items.iter().peekable());
        loop {
            let next = match (ours.peek(), theirs.peek()) {
                (Some(a), Some(b)) if order(a, b).is_gt() => theirs.next(),
                (Some(_), _) => ours.next(),
                (None, _) => theirs.next(),
            };
            let Some(next) = next else { break };
            match items.last_mut() {
                Some(last)
                    if last.pixel == next.pixel
                        && (next.depths[0] - last.depths[1]).abs() <= MERGE_DISTANCE =>
                {
                    last.rgba = over(last.rgba, next.rgba);
                    last.depths[1] = last.depths[1].max(next.depths[1]);
                }
                _ => items.push(*next),
            }
        }
        // Joining may have removed many segments.
        items.shrink_to_fit();
        Ok(RaySegments {
            size: self.size,
            items,
        })
    }

    /// Returns the composited image, once all pieces are merged.
    pub fn image(&self) -> Image {
        let pixels = self.size[0] as usize * self.size[1] as usize;
        let mut values = vec![0.0; 4 * pixels];
        for ray in self.items.chunk_by(|a, b| a.pixel == b.pixel) {
            let sum = ray.iter().fold([0.0; 4], |sum, i| over(sum, i.rgba));
            let first = 4 * ray[0].pixel as usize;
            values[first..first + 4].copy_from_slice(&sum);
        }
        Image {
            size: self.size,
            channels: 4,
            values,
        }
    }

    /// Serialises the segments, 28 bytes each, for [`RaySegments::from_bytes`] on another machine.
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = [MAGIC, self.size[0], self.size[1]];
        let mut words: Vec<u8> = head.iter().flat_map(|n| n.to_le_bytes()).collect();
        words.reserve(size_of::<RaySegment>() * self.items.len());
        for item in &self.items {
            let floats = item.depths.iter().chain(&item.rgba);
            words.extend(item.pixel.to_le_bytes());
            words.extend(floats.flat_map(|x| x.to_le_bytes()));
        }
        words
    }

    /// Reads the output of [`RaySegments::to_bytes`].
    ///
    /// # Errors
    /// [`Error::Input`] for invalid data.
    pub fn from_bytes(bytes: &[u8]) -> Result<RaySegments> {
        let wrong =
            || Error::Input("invalid data: expected serialised ray segments of a piece".into());
        let (words, rest) = bytes.as_chunks::<4>();
        let [magic, width, height, items @ ..] = words else {
            return Err(wrong());
        };
        let (items, more) = items.as_chunks::<{ size_of::<RaySegment>() / 4 }>();
        if u32::from_le_bytes(*magic) != MAGIC || !(rest.is_empty() && more.is_empty()) {
            return Err(wrong());
        }
        let item = |words: &[[u8; 4]; 7]| {
            let [front, back, seen @ ..] =
                std::array::from_fn::<f32, 6, _>(|k| f32::from_le_bytes(words[k + 1]));
            RaySegment {
                pixel: u32::from_le_bytes(words[0]),
                depths: [front, back],
                rgba: seen,
            }
        };
        let size = [*width, *height].map(u32::from_le_bytes);
        RaySegments::new(size, items.iter().map(item).collect())
    }
}

/// Magic number of serialised segments.
const MAGIC: u32 = u32::from_le_bytes(*b"PLI1");

/// Ray segment in float64: distances along the ray of its ends; premultiplied colour, and opacity.
pub type ReferenceSegment = ([f64; 2], [f64; 4]);

impl ReferenceRaycaster {
    /// Returns the segments of `ray` in the mesh, front to back: float64 reference of
    /// [`Raycaster::intervals`](super::Raycaster::intervals).
    pub fn intervals(
        &self,
        ray: Ray,
        transfer: &AbsoluteTransferFunction,
    ) -> Vec<ReferenceSegment> {
        let mut found: Vec<ReferenceSegment> = Vec::new();
        for segment in self.segments(ray) {
            let [enter, leave] = segment.t;
            let integral = transfer.segment_integral(segment.s[0], segment.s[1], leave - enter);
            match found.last_mut() {
                Some((t, sum)) if enter - t[1] <= TOUCHING_EXACTLY * t[1] => {
                    *sum = over_exactly(*sum, integral);
                    t[1] = t[1].max(leave);
                }
                _ => found.push((segment.t, integral)),
            }
        }
        found
    }
}

fn over_exactly(front: [f64; 4], back: [f64; 4]) -> [f64; 4] {
    std::array::from_fn(|k| front[k] + (1.0 - front[3]) * back[k])
}

impl ReferenceRaycaster {
    /// Composites the segments of one ray, given in any order, by depth in float64.
    pub fn composite_intervals(stretches: &[ReferenceSegment]) -> [f64; 4] {
        let mut ordered = stretches.to_vec();
        ordered.sort_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]));
        let seen = ordered.iter().map(|(_, seen)| *seen);
        seen.fold([0.0; 4], over_exactly)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn item(pixel: u32, front: f32, back: f32, seen: [f32; 4]) -> RaySegment {
        RaySegment {
            pixel,
            depths: [front, back],
            rgba: seen,
        }
    }

    const RED: [f32; 4] = [0.5, 0.0, 0.0, 0.5];
    const GREEN: [f32; 4] = [0.0, 0.5, 0.0, 0.5];

    #[test]
    fn merge_order_does_not_change_depth_order() {
        let near = RaySegments::new([2, 1], vec![item(1, 0.0, 0.1, RED)]).unwrap();
        let far = RaySegments::new([2, 1], vec![item(1, 0.4, 0.5, GREEN)]).unwrap();
        let expected = [0.0, 0.0, 0.0, 0.0, 0.5, 0.25, 0.0, 0.75];
        for (a, b) in [(&near, &far), (&far, &near)] {
            let both = a.merged(b).unwrap();
            assert_eq!(both.items().len(), 2);
            assert_eq!(both.image().values, expected);
        }
        let larger = RaySegments::new([2, 2], Vec::new()).unwrap();
        let error = near.merged(&larger).unwrap_err().to_string();
        assert!(
            error.contains("2 x 1") && error.contains("2 x 2"),
            "{error}"
        );
        assert!(RaySegments::new([2, 1], vec![item(2, 0.0, 0.1, RED)]).is_err());
    }

    #[test]
    fn touching_segments_are_joined_after_merge() {
        let ends = RaySegments::new([1, 1], vec![item(0, 0.0, 0.1, RED), item(0, 0.2, 0.3, RED)]);
        let middle = RaySegments::new([1, 1], vec![item(0, 0.1, 0.2, GREEN)]).unwrap();
        let ends = ends.unwrap();
        let whole = ends.merged(&middle).unwrap();
        assert_eq!(whole.items().len(), 1);
        assert_eq!(whole.items()[0].depths, [0.0, 0.3]);
        assert_eq!(whole.image().values, [0.625, 0.25, 0.0, 0.875]);
    }

    #[test]
    fn ray_segments_round_trip_and_reject_invalid_bytes() {
        let one = RaySegments::new(
            [3, 2],
            vec![item(5, 0.25, 0.5, RED), item(0, 0.0, 1.0, GREEN)],
        );
        let one = one.unwrap();
        let bytes = one.to_bytes();
        assert_eq!(bytes.len(), 12 + 2 * 28);
        assert_eq!(RaySegments::from_bytes(&bytes).unwrap(), one);
        for cut in [0, 5, 11, 13, bytes.len() - 1] {
            assert!(RaySegments::from_bytes(&bytes[..cut]).is_err(), "{cut}");
        }
        // A smaller number of segments is valid; a pixel outside the image is not.
        let mut beyond = bytes.clone();
        beyond[12..16].copy_from_slice(&7u32.to_le_bytes());
        assert!(RaySegments::from_bytes(&beyond).is_err());
    }
}
