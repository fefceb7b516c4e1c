//! Charts of a report: one for each part and unit with rows of several sizes.

use super::page::ChartName;
use super::{PARTS, Part, Report, Row};
use crate::Result;
use crate::study::{Axis, Chart, Series, SeriesStyle};
use std::path::Path;

/// Draws the charts to the folder; returns their parts and names.
pub(super) fn draw(report: &Report, dir: &Path) -> Result<Vec<ChartName>> {
    let mut names = Vec::new();
    for part in PARTS {
        let rows: Vec<&Row> = report.rows.iter().filter(|r| r.part == part.name).collect();
        let mut units: Vec<&str> = rows.iter().map(|row| row.unit.as_str()).collect();
        units.dedup();
        units.sort_unstable();
        units.dedup();
        for unit in units {
            let rows: Vec<&Row> = rows.iter().copied().filter(|r| r.unit == unit).collect();
            if let Some(chart) = chart(part, unit, &rows) {
                let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
                let unit: String = unit.chars().map(plain).collect();
                let name = format!("{}-{unit}", part.name);
                chart.save(dir, &name)?;
                names.push((part.name.to_owned(), name));
            }
        }
    }
    Ok(names)
}

/// Returns the chart of rows with the same unit, if they have several sizes.
fn chart(part: &Part, unit: &str, rows: &[&Row]) -> Option<Chart> {
    let mut series: Vec<Series> = Vec::new();
    let mut add = |name: String, look: SeriesStyle, point: Option<[f64; 2]>| {
        let Some(point) = point else { return };
        match series.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series::new(name, look, vec![point])),
        }
    };
    for row in rows {
        let at = |value: Option<f64>| Some([row.size? as f64, value?]);
        let name = format!("{}, {}", row.what, row.on);
        add(name, SeriesStyle::LineMarks, at(row.median));
    }
    for row in rows {
        let at = |value: Option<f64>| Some([row.size? as f64, value?]);
        let name = |whose| format!("{}, {}: {whose}", row.what, row.on);
        add(name("paper"), SeriesStyle::Dashed, at(row.paper));
        add(name("reference"), SeriesStyle::Dashed, at(row.reference));
    }
    series.retain(|s| s.points.iter().any(|p| p[0] != s.points[0][0]));
    let size_unit = rows.iter().find_map(|r| r.size.map(|_| &r.size_unit))?;
    (!series.is_empty()).then(|| Chart {
        title: part.title.into(),
        x: Axis::log(size_unit),
        y: Axis::log(unit),
        series,
    })
}
