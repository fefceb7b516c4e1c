//! What a scene asks to be drawn onto its pictures, and the pictures with it.

use super::picture::DisplayMode;
use super::stage::Stage;
use super::{ScalarField, Scene, Unit};
use crate::Result;
use crate::annotate::{Annotations, BarColours, ColourBar, FrameTime, Legend, ScaleBar, Swatch};
use crate::mesh::{DEPTH, TetMesh, Topology};
use crate::physics::BodyField;
#[cfg(not(target_arch = "wasm32"))]
use crate::render::Animation;
use crate::render::{Background, BitDepth, Camera, Image, Mode, TransferFunction};
use std::path::Path;

/// The strip of a legend is as opaque as this share of the body's extent.
const STRIP_DEPTH: f64 = 0.1;
/// Names of units, and metres in one.
const UNITS: [(&str, f64); 5] = [
    ("m", 1.0),
    ("cm", 1e-2),
    ("mm", 1e-3),
    ("µm", 1e-6),
    ("in", 0.0254),
];

/// What does not change from picture to picture.
pub(super) struct AnnotationContext {
    transfer: TransferFunction,
    /// What shows each region, where regions are seen; none for one that is hidden.
    of_regions: Vec<Option<TransferFunction>>,
    /// Metres in one unit of the mesh, where it is known.
    length_unit: Option<f64>,
    /// Whether the picture shows a field whose colours a legend can tell.
    legend: bool,
    /// The time to tell in place of the simulator's.
    time: Option<FrameTime>,
}

impl AnnotationContext {
    /// Those of `scene`, whose pictures show `seen` of `mesh`; and what is to be said of them.
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
                DisplayMode::Skin => "skins show no field, so there is no legend".into(),
                _ => "the boundary is in one colour, so there is no legend; --field gives it that of a field".to_owned(),
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

    /// The name of the mesh's unit of length.
    fn unit(&self) -> String {
        let Some(metres) = self.length_unit else {
            return "units".into();
        };
        let named = UNITS.iter().find(|(_, m)| (m / metres - 1.0).abs() < 1e-9);
        named.map_or_else(|| "units".into(), |(name, _)| (*name).into())
    }
}

/// That an EXR shows nothing of it.
const EXR_HAS_NONE: &str = "legend, scale bar, axes, title and time are drawn onto PNGs and films; an EXR has the values alone";

impl Stage {
    /// What the scene asks to be drawn onto its picture, as it is now.
    pub fn annotations(&self) -> Annotations {
        let picture = &self.scene.picture;
        Annotations {
            title: picture.title.clone(),
            time: self.frame_time().filter(|_| picture.time == Some(true)),
            legend: self.surroundings.legend.then(|| self.legend()),
            scale_bar: (picture.scale_bar == Some(true)).then_some(ScaleBar {
                length_unit: self.surroundings.length_unit,
            }),
            axes: picture.axes,
        }
    }

    /// Has pictures tell this time in place of the simulator's: of a recorded series, say.
    pub fn set_displayed_time(&mut self, time: FrameTime) {
        self.surroundings.time = Some(time);
    }

    /// The time that a picture tells.
    fn frame_time(&self) -> Option<FrameTime> {
        let simulated = || {
            self.motion().map(|motion| FrameTime {
                seconds: motion.time(),
                resolution: motion.dt * f64::from(self.steps().max(1)),
            })
        };
        self.surroundings.time.or_else(simulated)
    }

    fn legend(&self) -> Legend {
        let seen = &self.scalars;
        let frame = self.raycaster.geometry().frame();
        let transfer = self
            .surroundings
            .transfer
            .to_absolute(seen.range, frame.scale);
        if !seen.regions.is_empty() {
            return Legend::Regions {
                name: seen.name.clone(),
                regions: self.swatches(frame.scale),
            };
        }
        let colours = match self.mode {
            DisplayMode::Inside(Mode::Composite) => BarColours::Transfer {
                transfer,
                way: Some(STRIP_DEPTH * frame.scale),
            },
            DisplayMode::Inside(_) => BarColours::Grey,
            DisplayMode::Surface | DisplayMode::Skin => BarColours::Transfer {
                transfer,
                way: None,
            },
        };
        let computed = self.computed_field.as_ref().map(|shown| shown.field);
        let unit = match computed {
            Some(BodyField::Displacement) => self.surroundings.unit(),
            Some(field) => field.unit().to_owned(),
            None if seen.name == DEPTH => self.surroundings.unit(),
            None => String::new(),
        };
        Legend::Bar(ColourBar {
            name: seen.name.clone(),
            unit,
            range: seen.range,
            colours,
        })
    }

