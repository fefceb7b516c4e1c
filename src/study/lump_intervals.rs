//! `study lump-intervals`: which lumps a stiffness map determines, by the intervals of place, size and contrast
//! that `palpate identify` is expected to give.

use super::{Axis, Cell, Row, Run, StateMap};
use crate::Result;
use crate::generate::{Lump, middle_of_lump};
use crate::identify::{ExpectedIntervals, Experiment, Unknown};
use crate::press::{MapOptions, PressMap};
use crate::scene::Scene;
use std::path::Path;

/// Standard deviations of the noise over each stiffness, per cent.
const NOISES: [f64; 3] = [1.0, 2.0, 5.0];
/// Largest halves of the intervals of place and diameter of a lump that is determined, mm.
const PLACE_ERROR: f64 = 3.0;
const DIAMETER_ERROR: f64 = 4.0;
/// Sum of squares of a lump's effect over the noise that by chance is exceeded in 1 % of maps: the quantile of
/// χ² with five unknowns.
const DETECTED: f64 = 15.09;
const STATES: [&str; 4] = [
    "place, size and contrast",
    "its place",
    "that there is one",
    "nothing",
];
const CONTRASTS: [f64; 2] = [2.0, 5.0];
const WIDE_MM: [f64; 3] = [15.0, 20.0, 25.0];
const DEEP_MM: [f64; 4] = [5.0, 10.0, 15.0, 20.0];
/// Radius and depth of the presses, m.
const RADIUS: f64 = 0.012;
const DEPTH: f64 = 0.006;

/// Column of the effect of a lump.
const EFFECT: &str = "effect_percent";

/// A map of an organ with a lump.
#[derive(Clone, Copy)]
struct LumpMap {
    organ: &'static str,
    /// Length of the sides of the map above the lump, m; without it the map covers the organ.
    side: Option<f64>,
    /// Contrasts, diameters (mm) and depths (mm) of the lumps.
    lumps: [&'static [f64]; 3],
}

/// The first map has charts. The others have lumps that it hardly determines.
const MAPS: [LumpMap; 4] = [
    LumpMap {
        organ: "breast",
        side: None,
        lumps: [&CONTRASTS, &WIDE_MM, &DEEP_MM],
    },
    LumpMap {
        organ: "breast",
        side: Some(SIDE),
        lumps: FEW,
    },
    LumpMap {
        organ: "liver",
        side: None,
        lumps: FEW,
    },
    LumpMap {
        organ: "liver",
        side: Some(SIDE),
        lumps: FEW,
    },
];
const SIDE: f64 = 0.036;
const FEW: [&[f64]; 3] = [&[5.0], &[15.0, 20.0], &[10.0, 15.0]];

/// Linear tets, and points of the map along a side.
struct Subject {
    tets: usize,
    points: u32,
}

impl LumpMap {
    /// Returns contrasts, diameters and depths; of a quick study a lump of each map.
    fn lumps(&self, quick: bool) -> Vec<[f64; 3]> {
        if quick {
            return vec![[5.0, 20.0, 10.0]];
        }
        let [contrasts, wides, deeps] = self.lumps;
        let mut lumps = Vec::new();
        for contrast in contrasts {
            for wide in wides {
                lumps.extend(deeps.iter().map(|deep| [*contrast, *wide, *deep]));
            }
        }
        lumps
    }

    /// Length of the sides, mm; 0 for the whole organ.
    fn side_mm(&self) -> f64 {
        1e3 * self.side.unwrap_or(0.0)
    }

    fn has(&self, row: &Row) -> bool {
        row.text("organ") == self.organ && row.number("side_mm") == self.side_mm()
    }

