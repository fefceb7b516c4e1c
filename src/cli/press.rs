//! `palpate press`: indents a body with a fingertip at one point or on a grid.

use super::flag_values::{Triple, triple};
use super::flags::SceneFlags;
use super::{Outcome, press_map, print_json, progress, refinement};
use clap::Args;
use glam::{DVec2, DVec3};
use palpate::accuracy::{ErrorParts, Round};
use palpate::gpu::Gpu;
use palpate::io::{PvdSeries, atomic_write};
use palpate::number_format::significant;
use palpate::physics::BodyField;
use palpate::press::{MapOptions, Press, PressOptions, PressPicture, PressReport};
use palpate::render::{Animation, Background, BitDepth, Image};
use palpate::scene::Scene;
use palpate::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Frame rate of the animation, 1/s.
const FPS: f64 = 12.0;

/// Frame rate of the film of the meshes, 1/s.
const ROUNDS_PER_SECOND: f64 = 1.0;

/// Largest width of press.gif, in pixels.
const FILM_WIDTH: u32 = 640;

/// Arguments of `press`.
#[derive(Args)]
pub struct PressArguments {
    /// Mesh file, or scene (.toml) of one body
    input: PathBuf,
    /// Write rest.png, pressed.png, press.gif, press.csv, press.json, press.svg and press.pvd to this
    /// folder; for a map map.csv, map.json and map.png
    #[arg(long, short)]
    out: PathBuf,
    /// Press on the boundary point nearest to x,y,z, in the mesh's unit [default: the point at the
    /// centre of the picture]; with --side the centre of the map [default: of the body]
    #[arg(long, value_parser = triple, allow_hyphen_values = true, conflicts_with = "pick")]
    at: Option<Triple>,
    /// Press on the boundary point visible at X,Y of the picture, in pixels from the upper left
    #[arg(long, value_name = "X,Y", value_parser = pixel)]
    pick: Option<Pixel>,
    /// Set the radius of the fingertip, in the mesh's unit [default: a fifth of the body's mean chord]
    #[arg(long)]
    radius: Option<f64>,
    /// Set the indentation depth, in the mesh's unit [default: a tenth of the local thickness]
    #[arg(long, conflicts_with = "force")]
    depth: Option<f64>,
    /// Press until the contact force reaches this value, in N, at most to half of the thickness
    #[arg(long, value_name = "NEWTON")]
    force: Option<f64>,
    /// Press on a grid of points from above instead, and write map.csv and map.png; resumes an
    /// interrupted map
    #[arg(long, value_name = "NxM", value_parser = super::flag_values::size, conflicts_with_all = ["pick", "force"])]
    map: Option<[u32; 2]>,
    /// Set the length of the sides of the map, a square around --at, in the mesh's unit [default: the map
    /// covers the body]
    #[arg(long, value_name = "LENGTH", requires = "map")]
    side: Option<f64>,
    /// Draw isolines on the cut face of pressed.png and press.gif: of displacement, or of the von Mises
    /// stress
    #[arg(long, value_name = "FIELD", value_parser = shown)]
    show: Option<BodyField>,
    /// Draw pressed.png and press.gif as rest.png, with the camera and mode of the scene
    #[arg(long, conflicts_with = "show")]
    scene_view: bool,
    /// Leave out the error estimate, which takes two to four times as long as the steps of the press
    #[arg(long)]
    no_error: bool,
    /// Also print the content of press.json or map.json on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    scene: SceneFlags,
}

fn shown(text: &str) -> std::result::Result<BodyField, String> {
    PressPicture::field(text).map_err(|e| e.to_string())
}

/// How a press is drawn.
#[derive(Clone, Copy, Debug, Default)]
pub struct PressView {
    /// Isolines on the cut face.
    pub show: Option<BodyField>,
    /// Draws with the camera and mode of the scene.
    pub scene_view: bool,
}

/// Two numbers with a comma between.
#[derive(Clone, Copy, Debug)]
struct Pixel(DVec2);

fn pixel(text: &str) -> std::result::Result<Pixel, String> {
    let wrong = || format!("expected a point X,Y in pixels, got \"{text}\"");
    let (x, y) = text.split_once(',').ok_or_else(wrong)?;
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|n| n.is_finite());
    match (number(x), number(y)) {
        (Some(x), Some(y)) => Ok(Pixel(DVec2::new(x, y))),
        _ => Err(wrong()),
    }
}

