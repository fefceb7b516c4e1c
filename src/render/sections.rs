//! Section planes and isosurfaces, in float64 and for the GPU; reference of
//! `shaders/lib/sections.wgsl`.

use super::AbsoluteTransferFunction;
use super::ray_integral::{ReferenceRaycaster, Segment};
use super::table::TableRow;
use super::transfer_function::named_colour;
use crate::gpu::{Array, Gpu, Texel};
use crate::mesh::LocalFrame;
use crate::render::Ray;
use crate::{Error, Result};
use glam::DVec3;
use std::str::FromStr;

/// Maximum number of planes of an image, including those of boxes and cut faces.
const MAX_PLANES: usize = 32;
/// Maximum number of isosurfaces of an image: each costs one comparison per tet.
const MAX_ISOSURFACES: usize = 64;
/// Number of colour samples of the transfer function; `lib/sections.wgsl` has the same value.
pub(super) const COLOURS: usize = 1024;

/// Effect of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaneKind {
    /// Clips the half-space that its normal points into.
    Clip,
    /// Shows the scalar on the plane, with this opacity, in the colours of the transfer function.
    Slice(f64),
}

/// A section plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point on the plane, in file coordinates.
    pub point: DVec3,
    /// Direction towards the clipped side, of any length.
    pub normal: DVec3,
    /// Effect of the plane.
    pub kind: PlaneKind,
    /// Whether the plane is fixed to the rest configuration and deforms with the body, or is fixed
    /// in space.
    pub at_rest: bool,
}

impl Plane {
    /// Creates a clip plane in space.
    pub fn clip(point: DVec3, normal: DVec3) -> Plane {
        Plane {
            point,
            normal,
            kind: PlaneKind::Clip,
            at_rest: false,
        }
    }

    /// Creates an opaque slice plane in space.
    pub fn slice(point: DVec3, normal: DVec3) -> Plane {
        Plane {
            kind: PlaneKind::Slice(1.0),
            ..Plane::clip(point, normal)
        }
    }

    /// Returns the plane fixed to the rest configuration.
    pub fn at_rest(self) -> Plane {
        Plane {
            at_rest: true,
            ..self
        }
    }

    /// Returns six planes that clip the outside of a box from `low` to `high`.
    pub fn clip_box(low: DVec3, high: DVec3) -> [Plane; 6] {
        let [x, y, z] = DVec3::AXES;
        [
            Plane::clip(low, -x),
            Plane::clip(low, -y),
            Plane::clip(low, -z),
            Plane::clip(high, x),
            Plane::clip(high, y),
            Plane::clip(high, z),
        ]
    }

    /// Returns the signed distance of a point beyond the plane, in file units.
    fn signed_distance(&self, position: DVec3, rest: DVec3) -> f64 {
        let there = if self.at_rest { rest } else { position };
        self.normal.normalize_or_zero().dot(there - self.point)
    }
}

impl FromStr for Plane {
    type Err = Error;

    /// Parses `x,y,z,nx,ny,nz`, a point and the direction of the clipped side, as a clip plane.
    fn from_str(text: &str) -> Result<Plane> {
        let numbers: Vec<f64> = text
            .split(',')
            .map_while(|t| t.trim().parse().ok())
            .collect();
        let plane = match numbers.as_slice() {
            [x, y, z, a, b, c] if text.split(',').count() == 6 => {
                Plane::clip(DVec3::new(*x, *y, *z), DVec3::new(*a, *b, *c))
            }
            _ => {
                return Err(Error::Input(format!(
                    "invalid plane \"{text}\"; give x,y,z,nx,ny,nz: a point on the plane and its normal"
                )));
            }
        };
        plane.check()?;
        Ok(plane)
    }
}

impl Plane {
    fn check(&self) -> Result<()> {
        let sound = self.point.is_finite()
            && self.normal.is_finite()
            && self.normal.length() > 0.0
            && match self.kind {
                PlaneKind::Clip => true,
                PlaneKind::Slice(opacity) => (0.0..=1.0).contains(&opacity),
            };
        match sound {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "invalid plane through {} with normal {}: both must be finite, the normal not zero, and the opacity of a slice 0 to 1",
                self.point, self.normal
            ))),
        }
    }
}

