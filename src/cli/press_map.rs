//! `palpate press --map`: indents a body at the points of a grid.

use super::{print_notes, progress};
use palpate::accuracy::ErrorParts;
use palpate::gpu::Gpu;
use palpate::io::atomic_write;
use palpate::number_format::significant;
use palpate::press::{MapOptions, PointResult, PressMap};
use palpate::scene::Scene;
use palpate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// Content of map.json.
#[derive(Serialize, Deserialize)]
pub struct MapMetadata {
    /// Number of points along the two sides.
    grid: [u32; 2],
    /// Radius of the fingertip and depth, in file units.
    radius: f64,
    depth: f64,
    /// Unit vector along which the fingertip advances.
    #[serde(default)]
    direction: [f64; 3],
    /// Metres per file unit.
    #[serde(default)]
    length_unit_m: f64,
    /// Numbers of requested points, of completed points, and of points at which a step failed.
    points: usize,
    pressed: usize,
    failed: usize,
    median_n_per_m: Option<f64>,
    stiffest_n_per_m: Option<f64>,
    /// Estimated errors of the two stiffnesses.
    #[serde(default)]
    median_error_n_per_m: Option<f64>,
    #[serde(default)]
    stiffest_error_n_per_m: Option<f64>,
    /// Largest error that each stiffness may have, relative to it, and the number of those that have a
    /// larger one, if the mesh was refined for each point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    within: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    missed: Option<usize>,
    stiffest_at: Option<[f64; 3]>,
    /// Fingerprint of the body, scene and settings of the map.
    mark: String,
}

/// Presses the remaining points of the map, draws it, and prints stiff spots; returns the content
/// of map.json.
pub fn run(
    gpu: &Gpu,
    scene: &Scene,
    wanted: &MapOptions,
    (out, with_errors): (&Path, bool),
) -> anyhow::Result<MapMetadata> {
    let mut map = progress::with_message("preparing", || PressMap::new(scene, wanted))?;
    let is_refined = scene.accuracy.within.is_some();
    print_notes(map.notes());
    let rows = out.join("map.csv");
    let about = out.join("map.json");
    if let Some(found) = previous_results(&map, &rows, &about)? {
        let done = found.iter().flatten().count();
        map.restore(&found)?;
        print_notes(&[format!(
            "resuming {} with {done} completed points",
            rows.display()
        )]);
    }
    let left = map.points().iter().filter(|p| p.pressed.is_none()).count();
    // Written first, so that rows always have their metadata.
    write_metadata(&map, (wanted, scene.accuracy.within), &about)?;
    progress::with_bar("pressing", left as u64, |bar| {
        map.measure(gpu, &mut |map| {
            bar.inc(1);
            write_rows((map, is_refined), &rows)
        })
    })?;
    write_rows((&map, is_refined), &rows)?;
    if with_errors {
        progress::with_stages(|progress| map.estimate_errors(gpu, progress))?;
    }
    let report = write_metadata(&map, (wanted, scene.accuracy.within), &about)?;
    let image = map.image(gpu)?;
    image.save(out.join("map.png"))?;
    let failed = failed(&map);
    if failed > 0 {
        print_notes(&[format!(
            "{failed} points have no stiffness (nan): a step failed, or the body snapped or slipped away from the fingertip; try a smaller --depth or a larger --radius"
        )]);
    }
    print_notes(&stiffest_note(&map).into_iter().collect::<Vec<_>>());
    print_notes(&[format!(
        "wrote {0}/map.csv, {0}/map.png, {0}/map.json",
        out.display()
    )]);
    Ok(report)
}

/// Fails if a stiffness is not as exact as wanted.
pub fn check(report: &MapMetadata) -> anyhow::Result<()> {
    match report.missed {
        Some(missed) if missed > 0 => anyhow::bail!(
            "{missed} of {} stiffnesses are not as exact as wanted (--within); map.csv has their errors; allow more elements (--max-tets), or a larger error",
            report.pressed
        ),
        _ => Ok(()),
    }
}

/// Returns the largest and the median stiffness in words, if points were measured.
fn stiffest_note(map: &PressMap) -> Option<String> {
    let (median, top) = (map.median()?, map.stiffest()?);
    let stiffness = top.stiffness()?;
    let with_error = |x: f64, error: Option<ErrorParts>| match error {
        Some(error) => error.around(x, "N/m"),
        None => format!("{} N/m", significant(x)),
    };
    Some(format!(
        "stiffest of {} points: {}, {:.2} times the median of {}, at {}, {}, {}",
        map.points().len(),
        with_error(stiffness, map.stiffest_error()),
        stiffness / median,
        with_error(median, map.median_error()),
        significant(top.point.x),
        significant(top.point.y),
        significant(top.point.z)
    ))
}