/// Presses, renders, and writes the measurements.
pub fn run(gpu: &Gpu, arguments: &PressArguments) -> anyhow::Result<Outcome> {
    let out = &arguments.out;
    let scene = arguments.scene.scene(&arguments.input)?;
    if arguments.scene.accuracy.within.of.is_some() {
        anyhow::bail!("a press is refined for its largest force; remove --of");
    }
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    if let Some(points) = arguments.map {
        let wanted = MapOptions {
            points,
            at: arguments.at.map(|t| DVec3::from(t.0)),
            side: arguments.side,
            radius: arguments.radius,
            depth: arguments.depth,
        };
        let report = press_map::run(gpu, &scene, &wanted, (out, !arguments.no_error))?;
        if arguments.json {
            print_json(&report)?;
        }
        press_map::check(&report)?;
        return Ok(Outcome::Done);
    }
    let wanted = PressOptions {
        at: arguments.at.map(|t| DVec3::from(t.0)),
        pick: arguments.pick.map(|p| p.0),
        radius: arguments.radius,
        depth: arguments.depth,
        force: arguments.force,
    };
    let view = PressView {
        show: arguments.show,
        scene_view: arguments.scene_view,
    };
    let report = press(gpu, (&scene, view), &wanted, (out, !arguments.no_error))?;
    if arguments.json {
        print_json(&report)?;
    }
    check(&report)?;
    Ok(Outcome::Done)
}

/// Fails if the largest force is not as exact as wanted.
pub fn check(report: &PressReport) -> anyhow::Result<()> {
    match &report.missed {
        Some(why) => {
            anyhow::bail!("the largest force is not as exact as wanted (--within): {why}")
        }
        None => Ok(()),
    }
}

/// Presses on the body of `scene` and writes images, an animation, a series and the measurements to
/// `out`, which exists; with an estimate of their errors if asked for. Long because it writes each output of a press in turn.
pub fn press(
    gpu: &Gpu,
    (scene, view): (&Scene, PressView),
    wanted: &PressOptions,
    (out, with_errors): (&Path, bool),
) -> anyhow::Result<PressReport> {
    let mut press = match scene.accuracy.within {
        Some(_) => refined_press(gpu, (scene, wanted), out)?,
        None => progress::with_message("preparing", || Press::new(gpu, scene, wanted))?,
    };
    super::print_notes(press.notes());
    let spot = *press.site();
    super::print_notes(&[format!(
        "pressing at {}, {}, {} (local thickness {}) with a fingertip of radius {}",
        significant(spot.point.x),
        significant(spot.point.y),
        significant(spot.point.z),
        significant(spot.thickness),
        significant(press.radius())
    )]);
    press.stage().save(out.join("rest.png"))?;
    if view.scene_view {
        press.clip_at_press()?;
    }
    // Removes the picture of an earlier press.
    match std::fs::remove_file(out.join("pressed.png")) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(out)(e).into()),
        _ => {}
    }
    let mut series = PvdSeries::create(out, "press")?;
    let film_size = view.film_size(press.stage().size());
    let mut film = Animation::create(out.join("press.gif"), film_size, FPS)?;
    let mut seconds = 0.0;
    press.stage().write_frame(&mut series)?;
    push_frame(&mut press, view, &mut film)?;
    let steps = u64::from(press.steps());
    let ended = progress::with_bar("pressing", steps, |bar| -> Result<Option<Error>> {
        loop {
            let start = Instant::now();
            let sample = match press.advance() {
                Ok(sample) => sample,
                // The measurements up to then are kept.
                Err(why) => return Ok(Some(why)),
            };
            seconds += start.elapsed().as_secs_f64();
            let Some(sample) = sample else {
                return Ok(None);
            };
            press.stage().write_frame(&mut series)?;
            push_frame(&mut press, view, &mut film)?;
            if press.at_max_depth() {
                save_pressed(&mut press, view, out)?;
            }
            bar.detail(format!("{} N", significant(sample.force_n)));
            bar.inc(1);
        }
    })?;
    film.finish()?;
    if with_errors && ended.is_none() {
        progress::with_stages(|progress| press.estimate_error(progress))?;
    }
    if press.has_error() {
        // Again, with the error of the force.
        save_pressed(&mut press, view, out)?;
    }
    save_error(out, &mut press)?;
    let report = press.report(seconds);
    write_samples(&out.join("press.csv"), &press)?;
    atomic_write(out.join("press.json"), |file| {
        let text = serde_json::to_string_pretty(&report);
        let text = text.map_err(|e| Error::Input(format!("press.json: {e}")))?;
        writeln!(file, "{text}").map_err(Error::io(out))
    })?;
    draw_chart(out, &press, &report)?;
    if let Some(why) = ended {
        anyhow::bail!(
            "the press failed at a depth of {} mm: {why}; the measurements so far are in {}",
            significant(1e3 * report.max_depth_m),
            out.display()
        );
    }
    if press.force_not_reached() {
        super::print_notes(&[
            "the force was not reached within half of the thickness; the fingertip was withdrawn there"
                .into(),
        ]);
    }
    if let Some(depth) = press.inversion_depth() {
        super::print_notes(&[format!(
            "tets would be inverted deeper than {} mm, so the press ended there and its stiffness is that of smaller depths; use a finer mesh, a larger --radius or a smaller --depth",
            significant(1e3 * depth)
        )]);
    }
    super::print_notes(&report.warnings);
    print_result(out, &report, seconds);
    Ok(report)
}

