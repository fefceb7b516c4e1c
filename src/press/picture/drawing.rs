//! Composes the picture of a press from plain data: the cut body, the finger, the outline at rest and
//! the inset of the whole body.

use super::super::finger::Finger;
use super::body::{Body, Cut, Isolines};
use super::finger::draw_finger;
use super::overlay::Pen;
use super::raster::{Kind, Raster, SAMPLES, Shadow};
use super::view::View;
use glam::DVec3;
use std::collections::BTreeSet;

/// Vertical field of view, degrees.
pub(super) const FOV: f64 = 24.0;
/// Angle of the view above the surface, and around its normal, degrees.
const ELEVATION: f64 = 20.0;
const AZIMUTH: f64 = 16.0;
/// What is seen above the surface, and least and most of what is seen beneath, in radii.
const ABOVE: f64 = 2.3;
const BENEATH: [f64; 2] = [2.2, 6.5];
/// Size of the inset relative to the picture.
const INSET: f64 = 0.27;
/// Distance of the mark of the depth from the middle of the fingertip, in radii.
const MARK_ASIDE: f64 = 1.35;
/// Steps on the way down from the fingertip on which isolines are looked for.
const CROSSING_STEPS: u32 = 600;
/// Left upper corner of the inset relative to the height of the picture.
const INSET_PLACE: [f64; 2] = [0.02, 0.075];
/// Colour of the outline at rest.
pub(super) const REST_INK: [f32; 3] = [0.10, 0.16, 0.30];

/// A press to be drawn; lengths in file units.
pub(super) struct Subject<'a> {
    pub body: Body<'a>,
    pub lines: Option<Isolines<'a>>,
    /// Point of the boundary at rest that is pressed, its outward normal, and the thickness beneath.
    pub site: DVec3,
    pub outward: DVec3,
    pub thickness: f64,
    /// Centre and radius of the sphere that presses, and the depth.
    pub centre: DVec3,
    pub radius: f64,
    /// Rough direction to the eye.
    pub to_eye: DVec3,
}

/// Where things are in a drawn picture.
pub(super) struct Layout {
    pub view: View,
    /// Surface at rest and lowest point of the fingertip: beside it, and below its middle, in pixels.
    pub depth_mark: [[f64; 2]; 2],
    pub tip: [[f64; 2]; 2],
    /// Isolines below the fingertip, by their number, and their places in pixels.
    pub crossings: Vec<(u16, [f64; 2])>,
    /// Regions seen on the cut face.
    pub regions: BTreeSet<u16>,
}