    /// Returns the organ without a lump, and a map of it whose stiffnesses do not matter.
    fn pressed(&self, subject: &Subject) -> Result<(Scene, Experiment)> {
        // The lump of the mesh is as soft as its surroundings: that of the unknowns takes its place.
        let regions = match self.organ {
            "breast" => "fat = {}\ngland = [\"gland\", \"lump\"]\nmuscle = {}",
            _ => "liver = [\"liver\", \"lump\"]",
        };
        let scene = Scene::parse(&format!(
            "[mesh]\ngenerate = \"{}\"\ntets = {}\ncontrast = 1\n\
             [material]\nmodel = \"neo-hookean\"\nstiffness_field = \"stiffness\"\norder = 1\n\
             {regions}",
            self.organ, subject.tets
        ))?;
        let options = MapOptions {
            points: [subject.points; 2],
            at: match self.side {
                Some(_) => Some(middle_of_lump(self.organ, &Lump::default())?),
                None => None,
            },
            side: self.side,
            radius: Some(RADIUS),
            depth: Some(DEPTH),
        };
        let map = PressMap::new(&scene, &options)?;
        let places: Vec<_> = map.points().iter().map(|p| (p.point, 1.0)).collect();
        let data = Experiment::map("map", (map.direction(), RADIUS, DEPTH), &places)?;
        Ok((scene, data))
    }
}

/// Measures, draws charts and reports.
pub(super) fn run(run: &Run, _: Option<&Path>) -> Result<()> {
    let subject = match run.quick {
        true => Subject {
            tets: 4_000,
            points: 5,
        },
        false => Subject {
            tets: 12_000,
            points: 8,
        },
    };
    let maps = match run.quick {
        true => &MAPS[..1],
        false => &MAPS[..],
    };
    let mut rows = Vec::new();
    for map in maps {
        rows.extend(measured(run, map, &subject)?);
    }
    let charted: Vec<Row> = rows
        .iter()
        .filter(|row| MAPS[0].has(row))
        .cloned()
        .collect();
    let mut charts = Vec::new();
    for contrast in CONTRASTS {
        for noise in NOISES {
            let Some(map) = chart(&charted, contrast, noise) else {
                continue;
            };
            let name = format!("lump-intervals-{contrast}-{noise}");
            map.save(run.dir, &name)?;
            charts.push(name);
        }
    }
    let charts: Vec<&str> = charts.iter().map(String::as_str).collect();
    let title = "Which lumps a stiffness map determines";
    run.write_findings("lump-intervals", title, &describe(&rows, &subject), &charts)
}

/// Returns the rows of a map, a lump each.
fn measured(run: &Run, map: &LumpMap, subject: &Subject) -> Result<Vec<Row>> {
    let of_noises = NOISES.iter().flat_map(|noise| {
        ["place_mm", "diameter_mm", "contrast_low"].map(|name| column(name, *noise))
    });
    let results: Vec<String> = std::iter::once(EFFECT.to_owned())
        .chain(of_noises)
        .collect();
    let results: Vec<&str> = results.iter().map(String::as_str).collect();
    let (scene, data) = map.pressed(subject)?;
    let data = [data];
    let body = ExpectedIntervals::new((run.gpu, &scene, &data), Unknown::parse("lump")?)?;
    let mut plain = None;
    let point = |lump: [f64; 3]| {
        let of: [Cell; 3] = [map.organ.into(), map.side_mm().into(), subject.tets.into()];
        [of, lump.map(Cell::from)].concat()
    };
    let points: Vec<Vec<Cell>> = map.lumps(run.quick).into_iter().map(point).collect();
    let settings = [
        "organ", "side_mm", "tets", "contrast", "lump_mm", "depth_mm",
    ];
    run.measure("lump-intervals", &settings, &results, &points, |point| {
        let lump = [3, 4, 5].map(|k: usize| point[k].number());
        intervals((map.organ, &body), &mut plain, lump)
    })
}

/// Returns by how much the lump changes the map, per cent (root of the sum of squares over the points), and for
/// each noise half of the widest interval of a coordinate and of the diameter, mm, and the lower end of the
/// contrast. `plain` is the map without a lump, once it is known.
fn intervals(
    (organ, body): (&str, &ExpectedIntervals),
    plain: &mut Option<Vec<f64>>,
    [contrast, wide, deep]: [f64; 3],
) -> Result<Vec<Cell>> {
    let lump = Lump {
        diameter: 1e-3 * wide,
        depth: 1e-3 * deep,
        contrast,
    };
    let place = middle_of_lump(organ, &lump)?;
    let values = |contrast: f64| [place.x, place.y, place.z, 1e-3 * wide, contrast];
    let plain = match plain {
        Some(plain) => plain,
        None => plain.insert(body.at(&values(1.0), &[])?.numbers),
    };
    let found = body.at(&values(contrast), &NOISES.map(|noise| 1e-2 * noise))?;
    let pairs = found.numbers.iter().zip(plain);
    let effect: f64 = pairs.map(|(own, plain)| (1.0 - *plain / own).powi(2)).sum();
    let half = |[low, high]: [f64; 2]| 500.0 * (high - low);
    let cells = found.intervals.iter().flat_map(|ends| {
        let widest = ends[..3].iter().map(|own| half(*own)).fold(0.0, f64::max);
        [widest, half(ends[3]), ends[4][0]]
    });
    Ok(std::iter::once(100.0 * effect.sqrt())
        .chain(cells)
        .map(|x| Cell::from(super::csv_table::significant(x, 4)))
        .collect())
}

fn column(name: &str, noise: f64) -> String {
    format!("{name}_{noise}")
}

/// Returns the state of a lump: index into [`STATES`].
fn state(row: &Row, noise: f64) -> usize {
    let number = |name: &str| row.number(&column(name, noise));
    let is_detected = (row.number(EFFECT) / noise).powi(2) > DETECTED;
    let is_placed = number("place_mm") <= PLACE_ERROR;
    let is_sized = number("diameter_mm") <= DIAMETER_ERROR && number("contrast_low") > 1.0;
    match (is_detected, is_placed, is_sized) {
        (true, true, true) => 0,
        (true, true, false) => 1,
        (true, false, _) => 2,
        (false, ..) => 3,
    }
}

/// Returns the chart of a contrast and noise; `None` without such lumps.
fn chart(rows: &[Row], contrast: f64, noise: f64) -> Option<StateMap> {
    let of_contrast = |row: &&Row| row.number("contrast") == contrast;
    let axis = |name: &str| {
        let mut values: Vec<f64> = rows
            .iter()
            .filter(of_contrast)
            .map(|row| row.number(name))
            .collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    };
    let [wides, deeps] = ["lump_mm", "depth_mm"].map(axis);
    if wides.is_empty() {
        return None;
    }
    let of = |wide: f64, deep: f64| {
        let lump = [contrast, wide, deep];
        let own = |r: &&Row| ["contrast", "lump_mm", "depth_mm"].map(|name| r.number(name)) == lump;
        let row = rows.iter().find(own);
        row.map_or(STATES.len(), |row| state(row, noise))
    };
    let cells = wides.iter().flat_map(|w| deeps.iter().map(|d| of(*w, *d)));
    Some(StateMap {
        title: format!("Lumps {contrast} times as stiff in a map with {noise} % noise"),
        x: Axis::linear("depth of its nearest point (mm)"),
        y: Axis::linear("diameter (mm)"),
        states: STATES.map(str::to_owned).into(),
        cells: cells.collect(),
        curves: Vec::new(),
        xs: deeps,
        ys: wides,
    })
}

/// Says how many lumps of a map are determined at each noise.
fn counted(map: &LumpMap, rows: &[Row]) -> Option<String> {
    let own: Vec<&Row> = rows.iter().filter(|row| map.has(row)).collect();
    if own.is_empty() {
        return None;
    }
    let counts = NOISES.map(|noise| {
        let count = |most: usize| own.iter().filter(|row| state(row, noise) <= most).count();
        let [sized, placed, detected] = [0, 1, 2].map(count);
        format!("at {noise} % {detected} are detected, {placed} placed and {sized} sized")
    });
    let place = match map.side {
        None => format!("the whole {}", map.organ),
        Some(side) => format!("{:.0} mm of the {} around the lump", 1e3 * side, map.organ),
    };
    Some(format!(
        "- Points over {place}: of {} lumps, {}.\n",
        own.len(),
        counts.join(", ")
    ))
}

fn describe(rows: &[Row], subject: &Subject) -> String {
    let mut text = format!(
        "A breast of fat and gland with a ball of stiffer tissue below its upper outer quadrant, and a liver with one in its right lobe, of {} linear tets, are pressed at the points of a grid of {1} × {1} with a fingertip of {2:.0} mm, {3:.0} mm deep. The intervals of 90 % that `palpate identify --unknown lump` is expected to give (Laplace's approximation at the true values, the moduli known, the errors of the mesh apart) say what each noise leaves: half of the widest interval of the place, of the diameter, and the lower end of the contrast.\n\nA lump is detected if its effect on the map (the root of the sum of its squares over the points) exceeds the noise more than chance does in 1 % of maps, placed if its place is within {PLACE_ERROR} mm, and sized if its diameter is within {DIAMETER_ERROR} mm and its contrast above 1. Where size and contrast are not determined, their joint effect is: a smaller, stiffer ball changes the map alike.\n\n",
        subject.tets,
        subject.points,
        1e3 * RADIUS,
        1e3 * DEPTH,
    );
    text.extend(MAPS.iter().filter_map(|map| counted(map, rows)));
    text += "\n| map | contrast | diameter, mm | depth, mm | effect |";
    for noise in NOISES {
        text += &format!(" noise {noise} %: place, diameter, mm; contrast above | determined |");
    }
    text += &format!(
        "\n| --- | --- | --- | --- | --- |{}",
        " --- | --- |".repeat(NOISES.len())
    );
    for row in rows {
        let [side, contrast, wide, deep, effect] =
            ["side_mm", "contrast", "lump_mm", "depth_mm", EFFECT].map(|name| row.number(name));
        let organ = row.text("organ");
        let map = match side > 0.0 {
            true => format!("{organ}, {side} mm"),
            false => organ.to_owned(),
        };
        text += &format!("\n| {map} | {contrast} | {wide} | {deep} | {effect:.1} % |");
        for noise in NOISES {
            let number = |name: &str| row.number(&column(name, noise));
            text += &format!(
                " {:.1}, {:.1}; {:.1} | {} |",
                number("place_mm"),
                number("diameter_mm"),
                number("contrast_low"),
                STATES[state(row, noise)]
            );
        }
    }
    text
}