impl PressView {
    /// Returns the size of press.gif for pictures of `size`.
    fn film_size(self, size: [u32; 2]) -> [u32; 2] {
        let shrink = (f64::from(FILM_WIDTH) / f64::from(size[0].max(1))).min(1.0);
        match self.scene_view {
            true => size,
            false => size.map(|n| ((shrink * f64::from(n)).round() as u32).max(1)),
        }
    }
}

/// Adds the present state of the press to `film`.
fn push_frame(press: &mut Press, view: PressView, film: &mut Animation) -> Result<()> {
    let background = press.stage().picture_background();
    let image = match view.scene_view {
        true => press.stage().image()?,
        false => {
            let size = view.film_size(press.stage().size());
            press.keep_picture(view.show)?;
            press.picture(size)?
        }
    };
    film.push(&image, background)
}

/// Writes the picture of the press at its largest depth; one with the camera of the scene shows the
/// present state.
fn save_pressed(press: &mut Press, view: PressView, out: &Path) -> Result<()> {
    let path = out.join("pressed.png");
    if view.scene_view {
        return match press.at_max_depth() {
            true => press.stage().save(path),
            false => Ok(()),
        };
    }
    let (size, background) = (press.stage().size(), press.stage().picture_background());
    let image = press.deepest_picture(size)?;
    image.save_as(path, background, BitDepth::default())
}

/// Refines the body for a press, and prints and draws each mesh on the way.
fn refined_press(
    gpu: &Gpu,
    (scene, wanted): (&Scene, &PressOptions),
    out: &Path,
) -> anyhow::Result<Press> {
    let mut pictures = Vec::new();
    let mut on_round = |round: &Round, draw: &mut dyn FnMut() -> Result<Image>| -> Result<()> {
        super::print_notes(&[refinement::in_words(round, ("force", "N"))]);
        pictures.push(draw()?);
        Ok(())
    };
    let press = progress::with_stages(|progress| {
        Press::refined(gpu, (scene, wanted), &mut on_round, progress)
    })?;
    if let Some(first) = pictures.first() {
        let mut film =
            Animation::create(out.join("refinement.gif"), first.size, ROUNDS_PER_SECOND)?;
        for picture in &pictures {
            film.push(picture, Background::Gradient)?;
        }
        film.finish()?;
    }
    Ok(press)
}

/// Writes a picture and a mesh of the places where the mesh is too coarse, if the error is known.
fn save_error(out: &Path, press: &mut Press) -> Result<()> {
    let Some(mesh) = press.error_mesh()? else {
        return Ok(());
    };
    super::print_notes(&palpate::io::write(out.join("error.vtu"), &mesh)?);
    match press.error_image()? {
        Some(image) => image.save(out.join("error.png")),
        None => Ok(()),
    }
}

