//! The picture of a press: what gives under the fingertip, cut open towards the eye, with the outline of
//! the body at rest, its depth and its force. Drawn on the CPU, so that it is the same everywhere.

mod body;
mod drawing;
mod finger;
mod marks;
mod overlay;
mod raster;
mod view;

use super::session::{not_placed, static_body};
use super::{Press, PressSample};
use crate::annotate::{Annotations, Legend, ScaleBar, Swatch};
use crate::mesh::{SmoothRegions, Topology};
use crate::number_format::significant;
use crate::physics::BodyField;
use crate::render::{Camera, Image, named_colour, tissue_colour};
use crate::scene::{Scene, Stage};
use crate::{Error, Result};
use body::{Body, Isolines};
use drawing::{FOV, Layout, Subject};
use glam::DVec3;
use marks::Marks;
use std::collections::BTreeMap;

/// Colour of the boundary, and of the inside of a body without regions.
const SKIN: [f32; 3] = [0.91, 0.74, 0.63];
const FLESH: [f32; 3] = [0.86, 0.47, 0.42];
/// Colours of regions whose name is no tissue.
const PALETTE: [&str; 8] = [
    "#e7c873", "#d9796b", "#6f9fc4", "#7fb38a", "#a58bc0", "#e0a06a", "#c9c3b6", "#5fb0ad",
];
/// Tissues of an outermost layer that is drawn as skin.
const OUTER_TISSUES: [&str; 3] = ["skin", "fat", "adipose"];
/// Number of intervals between isolines that is aimed for.
const LINES: f64 = 9.0;

/// What does not change during a press.
pub(super) struct PressedBody {
    rest: Vec<DVec3>,
    faces: Vec<([u32; 3], u32)>,
    tets: Vec<[u32; 4]>,
    /// Region of each tet.
    regions: Vec<u16>,
    /// What carries the nodes, if they are not those of the body.
    smooth: Option<SmoothRegions>,
    names: Vec<String>,
    colours: Vec<[f32; 3]>,
    skin: Option<[f32; 3]>,
    to_eye: DVec3,
}

/// A state of a press.
#[derive(Clone)]
pub(super) struct PressedState {
    positions: Vec<DVec3>,
    centre: DVec3,
    sample: Option<PressSample>,
    /// Values at the nodes whose isolines are drawn, and their field.
    values: Option<(BodyField, Vec<f64>)>,
}

/// What the pictures of a press show.
#[derive(Default)]
pub(super) struct KeptPictures {
    body: Option<PressedBody>,
    last: Option<PressedState>,
    deepest: Option<PressedState>,
}

/// Returns the field whose isolines a picture of a press shows: `displacement`, or `stress` for that of
/// von Mises.
///
/// # Errors
/// [`Error::Input`] for another name.
pub fn field_shown(name: &str) -> Result<BodyField> {
    match name {
        "displacement" => Ok(BodyField::Displacement),
        "stress" => Ok(BodyField::VonMises),
        _ => Err(Error::Input(format!(
            "isolines on a press show displacement or stress, got \"{name}\""
        ))),
    }
}

impl Press {
    /// Keeps the present state for [`Press::picture`] and, just after loading, for
    /// [`Press::deepest_picture`], with isolines of `show` on the cut, if given:
    /// the displacement or a stress.
    ///
    /// # Errors
    /// [`Error::Input`] if the body has no such field; errors of reading the body back.
    pub fn keep_picture(&mut self, show: Option<BodyField>) -> Result<()> {
        if self.drawn.body.is_none() {
            self.drawn.body = Some(PressedBody::new(&mut self.stage, self.site.point)?);
        }
        let depth = self.session.depth().ok_or_else(not_placed)?;
        let (_, centre) = self.session.fingertip_at(depth)?;
        let motion = self.stage.motion().ok_or_else(static_body)?;
        let field = |field: BodyField| {
            field.check(&*motion.simulator)?;
            let values = field.per_node(&*motion.simulator)?;
            Ok::<_, Error>((field, values))
        };
        let (mut positions, mut values) = (motion.positions()?, show.map(field).transpose()?);
        let smooth = self
            .drawn
            .body
            .as_ref()
            .and_then(|body| body.smooth.as_ref());
        if let Some(smooth) = smooth {
            positions = smooth.vectors(&positions);
            values = values.map(|(field, values)| (field, smooth.values(&values)));
        }
        let state = PressedState {
            positions,
            centre,
            sample: self.samples().last().copied(),
            values,
        };
        if self.at_max_depth() {
            self.drawn.deepest = Some(state.clone());
        }
        self.drawn.last = Some(state);
        Ok(())
    }

