//! Maps of the state of each cell in a plane of two settings.

use super::axis::{Axis, Scale, tick};
use super::chart::{DrawResult, Drawable, FONT, SIZE, Series, draw_label, draw_legend_entry};
use crate::Result;
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

const LEGEND: i32 = 500;
/// Light to dark, distinguishable in print too; each state but the first also has a marker.
const COLOURS: [RGBColor; 5] = [
    RGBColor(222, 238, 247),
    RGBColor(240, 228, 66),
    RGBColor(213, 94, 0),
    RGBColor(0, 70, 120),
    RGBColor(150, 150, 150),
];

/// A plane of two settings whose cells have one of a few states, with curves over it.
#[derive(Clone, Debug)]
pub struct StateMap {
    /// Title.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Horizontal positions of the cells, ascending.
    pub xs: Vec<f64>,
    /// Vertical positions of the cells, ascending.
    pub ys: Vec<f64>,
    /// The names of the states, at most five.
    pub states: Vec<String>,
    /// State of each cell, row-major: rows of `ys`, within them `xs`. An index beyond the states
    /// leaves the cell blank.
    pub cells: Vec<usize>,
    /// Curves drawn over the cells, clipped to them.
    pub curves: Vec<Series>,
}

impl StateMap {
    /// Draws the map to `NAME.svg` and `NAME.png` in `dir`.
    ///
    /// # Errors
    /// An error if a file cannot be written.
    pub fn save(&self, dir: &Path, name: &str) -> Result<()> {
        super::chart::save(dir, name, self)
    }
}

/// Returns the borders between cells: midpoints in the scale of the axis.
fn borders(axis: &Axis, places: &[f64]) -> Vec<f64> {
    let to = |v: f64| if axis.log { v.ln() } else { v };
    let from = |v: f64| if axis.log { v.exp() } else { v };
    let at: Vec<f64> = places.iter().map(|v| to(*v)).collect();
    let n = at.len();
    let outer = |a: usize, b: usize| match n {
        0 | 1 => at
            .first()
            .map_or(0.0, |v| v + if a == 0 { -0.5 } else { 0.5 }),
        _ => 1.5 * at[a] - 0.5 * at[b],
    };
    let mut borders = vec![from(match n {
        0 | 1 => at.first().map_or(0.0, |v| v - 0.5),
        _ => outer(0, 1),
    })];
    borders.extend(at.windows(2).map(|w| from(0.5 * (w[0] + w[1]))));
    borders.push(from(match n {
        0 | 1 => at.first().map_or(1.0, |v| v + 0.5),
        _ => outer(n - 1, n - 2),
    }));
    borders
}

impl Drawable for StateMap {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult<B> {
        area.fill(&WHITE)?;
        let (left, legend) = area.split_horizontally(SIZE.0 as i32 - LEGEND);
        let (xs, ys) = (borders(&self.x, &self.xs), borders(&self.y, &self.ys));
        let scale = |axis: &Axis, borders: &[f64]| Scale {
            low: borders[0],
            high: borders[borders.len() - 1],
            log: axis.log,
        };
        let (x, y) = (scale(&self.x, &xs), scale(&self.y, &ys));
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, (FONT, 44))
            .margin(24)
            .x_label_area_size(96)
            .y_label_area_size(148)
            .build_cartesian_2d(x, y)?;
        let width = self.xs.len();
        for (cell, state) in self.cells.iter().enumerate() {
            let Some(colour) = COLOURS.get(*state).filter(|_| *state < self.states.len()) else {
                continue;
            };
            let (i, j) = (cell % width, cell / width);
            let corners = [(xs[i], ys[j]), (xs[i + 1], ys[j + 1])];
            chart.draw_series([Rectangle::new(corners, colour.filled())])?;
            for stroke in mark(*state) {
                let centre = EmptyElement::at((self.xs[i], self.ys[j]));
                let line = PathElement::new(stroke.to_vec(), ink(*state).stroke_width(4));
                chart.draw_series([centre + line])?;
            }
        }
        chart
            .configure_mesh()
            .axis_style(BLACK.stroke_width(2))
            .set_all_tick_mark_size(8)
            .disable_mesh()
            .label_style((FONT, 30))
            .axis_desc_style((FONT, 34))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_label_formatter(&|v| tick(*v))
            .y_label_formatter(&|v| tick(*v))
            .draw()?;
        for (i, curve) in self.curves.iter().enumerate() {
            let inside = curve
                .points
                .iter()
                .filter(|p| x.holds(p[0]) && y.holds(p[1]));
            let points: Vec<(f64, f64)> = inside.map(|p| (p[0], p[1])).collect();
            // White beneath, so that the curve is visible on any state.
            chart.draw_series(LineSeries::new(points.clone(), WHITE.stroke_width(12)))?;
            let style = super::chart::colour(6 - i % 7).stroke_width(6);
            chart.draw_series(DashedLineSeries::new(points, 16, 10, style))?;
        }
        for (state, name) in self.states.iter().enumerate() {
            let at = (52, 120 + 52 * state as i32);
            let corners = [(at.0 - 28, at.1 - 20), (at.0 + 28, at.1 + 20)];
            let colour = COLOURS[state % COLOURS.len()];
            legend.draw(&Rectangle::new(corners, colour.filled()))?;
            legend.draw(&Rectangle::new(corners, BLACK.mix(0.4)))?;
            for stroke in mark(state) {
                let stroke = stroke.map(|p| (p.0 + at.0, p.1 + at.1));
                legend.draw(&PathElement::new(
                    stroke.to_vec(),
                    ink(state).stroke_width(4),
                ))?;
            }
            draw_label(&legend, name, at)?;
        }
        for (i, curve) in self.curves.iter().enumerate() {
            draw_legend_entry(&legend, self.states.len() + i, 6 - i % 7, curve)?;
        }
        Ok(())
    }
}

fn ink(state: usize) -> RGBColor {
    if state == 3 { WHITE } else { BLACK }
}

/// Returns the hatch strokes that identify a state without its colour.
fn mark(state: usize) -> &'static [[(i32, i32); 2]] {
    match state {
        1 => &[[(-8, 0), (8, 0)]],
        2 => &[[(-8, -8), (8, 8)], [(-8, 8), (8, -8)]],
        3 => &[[(-8, 0), (8, 0)], [(0, -8), (0, 8)]],
        4 => &[[(0, -10), (0, 10)]],
        _ => &[],
    }
}