impl Subject<'_> {
    /// Returns the direction that the cut faces: at right angles to the press, towards the eye.
    fn facing(&self) -> DVec3 {
        let side = self.to_eye - self.outward * self.outward.dot(self.to_eye);
        side.normalize_or(self.outward.any_orthonormal_vector())
    }

    pub fn cut(&self) -> Cut {
        Cut {
            point: self.site,
            normal: self.facing(),
        }
    }

    fn finger(&self) -> Finger {
        let facing = self.facing();
        // To the right of the eye.
        let aside = self.outward.cross(facing);
        Finger::pressing(self.centre, self.radius, self.outward, (aside, facing))
    }

    /// Returns the view of the press, for `size` samples.
    pub fn view(&self, size: [u32; 2]) -> View {
        let facing = self.facing();
        let aside = self.outward.cross(facing);
        let beneath =
            (1.08 * self.thickness).clamp(BENEATH[0] * self.radius, BENEATH[1] * self.radius);
        let above = ABOVE * self.radius;
        let height = above + beneath;
        let look_at = self.site + 0.5 * (above - beneath) * self.outward;
        let (up, around) = (ELEVATION.to_radians(), AZIMUTH.to_radians());
        let back =
            up.cos() * (around.cos() * facing - around.sin() * aside) + up.sin() * self.outward;
        let distance = 0.5 * height / (0.5 * FOV.to_radians()).tan();
        View::perspective(look_at + distance * back, look_at, self.outward, FOV, size)
    }

    /// Draws the press on a transparent background, with the whole body as an inset in a frame of
    /// the colour `ink`.
    pub fn draw(&self, size: [u32; 2], ink: [f32; 3]) -> (Vec<f32>, Layout) {
        let fine = size.map(|n| n * SAMPLES);
        let (view, cut, finger) = (self.view(fine), self.cut(), self.finger());
        let mut raster = Raster::new(fine);
        self.body.draw_boundary(&mut raster, &view, Some(&cut));
        self.body
            .draw_cut(&mut raster, &view, &cut, self.lines.as_ref());
        draw_finger(&finger, &mut raster, &view);
        let mut shadow = Shadow::new(&view, self.site, 7.0 * self.radius);
        let lamp = shadow.view;
        self.body.draw_boundary(&mut shadow.map, &lamp, Some(&cut));
        draw_finger(&finger, &mut shadow.map, &lamp);
        let mut pixels = raster.lit(&view, Some(&shadow));
        let place = |p: DVec3| {
            let at = view.project(p);
            [at.x / f64::from(SAMPLES), at.y / f64::from(SAMPLES)]
        };
        // In front of the eye only.
        let near = |segment: &[DVec3; 2]| segment.iter().all(|p| view.project(*p).z > view.near());
        let outline = self.body.outline_at_rest(&cut);
        let outline = outline.iter().filter(|s| near(s)).map(|s| s.map(place));
        let outline: Vec<_> = outline.collect();
        let scale = f64::from(size[1]) / 768.0;
        let mut pen = Pen {
            pixels: &mut pixels,
            size,
            colour: REST_INK,
            opacity: 0.85,
            width: (2.2 * scale) as f32,
        };
        pen.dashed(&outline, 9.0 * scale);
        let layout = Layout {
            view,
            depth_mark: self.depth_mark(MARK_ASIDE * self.radius).map(place),
            tip: self.depth_mark(0.0).map(place),
            crossings: self.crossings(&raster, &view),
            regions: raster.regions(),
        };
        self.draw_inset((&mut pixels, size), &layout, (&finger, ink));
        (pixels, layout)
    }

    /// Returns two points in the plane of the cut, `aside` from the middle of the fingertip: at the
    /// height of the surface at rest, and of the lowest point of the fingertip.
    fn depth_mark(&self, aside: f64) -> [DVec3; 2] {
        let facing = self.facing();
        let beside = -aside * self.outward.cross(facing);
        let lowest = self.centre - self.radius * self.outward;
        [self.site, lowest].map(|p| p + beside + 0.02 * self.radius * facing)
    }

    /// Returns the isolines that a straight way from the fingertip down crosses one by one.
    fn crossings(&self, raster: &Raster, view: &View) -> Vec<(u16, [f64; 2])> {
        let [_, start] = self.depth_mark(0.0);
        let way = -self.thickness * self.outward;
        let mut found = Vec::new();
        let mut last = None;
        for step in 1..=CROSSING_STEPS {
            let at = view.project(start + f64::from(step) / f64::from(CROSSING_STEPS) * way);
            let inside = |k: usize| (0.0..f64::from(raster.size[k])).contains(&[at.x, at.y][k]);
            let band = match (inside(0) && inside(1)).then(|| raster.kind(at.x as u32, at.y as u32))
            {
                Some(Kind::Cut(_, band)) => Some(band),
                _ => None,
            };
            if let (Some(before), Some(now)) = (last, band) {
                // Stress jumps between regions: there is no line to be named.
                if u16::abs_diff(before, now) == 1 {
                    let pixel = [at.x, at.y].map(|x| x / f64::from(SAMPLES));
                    found.push((before.max(now), pixel));
                }
            }
            last = band;
        }
        found
    }

    /// Draws the whole body, uncut, into the upper left corner, with a frame around what is shown.
    fn draw_inset(
        &self,
        (pixels, size): (&mut [f32], [u32; 2]),
        layout: &Layout,
        (finger, ink): (&Finger, [f32; 3]),
    ) {
        let small = size.map(|n| ((INSET * f64::from(n)) as u32).max(8));
        // Below the title.
        let place = INSET_PLACE.map(|share| (share * f64::from(size[1])) as u32);
        if (0..2).any(|k| place[k] + small[k] > size[k]) {
            return;
        }
        let fine = small.map(|n| n * SAMPLES);
        let view = self.whole_view(layout, fine);
        let mut raster = Raster::new(fine);
        self.body.draw_boundary(&mut raster, &view, None);
        draw_finger(finger, &mut raster, &view);
        let drawn = raster.lit(&view, None);
        for (y, x) in (0..small[1]).flat_map(|y| (0..small[0]).map(move |x| (y, x))) {
            let from = 4 * (y * small[0] + x) as usize;
            let to = 4 * ((y + place[1]) * size[0] + x + place[0]) as usize;
            let over = drawn[from + 3];
            for k in 0..4 {
                // A light plate lies behind the body.
                let plate = if k == 3 { 1.0 } else { 0.985 };
                pixels[to + k] =
                    drawn[from + k] + (1.0 - over) * (0.82 * plate + 0.18 * pixels[to + k]);
            }
        }
        let low = place.map(f64::from);
        let scale = f64::from(size[1]) / 768.0;
        let mut pen = Pen {
            pixels,
            size,
            colour: ink,
            opacity: 0.55,
            width: (1.3 * scale) as f32,
        };
        pen.frame(low, [0, 1].map(|k| low[k] + f64::from(small[k])));
        let place = |p: DVec3| {
            let at = view.project(p);
            [0, 1].map(|k| low[k] + [at.x, at.y][k] / f64::from(SAMPLES))
        };
        // What the large picture shows, as a ring around the site.
        let reach = 2.2 * self.radius;
        let ring = |k: usize| {
            let angle = std::f64::consts::TAU * k as f64 / 48.0;
            place(self.site + reach * (angle.cos() * view.right + angle.sin() * view.up))
        };
        (pen.colour, pen.opacity, pen.width) = ([0.80, 0.16, 0.12], 0.95, (2.0 * scale) as f32);
        (0..48).for_each(|k| pen.line(ring(k), ring(k + 1)));
    }

    /// Returns a view of the whole body from the same side, a little from above.
    fn whole_view(&self, layout: &Layout, size: [u32; 2]) -> View {
        let back = -layout.view.forward;
        let back = (back + 0.45 * self.outward).normalize();
        let (low, high) = bounds(self.body.nodes);
        let middle = 0.5 * (low + high);
        let fit = View::orthographic(middle + back, middle, self.outward, 1.0, [1, 1]);
        let (mut half, aspect) = ([0.0f64; 2], f64::from(size[0]) / f64::from(size[1]));
        for (face, _) in self.body.faces {
            for v in face {
                let to = self.body.nodes[*v as usize] - middle;
                half[0] = half[0].max(to.dot(fit.right).abs());
                half[1] = half[1].max(to.dot(fit.up).abs());
            }
        }
        let height = 2.2 * half[1].max(half[0] / aspect).max(f64::MIN_POSITIVE);
        let far = 2.0 * (high - low).length();
        View::orthographic(middle + far * back, middle, self.outward, height, size)
    }
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let start = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
    points
        .iter()
        .fold(start, |(low, high), p| (low.min(*p), high.max(*p)))
}
