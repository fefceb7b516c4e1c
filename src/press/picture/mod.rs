//! The picture of a press: what gives under the fingertip, cut open towards the eye, with the outline of
//! the body at rest, its depth and its force. Drawn on the CPU, so that it is the same everywhere.

mod body;
mod drawing;
mod finger;
mod marks;
mod overlay;
mod pressed_body;
mod raster;
mod view;

use super::session::{not_placed, static_body};
use super::{Press, PressSample, PressSession, PressSite};
use crate::annotate::{Annotations, ScaleBar};
use crate::number_format::significant;
use crate::physics::BodyField;
use crate::render::{Background, Camera, Image};
use crate::scene::Stage;
use crate::{Error, Result};
use body::Isolines;
use drawing::{FOV, Subject};
use glam::DVec3;
use marks::Marks;
use pressed_body::PressedBody;
use std::sync::Arc;

/// Number of intervals between isolines that is aimed for.
const LINES: f64 = 9.0;

/// A state of a press, to be drawn: the body cut through the fingertip towards the eye, with its outline
/// at rest, the depth, the force, and the whole body as an inset. It is independent of the device, so
/// that another thread can draw it.
#[derive(Clone)]
pub struct PressPicture {
    body: Arc<PressedBody>,
    positions: Vec<DVec3>,
    site: PressSite,
    /// Centre and radius of the fingertip, in file units.
    centre: DVec3,
    radius: f64,
    to_eye: DVec3,
    sample: Option<PressSample>,
    /// Values at the nodes whose isolines are drawn, and their field.
    values: Option<(BodyField, Vec<f64>)>,
}

/// The pictures that a press keeps.
#[derive(Default)]
pub(super) struct KeptPictures {
    last: Option<PressPicture>,
    deepest: Option<PressPicture>,
}

impl PressPicture {
    /// Returns the field whose isolines a picture of a press shows: `displacement`, or `stress` for that of
    /// von Mises.
    ///
    /// # Errors
    /// [`Error::Input`] for another name.
    pub fn field(name: &str) -> Result<BodyField> {
        match name {
            "displacement" => Ok(BodyField::Displacement),
            "stress" => Ok(BodyField::VonMises),
            _ => Err(Error::Input(format!(
                "isolines on a press show displacement or stress, got \"{name}\""
            ))),
        }
    }

    /// Takes the present state of the press `session` on the body of `stage`, seen from the side of its
    /// camera, with isolines of `show` on the cut, if given: the displacement or a stress. An earlier
    /// picture of the same body saves time.
    ///
    /// # Errors
    /// [`Error::Input`] if the body has no such field, or the fingertip is not placed; errors of reading
    /// the body back.
    pub fn new(
        stage: &mut Stage,
        session: &PressSession,
        show: Option<BodyField>,
        earlier: Option<&PressPicture>,
    ) -> Result<PressPicture> {
        let eye = stage.camera_mut().eye;
        let motion = stage.motion().ok_or_else(static_body)?;
        let body = match earlier.filter(|earlier| earlier.body.is_of(motion)) {
            Some(earlier) => earlier.body.clone(),
            None => Arc::new(PressedBody::new(stage)?),
        };
        let site = *session.site().ok_or_else(not_placed)?;
        let depth = session.depth().ok_or_else(not_placed)?;
        let (_, centre) = session.fingertip_at(depth)?;
        let field = |field: BodyField| {
            field.check(&*motion.simulator)?;
            let values = field.per_node(&*motion.simulator)?;
            Ok::<_, Error>((field, values))
        };
        let (mut positions, mut values) = (motion.positions()?, show.map(field).transpose()?);
        if let Some(smooth) = &body.smooth {
            positions = smooth.vectors(&positions);
            values = values.map(|(field, values)| (field, smooth.values(&values)));
        }
        Ok(PressPicture {
            body,
            positions,
            site,
            centre,
            radius: session.radius(),
            to_eye: eye - site.point,
            sample: session.samples().last().copied(),
            values,
        })
    }

    /// Returns what was measured in this state; `None` before the first step.
    pub fn sample(&self) -> Option<&PressSample> {
        self.sample.as_ref()
    }

    /// Draws the state with `size` pixels on `background`, with the error of its force, N, if known.
    ///
    /// # Errors
    /// [`Error::Input`] for pictures that are too small or too large.
    pub fn draw(
        &self,
        size: [u32; 2],
        background: Background,
        force_error: Option<f64>,
    ) -> Result<Image> {
        if size.iter().any(|n| !(MIN_SIDE..=MAX_SIDE).contains(n)) {
            return Err(Error::Input(format!(
                "a picture of a press has {MIN_SIDE} to {MAX_SIDE} pixels per side, got {} x {}",
                size[0], size[1]
            )));
        }
        let spacing = self.values.as_ref().map(|(_, values)| spacing(values));
        let lines = self.values.as_ref().zip(spacing);
        let subject = Subject {
            body: self.body.body(&self.positions),
            lines: lines.map(|((_, values), spacing)| Isolines { values, spacing }),
            site: self.site.point,
            outward: self.site.outward,
            thickness: self.site.thickness,
            centre: self.centre,
            radius: self.radius,
            to_eye: self.to_eye,
        };
        let ink = if background.is_light() {
            [0.1; 3]
        } else {
            [0.9; 3]
        };
        let (values, layout) = subject.draw(size, ink);
        let mut image = Image {
            size,
            channels: 4,
            values,
        };
        let depth = self.sample.map(|sample| sample.depth_m);
        let marks = Marks {
            layout: &layout,
            depth_m: depth.filter(|d| *d > 0.0),
            spacing: lines.map(|((field, _), spacing)| self.shown(*field).1 * spacing),
        };
        marks.draw(&mut image, background)?;
        let annotations = Annotations {
            title: Some(self.title(force_error, spacing)),
            legend: self.body.legend(&layout),
            scale_bar: Some(ScaleBar {
                length_unit: Some(self.body.length_unit),
            }),
            ..Annotations::default()
        };
        let view = layout.view;
        let camera = Camera::perspective(view.eye, view.look_at, view.up, FOV);
        annotations.draw(&mut image, &camera, background)?;
        Ok(image)
    }