    /// Returns a picture of `size` pixels of the state kept by [`Press::keep_picture`]: the body cut
    /// through the fingertip towards the eye, with its outline at rest, the depth, the force with its
    /// error if known, and the whole body as an inset; on the background of the scene.
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

    fn picture_of(&self, state: Option<&PressedState>, size: [u32; 2]) -> Result<Image> {
        let (Some(own), Some(state)) = (&self.drawn.body, state) else {
            return Err(Error::Input(
                "no such state of the press was kept; call Press::keep_picture first".into(),
            ));
        };
        if size.iter().any(|n| !(MIN_SIDE..=MAX_SIDE).contains(n)) {
            return Err(Error::Input(format!(
                "a picture of a press has {MIN_SIDE} to {MAX_SIDE} pixels per side, got {} x {}",
                size[0], size[1]
            )));
        }
        let background = self.stage.picture_background();
        let spacing = state.values.as_ref().map(|(_, values)| spacing(values));
        let lines = state.values.as_ref().zip(spacing);
        let subject = Subject {
            body: own.body(&state.positions),
            lines: lines.map(|((_, values), spacing)| Isolines { values, spacing }),
            site: self.site.point,
            outward: self.site.outward,
            thickness: self.site.thickness,
            centre: state.centre,
            radius: self.radius(),
            to_eye: own.to_eye,
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
        let depth = state.sample.map(|sample| sample.depth_m);
        let marks = Marks {
            layout: &layout,
            depth_m: depth.filter(|d| *d > 0.0),
            spacing: state
                .values
                .as_ref()
                .zip(spacing)
                .map(|((field, _), spacing)| self.shown(*field).1 * spacing),
        };
        marks.draw(&mut image, background)?;
        let unit = self.stage.motion().map(crate::scene::Motion::length_unit);
        let annotations = Annotations {
            title: Some(self.title(state, spacing)),
            legend: own.legend(&layout),
            scale_bar: Some(ScaleBar { length_unit: unit }),
            ..Annotations::default()
        };
        let view = layout.view;
        let camera = Camera::perspective(view.eye, view.look_at, view.up, FOV);
        annotations.draw(&mut image, &camera, background)?;
        Ok(image)
    }

    /// Returns the force with its error, the depth, and what the isolines are.
    fn title(&self, state: &PressedState, spacing: Option<f64>) -> String {
        let force = state.sample.map(|sample| {
            let deepest = self.samples().iter().map(|s| s.depth_m).fold(0.0, f64::max);
            let error = self
                .force_error(&sample)
                .filter(|_| sample.depth_m >= deepest);
            let force = match error {
                Some(error) => format!("{} ± {} N", rounded(sample.force_n), two_digits(error)),
                None => format!("{} N (± not estimated)", rounded(sample.force_n)),
            };
            format!("{force} at {} mm", rounded(1e3 * sample.depth_m.max(0.0)))
        });
        let mut title = force.unwrap_or_else(|| "at rest".into());
        if let (Some((field, _)), Some(spacing)) = (&state.values, spacing) {
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
            BodyField::Displacement => {
                let motion = self.stage.motion();
                let unit = motion.map_or(1.0, crate::scene::Motion::length_unit);
                ("displacement", 1e3 * unit, "mm")
            }
            BodyField::VonMises => ("von Mises stress", 1e-3, "kPa"),
            other => (other.name(), 1.0, other.unit()),
        }
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

impl PressedBody {
    /// Collects what the pictures of a press on the body of `stage` need.
    fn new(stage: &mut Stage, site: DVec3) -> Result<PressedBody> {
        let to_eye = stage.camera_mut().eye - site;
        let own = stage.motion().ok_or_else(static_body)?.simulator.mesh();
        let (_, scene) = stage.origin();
        let smooth = scene.smooth_regions(own)?;
        let mesh = smooth.as_ref().map_or(own, |smooth| &smooth.mesh);
        let topology = Topology::new(mesh);
        let faces = topology.boundary.iter();
        let faces: Vec<_> = faces
            .map(|b| (topology.boundary_nodes(mesh, *b), b.tet))
            .collect();
        let labels: Vec<i64> = match mesh.region_field() {
            Some(field) => field.values.iter().map(|v| *v as i64).collect(),
            None => vec![0; mesh.tets.len()],
        };
        let numbers: BTreeMap<i64, u16> = labels
            .iter()
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .zip(0u16..)
            .map(|(label, number)| (*label, number))
            .collect();
        let regions: Vec<u16> = labels.iter().map(|label| numbers[label]).collect();
        let mut names = Vec::new();
        let mut colours = Vec::new();
        for (label, number) in &numbers {
            let name = mesh.region_names.get(label).cloned();
            let name = name.unwrap_or_else(|| format!("region {label}"));
            colours.push(match numbers.len() {
                1 => FLESH,
                _ => region_colour(scene, stage, (*label, &name), *number)?,
            });
            names.push(name);
        }
        let mut outer = vec![0usize; names.len()];
        for (_, tet) in &faces {
            outer[usize::from(regions[*tet as usize])] += 1;
        }
        let outermost = (0..outer.len()).max_by_key(|r| outer[*r]).unwrap_or(0);
        let name = names
            .get(outermost)
            .map(|n| n.to_lowercase())
            .unwrap_or_default();
        let is_skin = names.len() == 1 || OUTER_TISSUES.iter().any(|t| name.contains(t));
        Ok(PressedBody {
            rest: mesh.nodes.clone(),
            tets: mesh.tets.clone(),
            faces,
            regions,
            smooth,
            names,
            colours,
            skin: is_skin.then_some(SKIN),
            to_eye,
        })
    }

    fn body<'a>(&'a self, positions: &'a [DVec3]) -> Body<'a> {
        Body {
            rest: &self.rest,
            nodes: positions,
            tets: &self.tets,
            faces: &self.faces,
            regions: &self.regions,
            colours: &self.colours,
            skin: self.skin,
        }
    }

    /// Returns the regions that are seen on the cut; `None` for a body without regions.
    fn legend(&self, layout: &Layout) -> Option<Legend> {
        let seen = layout.regions.iter().map(|r| usize::from(*r));
        let regions: Vec<Swatch> = seen
            .map(|r| Swatch {
                name: self.names[r].clone(),
                colour: self.colours[r].map(f64::from),
            })
            .collect();
        let has_skin = self.names.iter().any(|name| name.contains("skin"));
        let surface = self.skin.filter(|_| !has_skin).map(|colour| Swatch {
            name: "surface".into(),
            colour: colour.map(f64::from),
        });
        (self.names.len() > 1 && !regions.is_empty()).then(|| Legend::Regions {
            name: "regions".into(),
            regions: regions.into_iter().chain(surface).collect(),
        })
    }
}

/// Returns the colour of a region: that of the scene, of its tissue, of the scene's transfer function, or
/// of its number.
fn region_colour(
    scene: &Scene,
    stage: &Stage,
    (label, name): (i64, &str),
    number: u16,
) -> Result<[f32; 3]> {
    let entries = &scene.picture.region;
    let entry = entries
        .get(name)
        .or_else(|| entries.get(&label.to_string()));
    if let Some(colour) = entry.and_then(|entry| entry.colour.as_deref()) {
        return Ok(named_colour(colour)?.map(|c| c as f32));
    }
    let seen = stage.scalar_field();
    let own = scene.picture.transfer.is_some() && !seen.regions.is_empty();
    if own {
        let extent = crate::mesh::LocalFrame::from_mesh(stage.mesh()).scale;
        let transfer = scene.transfer(seen)?.to_absolute(seen.range, extent);
        return Ok(transfer.colour(label as f64).map(|c| c as f32));
    }
    if let Some(colour) = tissue_colour(name) {
        return Ok(colour);
    }
    let colour = PALETTE[usize::from(number) % PALETTE.len()];
    Ok(named_colour(colour)?.map(|c| c as f32))
}