/// An isosurface of the scalar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Isosurface {
    /// Scalar value.
    pub value: f64,
    /// Colour, components from 0 to 1; `None` uses the colour of the transfer function.
    pub colour: Option<[f64; 3]>,
    /// Opacity, from 0 to 1.
    pub opacity: f64,
}

impl Isosurface {
    fn check(&self) -> Result<()> {
        let unit = |x: &f64| (0.0..=1.0).contains(x);
        let coloured = self.colour.is_none_or(|c| c.iter().all(unit));
        match self.value.is_finite() && coloured && unit(&self.opacity) {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "invalid isosurface at {} with colour {:?} and opacity {}: the value must be finite, colour components and opacity 0 to 1",
                self.value, self.colour, self.opacity
            ))),
        }
    }
}

impl FromStr for Isosurface {
    type Err = Error;

    /// Parses `VALUE[,COLOUR[,OPACITY]]`; the colour is a CSS name or `#RRGGBB`.
    fn from_str(text: &str) -> Result<Isosurface> {
        let wrong = || {
            Error::Input(format!(
                "invalid isosurface \"{text}\"; give VALUE[,COLOUR[,OPACITY]], such as 0.5 or 0.5,tomato,0.6 or 0.5,#d04030"
            ))
        };
        let mut parts = text.split(',').map(str::trim);
        let value = parts.next().and_then(|t| t.parse().ok());
        let colour = match parts.next() {
            None | Some("") => None,
            Some(name) => Some(named_colour(name).map_err(|_| wrong())?),
        };
        let opacity = match parts.next() {
            None => Some(1.0),
            Some(text) => text.parse().ok(),
        };
        let (Some(value), Some(opacity), None) = (value, opacity, parts.next()) else {
            return Err(wrong());
        };
        let found = Isosurface {
            value,
            colour,
            opacity,
        };
        found.check()?;
        Ok(found)
    }
}

/// Section planes and isosurfaces of a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Sections {
    /// Planes, at most 32.
    pub planes: Vec<Plane>,
    /// Isosurfaces, at most 64.
    pub isosurfaces: Vec<Isosurface>,
    /// Whether the volume itself is drawn.
    pub draw_volume: bool,
}

impl Default for Sections {
    fn default() -> Sections {
        Sections {
            planes: Vec::new(),
            isosurfaces: Vec::new(),
            draw_volume: true,
        }
    }
}

/// A surface hit in a segment, with its position from 0 at the front to 1.
#[derive(Clone, Copy, Debug)]
enum SurfaceHit {
    Slice(f64),
    Iso(Isosurface),
}

impl Sections {
    /// Whether only the volume is drawn.
    pub fn is_empty(&self) -> bool {
        self.planes.is_empty() && self.isosurfaces.is_empty() && self.draw_volume
    }

    /// Whether any plane is fixed to the rest configuration.
    pub fn needs_rest_positions(&self) -> bool {
        self.planes.iter().any(|p| p.at_rest)
    }

    /// Whether there are slices or isosurfaces.
    pub fn has_surfaces(&self) -> bool {
        !self.isosurfaces.is_empty() || self.slices().next().is_some()
    }

    /// Returns the clip planes.
    pub fn clips(&self) -> impl Iterator<Item = &Plane> {
        self.planes.iter().filter(|p| p.kind == PlaneKind::Clip)
    }

    /// Returns the slice planes and their opacities.
    fn slices(&self) -> impl Iterator<Item = (&Plane, f64)> {
        self.planes.iter().filter_map(|p| match p.kind {
            PlaneKind::Clip => None,
            PlaneKind::Slice(opacity) => Some((p, opacity)),
        })
    }

    /// Returns the sections of a lit boundary: each clip plane is also a slice, which is its cut face,
    /// and the volume is not drawn.
    pub(crate) fn with_cut_faces(mut self) -> Sections {
        let clips: Vec<Plane> = self.clips().copied().collect();
        for clip in clips {
            let face = Plane {
                kind: PlaneKind::Slice(1.0),
                ..clip
            };
            if !self.planes.contains(&face) {
                self.planes.push(face);
            }
        }
        self.draw_volume = false;
        self
    }

