//! Annotations of a scene's pictures, and annotated rendering.

use super::picture::DisplayMode;
use super::stage::Stage;
use super::{ScalarField, Scene, Unit};
use crate::Result;
use crate::annotate::{
    Annotations, BarColours, ColourBar, FrameTime, Legend, ScaleBar, Swatch, missing_letters,
};
use crate::mesh::{DEPTH, TetMesh, Topology};
use crate::physics::BodyField;
use crate::progress::{ProgressFn, no_progress};
#[cfg(not(target_arch = "wasm32"))]
use crate::render::Animation;
use crate::render::{Background, BitDepth, Camera, Image, Mode, TransferFunction};
use std::path::Path;

/// Thickness of the legend's colour strip, over the body's extent.
const STRIP_DEPTH: f64 = 0.1;
/// Names of length units, and their size in metres.
const UNITS: [(&str, f64); 5] = [
    ("m", 1.0),
    ("cm", 1e-2),
    ("mm", 1e-3),
    ("µm", 1e-6),
    ("in", 0.0254),
];

/// Data of the annotations that is constant over the pictures.
pub(super) struct AnnotationContext {
    transfer: TransferFunction,
    /// Transfer function of each displayed region; `None` for a hidden one.
    of_regions: Vec<Option<TransferFunction>>,
    /// Metres per unit of the mesh, if known.
    length_unit: Option<f64>,
    /// Whether the picture shows a field whose colours a legend can represent.
    legend: bool,
    /// Displayed time, if it replaces the simulated time.
    time: Option<FrameTime>,
}

impl AnnotationContext {
    /// Creates the annotation data of `scene`, whose pictures show the field `seen` of `mesh`, and
    /// notes for the user.
    pub fn new(
        scene: &Scene,
        (mesh, topology): (&TetMesh, &Topology),
        seen: &ScalarField,
    ) -> Result<(AnnotationContext, Vec<String>)> {
        let picture = &scene.picture;
        let mode = scene.display_mode()?;
        let with_planes = scene.plane.len() + scene.isosurface.len() > 0;
        let named = picture.field.is_some() || picture.transfer.is_some();
        let coloured = named && scene.scan.is_empty();
        let shows = match mode {
            DisplayMode::Inside(_) => true,
            DisplayMode::Surface => coloured || with_planes,
            DisplayMode::Skin => false,
        };
        let asked = picture.legend == Some(true);
        let mut notes = Vec::new();
        if asked && !shows {
            notes.push(match mode {
                DisplayMode::Skin => "no legend: skins show no field".into(),
                _ => "no legend: the boundary has one colour; colour it by a field with --field"
                    .to_owned(),
            });
        }
        let annotated = asked
            || picture.scale_bar == Some(true)
            || picture.time == Some(true)
            || picture.axes.is_some()
            || picture.title.is_some();
        if annotated && mode == DisplayMode::Inside(Mode::Thickness) {
            notes.push(EXR_HAS_NONE.into());
        }
        let names = seen.regions.iter().map(|(name, _)| name.as_str());
        let legend = names.chain([seen.name.as_str()]).filter(|_| asked && shows);
        let drawn: String = picture.title.as_deref().into_iter().chain(legend).collect();
        let missing = missing_letters(&drawn);
        if !missing.is_empty() {
            notes.push(format!(
                "the font of annotations lacks the letters {missing}, which are drawn as boxes; use Latin, Greek or Cyrillic names and titles"
            ));
        }
        let unit = scene.mesh.unit.as_ref().map(Unit::metres).transpose()?;
        let transfer = scene.transfer(seen)?;
        let looks = match mode {
            DisplayMode::Inside(_) => scene.region_looks(mesh, topology, &transfer)?,
            DisplayMode::Surface | DisplayMode::Skin => None,
        };
        let of_region = |scalar: f64| {
            let (Some(looks), Some(cells)) = (&looks, &seen.cells) else {
                return Some(transfer.clone());
            };
            let tet = cells.iter().position(|cell| *cell == scalar)?;
            let row = (*looks.tet_regions.get(tet)?)?;
            looks.transfers.get(row as usize).cloned()
        };
        let surroundings = AnnotationContext {
            of_regions: seen.regions.iter().map(|(_, s)| of_region(*s)).collect(),
            transfer,
            length_unit: unit.or(mesh.length_unit),
            legend: asked && shows,
            time: None,
        };
        Ok((surroundings, notes))
    }

