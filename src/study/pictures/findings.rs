//! Findings of the image study: Pareto fronts, charts and text.

use crate::Result;
use crate::study::pareto::pareto_front;
use crate::study::{Axis, Chart, Row, Run, Series, SeriesStyle};

/// The families, in the order of the legend.
const FAMILIES: [&str; 10] = [
    "default",
    "light",
    "planes",
    "integrals",
    "sampled reads",
    "sliced table",
    "volume table",
    "samples a tet",
    "early stop",
    "resolution",
];

/// Families that render another image than the default.
const SEPARATE_FAMILIES: [&str; 2] = ["light", "planes"];

/// Maximum error of a default, in 1/255.
const GOAL: f64 = 0.5;

fn of_picture<'a>(rows: &'a [Row], name: &str, through: &str) -> Vec<&'a Row> {
    rows.iter()
        .filter(|r| r.text("scene") == name && r.text("transfer") == through)
        .collect()
}

/// Returns the series of one image by family, the goal, and rings around the front.
fn series(points: &[(String, [f64; 2])]) -> Vec<Series> {
    let mut series: Vec<Series> = FAMILIES
        .iter()
        .map(|family| {
            let own = points.iter().filter(|p| p.0 == *family).map(|p| p.1);
            Series::new(*family, SeriesStyle::Marks, own.collect())
        })
        .collect();
    let same = points
        .iter()
        .filter(|p| !SEPARATE_FAMILIES.contains(&p.0.as_str()));
    let all: Vec<[f64; 2]> = same.map(|p| p.1).collect();
    let ends = |pick: fn(f64, f64) -> f64, from| all.iter().map(|p| p[0]).fold(from, pick);
    let (low, high) = (ends(f64::min, f64::INFINITY), ends(f64::max, 0.0));
    series.push(Series::new("front", SeriesStyle::Rings, pareto_front(&all)));
    let goal = vec![[low, GOAL], [high, GOAL]];
    series.push(Series::new("half a level", SeriesStyle::Dashed, goal));
    series
}

/// Draws the chart of one image; returns its name.
pub(super) fn chart(run: &Run, rows: &[Row], name: &str, through: &str) -> Result<String> {
    let points: Vec<(String, [f64; 2])> = of_picture(rows, name, through)
        .iter()
        .map(|r| {
            (
                r.text("family").to_owned(),
                [r.number("ms"), r.number("rmse_255")],
            )
        })
        .collect();
    let file = format!("pictures-{}-{}", name, through.replace(' ', "-"));
    let chart = Chart {
        title: format!("{name}, {through} transfer function"),
        x: Axis::linear("time a frame (ms)"),
        y: Axis::log("RMSE (1/255)"),
        series: series(&points),
    };
    chart.save(run.dir, &file)?;
    Ok(file)
}

/// Cost of a setting relative to the default, and its largest error, over all images.
struct Summary {
    row: Row,
    cost: f64,
    worst: f64,
}

