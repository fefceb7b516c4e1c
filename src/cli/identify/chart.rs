//! Charts of measured against predicted numbers.

use palpate::Result;
use palpate::identify::{Identified, Residual};
use palpate::number_format::rounded;
use palpate::study::{Axis, Chart, Series, SeriesStyle};
use std::path::Path;

/// Largest number of values that fit into the title.
const SHOWN_VALUES: usize = 3;

/// Draws measured and predicted forces against depth; where there are none, predicted against measured
/// numbers.
pub fn draw_chart(out: &Path, found: &Identified) -> Result<()> {
    let are_forces = |row: &&Residual| row.quantity == "force";
    let has_curve = found.residuals.iter().any(|row| are_forces(&row));
    let mut series = Vec::new();
    let mut names: Vec<&str> = found
        .residuals
        .iter()
        .map(|row| row.experiment.as_str())
        .collect();
    names.dedup();
    for (k, name) in names.iter().enumerate() {
        let own = || found.residuals.iter().filter(|row| row.experiment == *name);
        if !has_curve {
            series.push(Series::new(
                format!("experiment {}", k + 1),
                SeriesStyle::Marks,
                own().map(|row| [row.measured, row.predicted]).collect(),
            ));
            continue;
        }
        let rows = || own().filter(are_forces);
        let measured = rows()
            .map(|row| [1e3 * row.depth_m, row.measured])
            .collect();
        let predicted = rows()
            .map(|row| [1e3 * row.depth_m, row.predicted])
            .collect();
        series.push(Series::new(
            format!("measured {}", k + 1),
            SeriesStyle::Marks,
            measured,
        ));
        series.push(Series::new(
            format!("predicted {}", k + 1),
            SeriesStyle::Line,
            predicted,
        ));
    }
    if !has_curve {
        let measured = found.residuals.iter().map(|row| row.measured);
        let [low, high] = measured.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
            [low.min(x), high.max(x)]
        });
        let equal = vec![[low, low], [high, high]];
        series.push(Series::new("equal".to_owned(), SeriesStyle::Line, equal));
    }
    let values = found.unknowns.iter();
    let values: Vec<String> = values
        .map(|value| {
            let number = rounded(value.value, 4);
            format!("{} = {number} {}", value.name, value.unit)
        })
        .collect();
    let is_map = |row: &Residual| row.quantity == "stiffness";
    let [x, y] = match has_curve {
        true => ["depth, mm", "force, N"],
        false if found.residuals.iter().all(is_map) => {
            ["measured stiffness, N/m", "predicted stiffness, N/m"]
        }
        false => ["measured", "predicted"],
    };
    Chart {
        title: match values.len() {
            1..=SHOWN_VALUES => values.join(", "),
            _ => "measured and predicted numbers".to_owned(),
        },
        x: Axis::linear(x),
        y: Axis::linear(y),
        series,
    }
    .save(out, "residuals")
}