    /// Returns the name of the mesh's length unit.
    fn unit(&self) -> String {
        let Some(metres) = self.length_unit else {
            return "units".into();
        };
        let named = UNITS.iter().find(|(_, m)| (m / metres - 1.0).abs() < 1e-9);
        named.map_or_else(|| "units".into(), |(name, _)| (*name).into())
    }
}

/// Note that an EXR has no annotations.
const EXR_HAS_NONE: &str = "legend, scale bar, axes, title and time are drawn in PNGs and films only; an EXR contains only the values";

impl Stage {
    /// Returns the annotations of the current picture as set in the scene.
    pub fn annotations(&self) -> Annotations {
        let picture = &self.scene.picture;
        Annotations {
            title: picture.title.clone(),
            time: self.frame_time().filter(|_| picture.time == Some(true)),
            legend: self.looks.surroundings.legend.then(|| self.legend()),
            scale_bar: (picture.scale_bar == Some(true)).then_some(ScaleBar {
                length_unit: self.looks.surroundings.length_unit,
            }),
            axes: picture.axes,
        }
    }

    /// Sets the displayed time, in place of the simulated time, such as that of a recorded series.
    pub fn set_displayed_time(&mut self, time: FrameTime) {
        self.looks.surroundings.time = Some(time);
    }

    /// Returns the time displayed in a picture.
    fn frame_time(&self) -> Option<FrameTime> {
        let simulated = || {
            self.motion().map(|motion| FrameTime {
                seconds: motion.time(),
                resolution: motion.dt * f64::from(self.steps().max(1)),
            })
        };
        self.looks.surroundings.time.or_else(simulated)
    }

    fn legend(&self) -> Legend {
        let seen = &self.looks.scalars;
        let frame = self.looks.raycaster.geometry().frame();
        let transfer = self
            .looks
            .surroundings
            .transfer
            .to_absolute(seen.range, frame.scale);
        if !seen.regions.is_empty() {
            return Legend::Regions {
                name: seen.name.clone(),
                regions: self.swatches(frame.scale),
            };
        }
        let colours = match self.looks.mode {
            DisplayMode::Inside(Mode::Composite) => BarColours::Transfer {
                transfer,
                path_length: Some(STRIP_DEPTH * frame.scale),
            },
            DisplayMode::Inside(_) => BarColours::Grey,
            DisplayMode::Surface | DisplayMode::Skin => BarColours::Transfer {
                transfer,
                path_length: None,
            },
        };
        let computed = self.looks.computed_field.as_ref().map(|shown| shown.field);
        let unit = match computed {
            Some(BodyField::Displacement) => self.looks.surroundings.unit(),
            Some(field) => field.unit().to_owned(),
            None if seen.name == DEPTH => self.looks.surroundings.unit(),
            None => String::new(),
        };
        Legend::Bar(ColourBar {
            name: seen.name.clone(),
            unit,
            range: seen.range,
            colours,
        })
    }

    /// Returns the visible regions in the picture's colours; `size` is the body's extent.
    fn swatches(&self, size: f64) -> Vec<Swatch> {
        let range = self.looks.scalars.range;
        let grey = |s: f64| {
            let share = (s - range.0) / (range.1 - range.0).max(f64::MIN_POSITIVE);
            [share.clamp(0.0, 1.0); 3]
        };
        let through = self.looks.mode == DisplayMode::Inside(Mode::Composite);
        let looks = self
            .looks
            .scalars
            .regions
            .iter()
            .zip(&self.looks.surroundings.of_regions);
        let swatches = looks.filter_map(|((name, scalar), look)| {
            let transfer = look.as_ref()?.to_absolute(range, size);
            let seen = !through || transfer.extinction(*scalar) > 0.0;
            seen.then(|| Swatch {
                name: name.clone(),
                colour: match self.looks.mode {
                    DisplayMode::Inside(mode) if mode != Mode::Composite => grey(*scalar),
                    _ => transfer.colour(*scalar),
                },
            })
        });
        swatches.collect()
    }