    /// Returns the force with its error, the depth, and what the isolines are.
    fn title(&self, force_error: Option<f64>, spacing: Option<f64>) -> String {
        let force = self.sample.map(|sample| {
            let at = format!("at {} mm", rounded(1e3 * sample.depth_m.max(0.0)));
            let force = rounded(sample.force_n);
            match force_error {
                _ if sample.force_n == 0.0 && sample.depth_m > 0.0 => format!("no contact {at}"),
                Some(error) => format!("{force} ± {} N {at}", two_digits(error)),
                None => format!("{force} N {at}, error not estimated"),
            }
        });
        let mut title = force.unwrap_or_else(|| "at rest".into());
        if let (Some((field, _)), Some(spacing)) = (&self.values, spacing) {
            let (name, scale, unit) = self.shown(*field);
            title += &format!(
                "; lines every {} {unit} of {name}",
                rounded(scale * spacing)
            );
        }
        title
    }

    /// Returns the name of a field, its scale to the displayed unit, and that unit.
    fn shown(&self, field: BodyField) -> (&'static str, f64, &'static str) {
        match field {
            BodyField::Displacement => ("displacement", 1e3 * self.body.length_unit, "mm"),
            BodyField::VonMises => ("von Mises stress", 1e-3, "kPa"),
            other => (other.name(), 1.0, other.unit()),
        }
    }
}

impl Press {
    /// Keeps the present state for [`Press::picture`] and, just after loading, for
    /// [`Press::deepest_picture`], with isolines of `show` on the cut, if given:
    /// the displacement or a stress.
    ///
    /// # Errors
    /// As [`PressPicture::new`].
    pub fn keep_picture(&mut self, show: Option<BodyField>) -> Result<()> {
        let earlier = self.drawn.last.as_ref();
        let picture = PressPicture::new(&mut self.stage, &self.session, show, earlier)?;
        if self.at_max_depth() {
            self.drawn.deepest = Some(picture.clone());
        }
        self.drawn.last = Some(picture);
        Ok(())
    }

    /// Returns a picture of `size` pixels of the state kept by [`Press::keep_picture`], on the background
    /// of the scene.
    ///
    /// # Errors
    /// [`Error::Input`] if no state was kept, or for an invalid background.
    pub fn picture(&self, size: [u32; 2]) -> Result<Image> {
        self.picture_of(self.drawn.last.as_ref(), size)
    }

    /// As [`Press::picture`], of the state kept at the largest depth.
    ///
    /// # Errors
    /// As [`Press::picture`].
    pub fn deepest_picture(&self, size: [u32; 2]) -> Result<Image> {
        self.picture_of(self.drawn.deepest.as_ref(), size)
    }

    fn picture_of(&self, picture: Option<&PressPicture>, size: [u32; 2]) -> Result<Image> {
        let picture = picture.ok_or_else(|| {
            Error::Input(
                "no such state of the press was kept; call Press::keep_picture first".into(),
            )
        })?;
        // The error is that of the force at the largest depth.
        let deepest = self.samples().iter().map(|s| s.depth_m).fold(0.0, f64::max);
        let sample = picture.sample().filter(|s| s.depth_m >= deepest);
        let error = sample.and_then(|sample| self.force_error(sample));
        picture.draw(size, self.stage.picture_background(), error)
    }
}

/// Least and most pixels of a picture along a side.
const MIN_SIDE: u32 = 8;
const MAX_SIDE: u32 = 8192;

fn rounded(x: f64) -> String {
    format_digits(x, 3)
}

fn two_digits(x: f64) -> String {
    format_digits(x, 2)
}

/// Formats `x` with so many significant digits.
fn format_digits(x: f64, digits: i32) -> String {
    if x == 0.0 || !x.is_finite() {
        return significant(x);
    }
    let unit = 10f64.powi(x.abs().log10().floor() as i32 + 1 - digits);
    significant((x / unit).round() * unit)
}

/// Returns a round distance between isolines of `values`.
fn spacing(values: &[f64]) -> f64 {
    let most = values
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max);
    let wanted = (most / LINES).max(f64::MIN_POSITIVE);
    let power = 10f64.powf(wanted.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|s| s * power);
    steps.into_iter().find(|s| *s >= wanted).unwrap_or(wanted)
}