fn summaries(rows: &[Row], pictures: &[(String, &'static str)]) -> Vec<Summary> {
    let pictures: Vec<Vec<&Row>> = pictures
        .iter()
        .map(|(name, through)| of_picture(rows, name, through))
        .collect();
    let key = |r: &Row| {
        let texts = ["family", "table", "texel", "light"].map(|c| r.text(c).to_owned());
        let numbers =
            ["table_size", "samples_a_tet", "opaque", "shrink"].map(|c| r.number(c).to_bits());
        (texts, numbers)
    };
    let first = pictures.first().cloned().unwrap_or_default();
    first
        .iter()
        .filter_map(|row| {
            let same: Option<Vec<(&Row, &Row)>> = pictures
                .iter()
                .map(|rows| {
                    let plain = rows.iter().find(|r| r.text("family") == "default")?;
                    let own = rows.iter().find(|r| key(r) == key(row))?;
                    Some((*own, *plain))
                })
                .collect();
            let same = same?;
            let ratio = |(own, plain): &(&Row, &Row)| (own.number("ms") / plain.number("ms")).ln();
            let cost = same.iter().map(ratio).sum::<f64>() / same.len() as f64;
            let worst = same
                .iter()
                .map(|(own, _)| own.number("rmse_255"))
                .fold(0.0, f64::max);
            Some(Summary {
                row: (*row).clone(),
                cost: cost.exp(),
                worst,
            })
        })
        .collect()
}

/// Draws the chart of all images together; returns its name.
pub(super) fn overview(
    run: &Run,
    rows: &[Row],
    pictures: &[(String, &'static str)],
) -> Result<String> {
    let points: Vec<(String, [f64; 2])> = summaries(rows, pictures)
        .iter()
        .map(|s| (s.row.text("family").to_owned(), [s.cost, s.worst]))
        .collect();
    let chart = Chart {
        title: "Worst error of all pictures against mean cost".into(),
        x: Axis::linear("time a frame (1 = default)"),
        y: Axis::log("largest RMSE (1/255)"),
        series: series(&points),
    };
    chart.save(run.dir, "pictures")?;
    Ok("pictures".into())
}

/// Describes a setting.
fn words(row: &Row) -> String {
    match row.text("family") {
        "sliced table" | "volume table" => format!(
            "{} of {} in {}s",
            row.text("family"),
            row.number("table_size"),
            row.text("texel")
        ),
        "light" => "A headlight".into(),
        "planes" => match row.text("light") {
            "none" => "Using two clip planes, a slice and an isosurface".into(),
            _ => "Using all of these with lighting".into(),
        },
        "integrals" => "integrals for any mesh".into(),
        "samples a tet" => format!("{} samples per tet", row.number("samples_a_tet")),
        "early stop" => format!("rays end at opacity {}", row.number("opaque")),
        "resolution" => format!("{} times fewer pixels per side", row.number("shrink")),
        other => other.to_owned(),
    }
}

/// Describes the error of the default for each image, and the cheapest setting within the goal.
pub(super) fn finding(rows: &[Row], pictures: &[(String, &'static str)]) -> String {
    let mut text = String::from(
        "| image | tets | table | RMSE (1/255) | 99.9th percentile (1/255) | FLIP | ms per frame | \
         cheapest within half a level |\n|---|---|---|---|---|---|---|---|",
    );
    for (name, through) in pictures {
        let own = of_picture(rows, name, through);
        let Some(plain) = own.iter().find(|r| r.text("family") == "default") else {
            continue;
        };
        let within = own.iter().filter(|r| {
            r.number("rmse_255") <= GOAL && !SEPARATE_FAMILIES.contains(&r.text("family"))
        });
        let cheapest = within.min_by(|a, b| a.number("ms").total_cmp(&b.number("ms")));
        let cheapest = cheapest.map_or("none".into(), |r| {
            format!("{} ({:.1} ms)", words(r), r.number("ms"))
        });
        text += &format!(
            "\n| {name}, {through} | {} | {} | {:.3} | {:.2} | {:.4} | {:.1} | {cheapest} |",
            plain.number("tets"),
            plain.number("table_chosen"),
            plain.number("rmse_255"),
            plain.number("p999_255"),
            plain.number("flip"),
            plain.number("ms")
        );
    }
    let (others, mut all): (Vec<Summary>, Vec<Summary>) = summaries(rows, pictures)
        .into_iter()
        .partition(|s| SEPARATE_FAMILIES.contains(&s.row.text("family")));
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    if let Some(plain) = all.iter().find(|s| s.row.text("family") == "default") {
        text += &format!(
            "\n\nWith the default settings, every image is within {:.2}/255 (RMSE) of the exact \
             ray integral.",
            plain.worst
        );
    }
    if let Some(best) = all.iter().find(|s| s.worst <= GOAL) {
        text += &format!(
            " The cheapest setting that keeps every image within half a level: {}, at {:.2} of \
             the default's time and {:.2}/255 at worst.",
            words(&best.row),
            best.cost,
            best.worst
        );
    }
    for other in &others {
        text += &format!(
            " {} costs {:.2} times the default's time, with an error of at most {:.2}/255 from its own exact image.",
            words(&other.row),
            other.cost,
            other.worst
        );
    }
    let costs = all
        .iter()
        .filter(|s| s.row.text("family") == "samples a tet");
    if let Some(samples) = costs.clone().find(|s| s.worst <= GOAL) {
        text += &format!(
            " Without pre-integration, this needs {}, at {:.1} times the default's time.",
            words(&samples.row),
            samples.cost
        );
    }
    let points: Vec<[f64; 2]> = all.iter().map(|s| [s.cost, s.worst]).collect();
    let edge: Vec<String> = pareto_front(&points)
        .iter()
        .filter_map(|p| all.iter().find(|s| [s.cost, s.worst] == *p))
        .map(|s| format!("{} ({:.2}, {:.2}/255)", words(&s.row), s.cost, s.worst))
        .collect();
    text += &format!(
        "\n\nPareto front over all images (time relative to the default, maximum error): {}.",
        edge.join("; ")
    );
    text
}
