//! The image study: error against the exact ray integral and time per frame, over the settings of
//! the raycaster.

mod findings;
mod subject;

use super::{Cell, Run};
use crate::Result;
use crate::gpu::Gpu;
use crate::render::{
    Camera, Image, ImageDifference, Light, MeshAccess, Mode, RaycastOptions, Raycaster, Sections,
    TableKind, TableTexel, Target,
};
use crate::scene::median_ms;
use findings::{chart, finding, overview};
use std::path::Path;
use subject::{StudyBody, TRANSFERS};

/// One setting of the sweep.
#[derive(Clone, Copy, Debug)]
struct Setting {
    /// The varied quantity; settings of one family form one series of the chart.
    family: &'static str,
    options: RaycastOptions,
    /// Factor by which width and height are reduced for rendering; the image is then enlarged.
    shrink: f64,
    /// Whether planes and isosurfaces are drawn too.
    planes: bool,
}

/// Columns that identify a point.
const SETTINGS: [&str; 13] = [
    "scene",
    "transfer",
    "pixels",
    "family",
    "table",
    "table_size",
    "texel",
    "samples_a_tet",
    "opaque",
    "shrink",
    "reads",
    "light",
    "planes",
];
/// Columns of results: differences in 1/255, FLIP from 0 to 1.
const RESULTS: [&str; 6] = ["tets", "table_chosen", "rmse_255", "p999_255", "flip", "ms"];

/// Returns the settings of the sweep. Long because it lists them family by family.
fn settings(quick: bool) -> Vec<Setting> {
    let plain = RaycastOptions::default();
    let of = |family, options| Setting {
        family,
        options,
        shrink: 1.0,
        planes: false,
    };
    let mut all = vec![of("default", plain)];
    let lit = RaycastOptions {
        light: Light::Head,
        ..plain
    };
    all.push(of("light", lit));
    for options in [plain, lit] {
        all.push(Setting {
            planes: true,
            ..of("planes", options)
        });
    }
    let integrals = RaycastOptions {
        table: TableKind::Integrals,
        ..plain
    };
    all.push(of("integrals", integrals));
    all.push(of(
        "sampled reads",
        RaycastOptions {
            reads: MeshAccess::Sampled,
            ..plain
        },
    ));
    let sizes: &[u32] = if quick {
        &[32, 128]
    } else {
        &[32, 64, 128, 256]
    };
    let texels: &[TableTexel] = match quick {
        true => &[TableTexel::Half],
        false => &[TableTexel::Half, TableTexel::Byte, TableTexel::Single],
    };
    for size in sizes {
        for texel in texels {
            all.push(of(
                "sliced table",
                RaycastOptions {
                    table: TableKind::Sliced,
                    table_size: Some(*size),
                    texel: *texel,
                    ..plain
                },
            ));
        }
    }
    for size in sizes {
        all.push(of(
            "volume table",
            RaycastOptions {
                table: TableKind::Volume,
                table_size: Some(*size),
                ..plain
            },
        ));
    }
    let samples: &[u32] = if quick {
        &[1, 8]
    } else {
        &[1, 2, 4, 8, 16, 32, 64]
    };
    for samples in samples {
        all.push(of(
            "samples a tet",
            RaycastOptions {
                table: TableKind::Samples(*samples),
                ..plain
            },
        ));
    }
    let stops: &[f64] = match quick {
        true => &[0.95, 1.0],
        false => &[0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0],
    };
    for opaque in stops {
        all.push(of(
            "early stop",
            RaycastOptions {
                opacity_cutoff: *opaque,
                ..plain
            },
        ));
    }
    let shrinks: &[f64] = if quick {
        &[2.0]
    } else {
        &[1.25, 1.5, 2.0, 4.0]
    };
    for shrink in shrinks {
        all.push(Setting {
            shrink: *shrink,
            ..of("resolution", plain)
        });
    }
    all
}

fn table_name(table: TableKind) -> &'static str {
    match table {
        TableKind::Auto => "fitting",
        TableKind::Integrals => "integrals",
        TableKind::Sliced => "sliced",
        TableKind::Volume => "volume",
        TableKind::Samples(_) => "none",
    }
}

impl Setting {
    /// Returns its cells, after those of the subject.
    fn cells(&self) -> Vec<Cell> {
        let options = &self.options;
        let size = options
            .table_size
            .map_or("chosen".into(), |n| Cell::from(n as usize));
        let texel = match options.texel {
            TableTexel::Byte => "byte",
            TableTexel::Half => "half",
            TableTexel::Single => "single",
        };
        let samples = match options.table {
            TableKind::Samples(n) => n as usize,
            _ => 0,
        };
        vec![
            self.family.into(),
            table_name(options.table).into(),
            size,
            texel.into(),
            samples.into(),
            options.opacity_cutoff.into(),
            self.shrink.into(),
            match options.reads {
                MeshAccess::Auto => "by adapter",
                MeshAccess::Stored => "stored",
                MeshAccess::Sampled => "sampled",
            }
            .into(),
            if options.light.is_on() {
                "head"
            } else {
                "none"
            }
            .into(),
            if self.planes { "all" } else { "none" }.into(),
        ]
    }
}

/// A subject with its raycaster and reference images, kept while its points are measured.
struct Prepared {
    name: String,
    through: String,
    subject: StudyBody,
    caster: Raycaster,
    size: [u32; 2],
    /// Reference images by (planes, light).
    truths: Vec<((bool, bool), Image)>,
}