    /// Renders the picture as [`Stage::image`] with the annotations of the scene. Thickness is then
    /// shown in grey, from 0 to the largest value, and X-rays as film.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub fn render_annotated(&mut self) -> Result<Image> {
        let image = self.image()?;
        let mut annotations = self.annotations();
        if self.looks.mode == DisplayMode::Inside(Mode::Xray) {
            let (mut image, white) = self.looks.film.develop(&image);
            if annotations.legend.is_some() {
                annotations.legend = Some(Legend::Bar(ColourBar {
                    name: "∫ μ dl".into(),
                    unit: String::new(),
                    range: (0.0, f64::from(white)),
                    colours: BarColours::Grey,
                }));
            }
            if !annotations.is_empty() {
                annotations.draw(&mut image, &self.looks.camera, self.looks.background)?;
            }
            return Ok(image);
        }
        if annotations.is_empty() {
            return Ok(image);
        }
        let (mut image, longest) = image.to_rgba();
        if let (Some(longest), Some(_)) = (longest, &annotations.legend) {
            annotations.legend = Some(Legend::Bar(ColourBar {
                name: "thickness".into(),
                unit: self.looks.surroundings.unit(),
                range: (0.0, f64::from(longest)),
                colours: BarColours::Grey,
            }));
        }
        annotations.draw(&mut image, &self.looks.camera, self.looks.background)?;
        Ok(image)
    }

    /// As [`Stage::render_annotated`], on the background of the scene, for which the annotations have
    /// their colours.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub(crate) fn render_on_background(&mut self) -> Result<Image> {
        Ok(self.render_annotated()?.on(self.looks.background))
    }

    /// Renders the picture and saves it with the scene's background and bit depth; a PNG also has
    /// the annotations of the scene.
    ///
    /// # Errors
    /// As [`Stage::image`] and [`Image::save_as`].
    pub fn save(&mut self, path: impl AsRef<Path>) -> Result<()> {
        self.save_with_progress(path, &no_progress)
    }

    /// As [`Stage::save`]; reports the progress of light paths.
    ///
    /// # Errors
    /// As [`Stage::save`], and [`Error::Cancelled`](crate::Error::Cancelled).
    pub fn save_with_progress(
        &mut self,
        path: impl AsRef<Path>,
        progress: ProgressFn,
    ) -> Result<()> {
        let path = path.as_ref();
        let raw = self.raw_image(progress)?;
        let image = match is_exr(path) {
            true => raw,
            false => self.render_annotated()?,
        };
        image.save_as(path, self.looks.background, self.looks.bits)
    }

    /// Renders the picture as [`Stage::save`] writes it to a PNG of 8 bits: RGBA per pixel, row by
    /// row from the top.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub fn rgba(&mut self) -> Result<Vec<u8>> {
        Ok(self.render_annotated()?.rgba8(self.looks.background))
    }

    /// Returns a writer for pictures requested by [`Stage::render_async`], with the current
    /// settings.
    pub fn picture_writer(&self) -> PictureWriter {
        PictureWriter {
            annotations: self.annotations(),
            camera: self.looks.camera,
            background: self.looks.background,
            bits: self.looks.bits,
        }
    }

    /// Adds the picture to `film`, with the scene's annotations and background.
    ///
    /// # Errors
    /// As [`Stage::image`] and [`Animation::push`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn film(&mut self, film: &mut Animation) -> Result<()> {
        let image = self.render_annotated()?;
        film.push(&image, self.looks.background)
    }

    /// Returns a note if a picture of that name lacks the annotations set in the scene.
    pub fn annotation_note(&self, path: impl AsRef<Path>) -> Option<String> {
        let is_thickness = self.looks.mode == DisplayMode::Inside(Mode::Thickness);
        let left_out = is_exr(path.as_ref()) && !self.annotations().is_empty();
        (left_out && !is_thickness).then(|| EXR_HAS_NONE.into())
    }
}

/// Saves a picture of a stage on any thread, even if the stage has advanced in the meantime.
#[derive(Clone, Debug)]
pub struct PictureWriter {
    annotations: Annotations,
    camera: Camera,
    background: Background,
    bits: BitDepth,
}

impl PictureWriter {
    /// Saves `image` as [`Stage::save`] does: a PNG with the annotations of the scene.
    ///
    /// # Errors
    /// As [`Image::save_as`].
    pub fn save(&self, mut image: Image, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        if !(self.annotations.is_empty() || is_exr(path)) {
            self.annotations
                .draw(&mut image, &self.camera, self.background)?;
        }
        image.save_as(path, self.background, self.bits)
    }
}

fn is_exr(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}