    /// Validates the parameters.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid numbers, or too many planes or isosurfaces.
    pub fn check(&self) -> Result<()> {
        if self.planes.len() > MAX_PLANES || self.isosurfaces.len() > MAX_ISOSURFACES {
            return Err(Error::Input(format!(
                "an image can have at most {MAX_PLANES} planes and {MAX_ISOSURFACES} isosurfaces, got {} and {}",
                self.planes.len(),
                self.isosurfaces.len()
            )));
        }
        self.planes.iter().try_for_each(Plane::check)?;
        self.isosurfaces.iter().try_for_each(Isosurface::check)
    }

    /// Whether a point, with rest position `rest`, is clipped.
    pub(super) fn is_clipped(&self, position: DVec3, rest: DVec3) -> bool {
        self.clips()
            .any(|plane| plane.signed_distance(position, rest) > 0.0)
    }

    /// Returns the numbers of clip planes, slices and isosurfaces.
    pub(super) fn counts(&self) -> [usize; 3] {
        let clips = self.clips().count();
        [clips, self.planes.len() - clips, self.isosurfaces.len()]
    }

    /// Uploads the sections in the layout of `lib/sections.wgsl`, in `frame`; `coordinate` maps a
    /// scalar to its table coordinate.
    pub(super) fn to_gpu(
        &self,
        gpu: &Gpu,
        frame: LocalFrame,
        coordinate: impl Fn(f64) -> f64,
    ) -> Result<Array> {
        let mut items: Vec<[f32; 4]> = Vec::new();
        let slices = self.slices();
        for (plane, opacity) in self.clips().map(|p| (p, 1.0)).chain(slices) {
            let normal = plane.normal.normalize_or_zero();
            let off = normal.dot(plane.point - frame.origin) / frame.scale;
            items.push(normal.as_vec3().extend(off as f32).to_array());
            let at_rest = f32::from(u8::from(plane.at_rest));
            items.push([at_rest, opacity as f32, 0.0, 0.0]);
        }
        for iso in &self.isosurfaces {
            let has_colour = f32::from(u8::from(iso.colour.is_some()));
            items.push([
                coordinate(iso.value) as f32,
                iso.opacity as f32,
                has_colour,
                0.0,
            ]);
            let [r, g, b] = iso.colour.unwrap_or_default();
            items.push([r, g, b, 0.0].map(|x| x as f32));
        }
        if items.is_empty() {
            items.push([0.0; 4]);
        }
        gpu.array_of("planes and isosurfaces", Texel::F32x4, &items)
    }

    /// Returns the unclipped part of a segment, from 0 at its front to 1; `ends` are the positions
    /// of its ends in space and at rest.
    fn unclipped_range(&self, ends: [[DVec3; 2]; 2]) -> Option<[f64; 2]> {
        let mut range = [0.0f64, 1.0];
        for plane in self.clips() {
            let [front, back] = ends.map(|[position, rest]| plane.signed_distance(position, rest));
            match (front > 0.0, back > 0.0) {
                (true, true) => return None,
                (true, false) => range[0] = range[0].max(front / (front - back)),
                (false, true) => range[1] = range[1].min(front / (front - back)),
                (false, false) => {}
            }
        }
        (range[0] < range[1]).then_some(range)
    }

    /// Returns the surfaces in a part of a segment, front to back.
    fn surface_hits(
        &self,
        s: [f64; 2],
        ends: [[DVec3; 2]; 2],
        within: [f64; 2],
    ) -> Vec<(f64, SurfaceHit)> {
        let mut found = Vec::new();
        let mut push_if_crossed = |[front, back]: [f64; 2], surface: SurfaceHit| {
            if (front < 0.0) != (back < 0.0) {
                let u = front / (front - back);
                if (within[0]..=within[1]).contains(&u) {
                    found.push((u, surface));
                }
            }
        };
        for (plane, opacity) in self.slices() {
            let distances = ends.map(|[position, rest]| plane.signed_distance(position, rest));
            push_if_crossed(distances, SurfaceHit::Slice(opacity));
        }
        for iso in &self.isosurfaces {
            push_if_crossed(s.map(|s| s - iso.value), SurfaceHit::Iso(*iso));
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found
    }
}

/// Lighting of a float64 image at a point of a tet, for the volume as in
/// [`ReferenceRaycaster::composite_lit`], and for surfaces.
pub struct Lighting<'a> {
    /// Factor on volume colours, and the term added in proportion to opacity.
    pub volume: &'a dyn Fn(u32, DVec3, DVec3) -> [f64; 2],
    /// The same for a surface perpendicular to the gradient.
    pub surface: &'a dyn Fn(u32, DVec3, DVec3) -> [f64; 2],
}