    /// The regions that can be seen, in the picture's colours; `size` is the body's extent.
    fn swatches(&self, size: f64) -> Vec<Swatch> {
        let range = self.scalars.range;
        let grey = |s: f64| {
            let share = (s - range.0) / (range.1 - range.0).max(f64::MIN_POSITIVE);
            [share.clamp(0.0, 1.0); 3]
        };
        let through = self.mode == DisplayMode::Inside(Mode::Composite);
        let looks = self
            .scalars
            .regions
            .iter()
            .zip(&self.surroundings.of_regions);
        let swatches = looks.filter_map(|((name, scalar), look)| {
            let transfer = look.as_ref()?.to_absolute(range, size);
            let seen = !through || transfer.extinction(*scalar) > 0.0;
            seen.then(|| Swatch {
                name: name.clone(),
                colour: match self.mode {
                    DisplayMode::Inside(mode) if mode != Mode::Composite => grey(*scalar),
                    _ => transfer.colour(*scalar),
                },
            })
        });
        swatches.collect()
    }

    /// The picture, as [`Stage::image`], with what the scene asks to be drawn onto it. Lengths are
    /// shown in grey then, from 0 to the longest, and X-rays as they are on film.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub fn render_annotated(&mut self) -> Result<Image> {
        let image = self.image()?;
        let mut annotations = self.annotations();
        if self.mode == DisplayMode::Inside(Mode::Xray) {
            let (mut image, white) = self.film.develop(&image);
            if annotations.legend.is_some() {
                annotations.legend = Some(Legend::Bar(ColourBar {
                    name: "∫ μ dl".into(),
                    unit: String::new(),
                    range: (0.0, f64::from(white)),
                    colours: BarColours::Grey,
                }));
            }
            if !annotations.is_empty() {
                annotations.draw(&mut image, &self.camera, self.background)?;
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
                unit: self.surroundings.unit(),
                range: (0.0, f64::from(longest)),
                colours: BarColours::Grey,
            }));
        }
        annotations.draw(&mut image, &self.camera, self.background)?;
        Ok(image)
    }

    /// Draws the picture and saves it, with the scene's background and bit depth; a PNG with what
    /// the scene asks to be drawn onto it.
    ///
    /// # Errors
    /// As [`Stage::image`] and [`Image::save_as`].
    pub fn save(&mut self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let image = match is_exr(path) {
            true => self.image()?,
            false => self.render_annotated()?,
        };
        image.save_as(path, self.background, self.bits)
    }

    /// The picture as [`Stage::save`] writes it to a PNG of eight bits: red, green, blue and opacity a
    /// pixel, row by row from the top.
    ///
    /// # Errors
    /// As [`Stage::image`].
    pub fn rgba(&mut self) -> Result<Vec<u8>> {
        Ok(self.render_annotated()?.rgba8(self.background))
    }

    /// What saves a picture that [`Stage::render_async`] asked for, as the stage is now.
    pub fn picture_writer(&self) -> PictureWriter {
        PictureWriter {
            annotations: self.annotations(),
            camera: self.camera,
            background: self.background,
            bits: self.bits,
        }
    }

    /// Adds the picture to `film`, with what the scene asks to be drawn onto it and on its
    /// background.
    ///
    /// # Errors
    /// As [`Stage::image`] and [`Animation::push`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn film(&mut self, film: &mut Animation) -> Result<()> {
        let image = self.render_annotated()?;
        film.push(&image, self.background)
    }

    /// What to say of a picture of that name that is not annotated as the scene asks.
    pub fn annotation_note(&self, path: impl AsRef<Path>) -> Option<String> {
        let said = self.mode == DisplayMode::Inside(Mode::Thickness);
        let left_out = is_exr(path.as_ref()) && !self.annotations().is_empty();
        (left_out && !said).then(|| EXR_HAS_NONE.into())
    }
}

/// Saves a picture of a stage, which may have gone on meanwhile, on any thread.
#[derive(Clone, Debug)]
pub struct PictureWriter {
    annotations: Annotations,
    camera: Camera,
    background: Background,
    bits: BitDepth,
}

impl PictureWriter {
    /// Saves `image` as [`Stage::save`] would: a PNG with what the scene asks to be drawn onto it.
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