fn failed(map: &PressMap) -> usize {
    let failed = |p: &&palpate::press::MapPoint| p.pressed == Some(PointResult::Failed);
    map.points().iter().filter(failed).count()
}

/// Returns the results of an interrupted map of the same body and settings, if there is one.
fn previous_results(
    map: &PressMap,
    rows: &Path,
    about: &Path,
) -> anyhow::Result<Option<Vec<Option<PointResult>>>> {
    if !rows.exists() {
        return Ok(None);
    }
    let metadata = std::fs::read_to_string(about).ok();
    let metadata = metadata.and_then(|text| serde_json::from_str::<MapMetadata>(&text).ok());
    if metadata.is_none_or(|metadata| metadata.mark != fingerprint(map)) {
        anyhow::bail!(
            "{} is a map of a different body or of different settings; choose another folder (--out), or remove it",
            rows.display()
        );
    }
    let text = std::fs::read_to_string(rows).map_err(Error::io(rows))?;
    let wrong = |line: usize| {
        anyhow::anyhow!(
            "{}, line {}: expected x,y,z,stiffness; remove the file to start again",
            rows.display(),
            line + 1
        )
    };
    let mut found = vec![None; map.points().len()];
    for (number, line) in text.lines().enumerate().skip(1) {
        let cells: Vec<f64> = line
            .split(',')
            .map_while(|cell| cell.parse().ok())
            .collect();
        let (x, y, z, n_per_m, error) = match cells[..] {
            [x, y, z, stiffness] => (x, y, z, stiffness, None),
            [x, y, z, stiffness, error] => (x, y, z, stiffness, Some(error)),
            _ => return Err(wrong(number)),
        };
        let own = map
            .points()
            .iter()
            .position(|p| p.point.to_array() == [x, y, z]);
        let k = own.ok_or_else(|| wrong(number))?;
        found[k] = Some(match n_per_m.is_finite() {
            true => PointResult::Stiffness { n_per_m, error },
            false => PointResult::Failed,
        });
    }
    Ok(Some(found))
}

fn fingerprint(map: &PressMap) -> String {
    format!("{:016x}", map.fingerprint())
}

/// Writes the results; those on refined meshes with their errors.
fn write_rows((map, is_refined): (&PressMap, bool), path: &Path) -> Result<()> {
    atomic_write(path, |file| {
        let mut text = String::from(match is_refined {
            true => "x,y,z,stiffness,error\n",
            false => "x,y,z,stiffness\n",
        });
        for p in map.points() {
            let (stiffness, error) = match p.pressed {
                None => continue,
                Some(PointResult::Stiffness { n_per_m, error }) => (n_per_m, error),
                Some(PointResult::Failed) => (f64::NAN, None),
            };
            let [x, y, z] = p.point.to_array();
            let stiffness = stiffness.to_string().to_lowercase();
            text += &format!("{x},{y},{z},{stiffness}");
            if is_refined {
                text.push(',');
                text += &error.map(|error| error.to_string()).unwrap_or_default();
            }
            text.push('\n');
        }
        file.write_all(text.as_bytes()).map_err(Error::io(path))
    })
}

fn write_metadata(
    map: &PressMap,
    (wanted, within): (&MapOptions, Option<f64>),
    path: &Path,
) -> Result<MapMetadata> {
    let [radius, depth] = map.radius_and_depth();
    let top = map.stiffest();
    let metadata = MapMetadata {
        grid: wanted.points,
        radius,
        depth,
        direction: map.direction().to_array(),
        length_unit_m: map.length_unit(),
        points: map.points().len(),
        pressed: map
            .points()
            .iter()
            .filter(|p| p.stiffness().is_some())
            .count(),
        failed: failed(map),
        median_n_per_m: map.median(),
        stiffest_n_per_m: top.and_then(|p| p.stiffness()),
        median_error_n_per_m: map.median_error().map(|parts| parts.total()),
        stiffest_error_n_per_m: map.stiffest_error().map(|parts| parts.total()),
        within,
        missed: within.map(|_| map.missed()),
        stiffest_at: top.map(|p| p.point.to_array()),
        mark: fingerprint(map),
    };
    atomic_write(path, |file| {
        let text = serde_json::to_string_pretty(&metadata);
        let text = text.map_err(|e| Error::Input(format!("map.json: {e}")))?;
        writeln!(file, "{text}").map_err(Error::io(path))
    })?;
    Ok(metadata)
}