impl ReferenceRaycaster {
    /// Returns emission and absorption along `ray` with planes and isosurfaces: premultiplied
    /// colour and opacity. `transfer` returns the transfer function of a tet, `None` if the tet is
    /// hidden; `rest` maps a tet and barycentric coordinates to the rest position.
    pub fn composite_sections<'a>(
        &self,
        ray: Ray,
        transfer: &dyn Fn(u32) -> Option<&'a AbsoluteTransferFunction>,
        inside: &Sections,
        rest: &dyn Fn(u32, [f64; 4]) -> DVec3,
        light: Option<&Lighting>,
    ) -> [f64; 4] {
        let way = ray.direction.normalize_or_zero();
        let position = |t: f64| ray.origin + ray.direction * t;
        let mut sum = [0.0; 4];
        let mut add = |colour: [f64; 3], alpha: f64| {
            let clear = 1.0 - sum[3];
            for k in 0..3 {
                sum[k] += clear * colour[k].min(alpha);
            }
            sum[3] += clear * alpha;
        };
        for Segment { t, s, tet } in self.segments(ray) {
            let Some(transfer) = transfer(tet) else {
                continue;
            };
            let ends = t.map(|t| {
                let p = position(t);
                [p, rest(tet, self.barycentric_weights(tet, p))]
            });
            let Some(range) = inside.unclipped_range(ends) else {
                continue;
            };
            let at = |u: f64, pair: [f64; 2]| pair[0] + u * (pair[1] - pair[0]);
            let volume = |from: f64, to: f64, add: &mut dyn FnMut([f64; 3], f64)| {
                if !inside.draw_volume || to <= from {
                    return;
                }
                let length = at(to, t) - at(from, t);
                let [r, g, b, a] = transfer.segment_integral(at(from, s), at(to, s), length);
                let middle = position(at(0.5 * (from + to), t));
                let [factor, shine] = light.map_or([1.0, 0.0], |l| (l.volume)(tet, middle, way));
                add([r, g, b].map(|c| factor * c + shine * a), a);
            };
            let mut from = range[0];
            for (u, surface) in inside.surface_hits(s, ends, range) {
                volume(from, u, &mut add);
                from = u;
                let (colour, opacity) = match surface {
                    SurfaceHit::Slice(opacity) => (transfer.colour(at(u, s)), opacity),
                    SurfaceHit::Iso(iso) => {
                        let colour = iso.colour.unwrap_or_else(|| transfer.colour(iso.value));
                        let [factor, shine] =
                            light.map_or([1.0, 0.0], |l| (l.surface)(tet, position(at(u, t)), way));
                        (colour.map(|c| (factor * c + shine).min(1.0)), iso.opacity)
                    }
                };
                add(colour.map(|c| c * opacity), opacity);
            }
            volume(from, range[1], &mut add);
        }
        sum
    }
}

/// Samples the colours of a table row over its scalar range in the layout of `lib/sections.wgsl`; w
/// is the extinction.
pub(super) fn colours(row: &TableRow) -> Vec<[f64; 4]> {
    let TableRow {
        transfer,
        range: (low, high),
        ..
    } = row;
    let colour = |k: usize| {
        let share = k as f64 / (COLOURS - 1) as f64;
        let s = low + share * (high - low);
        let [r, g, b] = transfer.colour(s);
        [r, g, b, transfer.extinction(s)]
    };
    (0..COLOURS).map(colour).collect()
}