impl Prepared {
    /// Returns the reference image for `setting`.
    fn truth(&mut self, setting: &Setting) -> &Image {
        let key = (setting.planes, setting.options.light.is_on());
        let at = match self.truths.iter().position(|t| t.0 == key) {
            Some(at) => at,
            None => {
                let subject = &self.subject;
                let truth = subject.reference_image(&self.caster, self.size, setting.options.light);
                self.truths.push((key, truth));
                self.truths.len() - 1
            }
        };
        &self.truths[at].1
    }
}

/// Measures error and time of images over the raycaster's settings, for the five bodies of the
/// study or for one scene.
///
/// # Errors
/// An error if a file cannot be read or written, or the device fails.
pub fn run(run: &Run, scene: Option<&Path>) -> Result<()> {
    let side = if run.quick { 64 } else { 256 };
    let pictures = subjects(run, scene);
    let settings = settings(run.quick);
    let points: Vec<Vec<Cell>> = pictures
        .iter()
        .flat_map(|(name, through)| {
            settings.iter().map(move |setting| {
                let mut cells = vec![
                    Cell::from(name.as_str()),
                    Cell::from(*through),
                    Cell::from(side as usize),
                ];
                cells.extend(setting.cells());
                cells
            })
        })
        .collect();
    let mut prepared: Option<Prepared> = None;
    let rows = run.measure("pictures", &SETTINGS, &RESULTS, &points, |point| {
        let (name, through) = (point[0].text(), point[1].text());
        let at = points.iter().position(|p| p == point).unwrap_or(0);
        let setting = &settings[at % settings.len()];
        if !prepared
            .as_ref()
            .is_some_and(|p| p.name == name && p.through == through)
        {
            prepared = Some(prepare(run.gpu, name, through, scene, side)?);
        }
        match &mut prepared {
            Some(prepared) => measure(run, prepared, setting),
            None => Ok(Vec::new()),
        }
    })?;
    let mut charts = vec![overview(run, &rows, &pictures)?];
    for (name, through) in &pictures {
        charts.push(chart(run, &rows, name, through)?);
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    run.write_findings(
        "pictures",
        "Images: error against time",
        &finding(&rows, &pictures),
        &charts,
    )
}

/// Returns the subjects: names and transfer functions.
fn subjects(run: &Run, scene: Option<&Path>) -> Vec<(String, &'static str)> {
    if let Some(path) = scene {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        return vec![(name.into_owned(), "its own")];
    }
    let names = subject::names(run.quick);
    let pairs = names
        .iter()
        .flat_map(|name| TRANSFERS.map(|t| ((*name).to_owned(), t)));
    pairs.collect()
}

fn prepare(
    gpu: &Gpu,
    name: &str,
    through: &str,
    scene: Option<&Path>,
    side: u32,
) -> Result<Prepared> {
    let subject = match scene {
        Some(path) => StudyBody::of_scene(gpu, path)?,
        None => StudyBody::new(name, through)?,
    };
    let caster = subject.raycaster(gpu)?;
    Ok(Prepared {
        name: name.to_owned(),
        through: through.to_owned(),
        subject,
        caster,
        size: [side, side],
        truths: Vec::new(),
    })
}

/// Renders with one setting and compares the image with the reference.
fn measure(run: &Run, prepared: &mut Prepared, setting: &Setting) -> Result<Vec<Cell>> {
    let size = prepared.size;
    let drawn = size.map(|n| (f64::from(n) / setting.shrink).round() as u32);
    let caster = &mut prepared.caster;
    caster.set_options(setting.options)?;
    caster.set_sections(&match setting.planes {
        true => prepared.subject.inside(),
        false => Sections::default(),
    })?;
    let camera = *prepared.subject.camera();
    let picture = caster
        .image(&camera, drawn, Mode::Composite)?
        .upscaled(size);
    let apart = ImageDifference::between(prepared.truth(setting), &picture)?;
    let caster = &mut prepared.caster;
    let frames = if run.quick { 1 } else { 5 };
    let ms = frame_ms(run.gpu, caster, &camera, drawn, frames)?;
    Ok(vec![
        prepared.subject.tets().into(),
        (caster.table_size() as usize).into(),
        (255.0 * apart.rmse).into(),
        (255.0 * apart.percentile_999).into(),
        apart.flip.unwrap_or(f64::NAN).into(),
        ms.into(),
    ])
}

/// Returns the median time of a frame that is rendered completely, ms.
pub(super) fn frame_ms(
    gpu: &Gpu,
    caster: &mut Raycaster,
    camera: &Camera,
    size: [u32; 2],
    frames: u32,
) -> Result<f64> {
    let view = gpu.target(
        "measured picture",
        size,
        wgpu::TextureFormat::Rgba8Unorm,
        wgpu::TextureUsages::RENDER_ATTACHMENT,
    )?;
    let target = Target {
        colour: &view,
        depth: None,
        background: Some([0.0, 0.0, 0.0, 1.0]),
    };
    median_ms(frames, || {
        let mut work = gpu.start_recording();
        caster.geometry().positions().mark_written();
        caster.record(&mut work, camera, Mode::Composite, &target)?;
        work.submit()?;
        gpu.wait()
    })
}