/// Prints the measurements with their errors, and the names of the files.
fn print_result(out: &Path, report: &PressReport, seconds: f64) {
    let errors = report.error_parts.as_ref();
    let stiffness = match (report.stiffness_n_per_m, report.hertz_young_pa) {
        (Some(stiffness), Some(young)) => format!(
            "stiffness {}; Hertz half-space Young's modulus {}",
            measured(stiffness, errors.map(|e| &e.stiffness_n_per_m), "N/m"),
            measured(young, errors.map(|e| &e.hertz_young_pa), "Pa")
        ),
        _ => "no stiffness, because the press is not valid (above)".into(),
    };
    let force = measured(report.max_force_n, errors.map(|e| &e.max_force_n), "N");
    let parts = errors.map(|e| format!(" ({})", e.max_force_n.in_words()));
    super::print_notes(&[
        format!(
            "{force}{} at {} mm; {stiffness}; {seconds:.1} s",
            parts.unwrap_or_default(),
            significant(1e3 * report.max_depth_m)
        ),
        format!(
            "wrote {0}/rest.png, {0}/pressed.png, {0}/press.gif, {0}/press.csv, {0}/press.svg, {0}/press.json, and {0}/press.pvd for ParaView{1}",
            out.display(),
            match errors {
                Some(_) => "; error.png and error.vtu show where the mesh is too coarse",
                None => "",
            }
        ),
    ]);
    if let Some(why) = &report.no_error_because {
        super::print_notes(&[format!("no error estimate: {why}")]);
    }
}

/// Formats a measurement with its error, if it is known.
fn measured(x: f64, error: Option<&ErrorParts>, unit: &str) -> String {
    match error {
        Some(error) => error.around(x, unit),
        None => format!("{} {unit}", significant(x)),
    }
}

/// Writes the curve; the last column is empty without an error estimate.
fn write_samples(path: &Path, press: &Press) -> Result<()> {
    atomic_write(path, |file| {
        let mut text = String::from("time_s,phase,depth_m,force_n,force_error_n\n");
        for s in press.samples() {
            let error = press.force_error(s).map(|error| error.to_string());
            text += &format!(
                "{},{},{},{},{}\n",
                s.time_s,
                s.phase,
                s.depth_m,
                s.force_n,
                error.unwrap_or_default()
            );
        }
        file.write_all(text.as_bytes()).map_err(Error::io(path))
    })
}

/// Draws force against depth with its error, and the Hertz solution.
#[cfg(feature = "study")]
fn draw_chart(out: &Path, press: &Press, report: &PressReport) -> Result<()> {
    use palpate::study::{Axis, Chart, Series, SeriesStyle};
    let samples = press.samples();
    let of = |phase: &str| {
        let own = samples.iter().filter(|s| s.phase == phase);
        let points = own.map(|s| [1e3 * s.depth_m, s.force_n]);
        points.collect::<Vec<_>>()
    };
    let conditions = &report.conditions;
    let errors = report.error_parts.as_ref();
    let over = 1.0 - conditions.poisson * conditions.poisson;
    let hertz = report.hertz_young_pa.map(|young| {
        let of = |k: u32| {
            let depth = report.max_depth_m * f64::from(k) / 40.0;
            let force = 4.0 / 3.0 * young / over * conditions.radius_m.sqrt() * depth.powf(1.5);
            [1e3 * depth, force]
        };
        Series::new(
            format!(
                "Hertz, {}",
                measured(young, errors.map(|e| &e.hertz_young_pa), "Pa")
            ),
            SeriesStyle::Dashed,
            (0..=40).map(of).collect(),
        )
    });
    let chart = Chart {
        title: "Force against depth".into(),
        x: Axis::linear("depth, mm"),
        y: Axis::linear("force, N"),
        series: [
            Series::new("loading", SeriesStyle::LineMarks, of("load")),
            Series::new("unloading", SeriesStyle::LineMarks, of("unload")),
        ]
        .into_iter()
        .chain(hertz)
        .chain(error_band(press))
        .collect(),
    };
    chart.save(out, "press")
}

/// Returns the band of the error around the loading curve, if the error is known.
#[cfg(feature = "study")]
fn error_band(press: &Press) -> Option<palpate::study::Series> {
    let load = press.samples().iter();
    let load = load.filter(|s| s.phase == "load" && s.depth_m >= 0.0);
    let errors: Option<Vec<_>> = load.map(|s| Some((s, press.force_error(s)?))).collect();
    let errors = errors?;
    let at = |sign: f64| {
        let points = errors.iter();
        points.map(move |(s, error)| [1e3 * s.depth_m, s.force_n + sign * error])
    };
    let outline = at(1.0).chain(at(-1.0).rev()).collect();
    let style = palpate::study::SeriesStyle::Band;
    Some(palpate::study::Series::new("error", style, outline))
}

/// Charts need the feature `study`.
#[cfg(not(feature = "study"))]
fn draw_chart(_: &Path, _: &Press, _: &PressReport) -> Result<()> {
    Ok(())
}
