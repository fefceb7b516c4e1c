//! Charts of lines and markers, readable in print and with colour blindness.

use super::axis::Axis;
use crate::render::Image;
use crate::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::FontStyle;
use std::path::Path;
use std::sync::Once;

/// Size of a chart in pixels, including the legend; sufficient for print.
pub(super) const SIZE: (u32, u32) = (2000, 1200);
/// The width of the legend, next to the data.
const LEGEND: i32 = 500;
pub(super) const FONT: &str = "sans-serif";
/// The Okabe-Ito palette, distinguishable with colour blindness, without the yellow.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeriesStyle {
    /// A line.
    Line,
    /// A dashed line: theory, or a guide.
    Dashed,
    /// A mark at each point.
    Marks,
    /// Marks joined by a line.
    LineMarks,
    /// A ring around each point, to highlight it.
    Rings,
    /// The area within the points, translucent: an error.
    Band,
}

/// A data series.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Points in the units of the axes; those that an axis cannot show are omitted.
    pub points: Vec<[f64; 2]>,
    /// How it is drawn.
    pub look: SeriesStyle,
}

impl Series {
    /// A series.
    pub fn new(name: impl Into<String>, look: SeriesStyle, points: Vec<[f64; 2]>) -> Series {
        Series {
            name: name.into(),
            points,
            look,
        }
    }
}

/// Series over two axes.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Title.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series in legend order.
    pub series: Vec<Series>,
}

impl Chart {
    /// Draws the chart to `NAME.svg` and `NAME.png` in `dir`.
    ///
    /// # Errors
    /// An error if a file cannot be written.
    pub fn save(&self, dir: &Path, name: &str) -> Result<()> {
        save(dir, name, self)
    }
}

/// A figure that can be drawn as SVG and as PNG.
pub(super) trait Drawable {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult<B>;
}

/// Result of drawing.
pub(super) type DrawResult<B> =
    std::result::Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Draws `figure` to `NAME.svg` and `NAME.png`.
pub(super) fn save(dir: &Path, name: &str, figure: &impl Drawable) -> Result<()> {
    static FONTS: Once = Once::new();
    FONTS.call_once(|| {
        // The fonts are embedded; without registration a chart has no text and drawing fails.
        let styles = [
            (FontStyle::Normal, notosans::REGULAR_TTF),
            (FontStyle::Bold, notosans::BOLD_TTF),
        ];
        for (style, bytes) in styles {
            plotters::style::register_font(FONT, style, bytes).ok();
        }
    });
    let failed = |what: &dyn std::fmt::Display| Error::Input(format!("chart {name}: {what}"));
    let mut svg = String::new();
    figure
        .draw(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area())
        .map_err(|e| failed(&e))?;
    let path = dir.join(format!("{name}.svg"));
    crate::io::atomic_write(&path, |file| {
        use std::io::Write;
        file.write_all(svg.as_bytes()).map_err(Error::io(&path))
    })?;
    let mut pixels = vec![255; 3 * (SIZE.0 * SIZE.1) as usize];
    figure
        .draw(&BitMapBackend::with_buffer(&mut pixels, SIZE).into_drawing_area())
        .map_err(|e| failed(&e))?;
    let opaque = |p: &[u8]| [p[0], p[1], p[2], 255].map(|c| f32::from(c) / 255.0);
    let picture = Image {
        size: SIZE.into(),
        channels: 4,
        values: pixels.chunks(3).flat_map(opaque).collect(),
    };
    picture.save(dir.join(format!("{name}.png")))
}

impl Drawable for Chart {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult<B> {
        area.fill(&WHITE)?;
        let (left, legend) = area.split_horizontally(SIZE.0 as i32 - LEGEND);
        let seen = |p: &&[f64; 2]| self.x.shows(p[0]) && self.y.shows(p[1]);
        let all = || {
            self.series
                .iter()
                .flat_map(|s| s.points.iter().filter(seen))
        };
        let (x, y) = (
            self.x.scale(all().map(|p| p[0])),
            self.y.scale(all().map(|p| p[1])),
        );
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, (FONT, 44))
            .margin(24)
            .x_label_area_size(96)
            .y_label_area_size(148)
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .axis_style(BLACK.stroke_width(2))
            .set_all_tick_mark_size(8)
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12).stroke_width(2))
            .label_style((FONT, 30))
            .axis_desc_style((FONT, 34))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_label_formatter(&|v| super::axis::tick(*v))
            .y_label_formatter(&|v| super::axis::tick(*v))
            .draw()?;
        for (i, series) in self.series.iter().enumerate() {
            let points: Vec<(f64, f64)> = series
                .points
                .iter()
                .filter(seen)
                .map(|p| (p[0], p[1]))
                .collect();
            let colour = colour(i);
            match series.look {
                SeriesStyle::Line | SeriesStyle::LineMarks => {
                    chart.draw_series(LineSeries::new(points.clone(), colour.stroke_width(4)))?;
                }
                SeriesStyle::Dashed => {
                    let style = colour.stroke_width(4);
                    chart.draw_series(DashedLineSeries::new(points.clone(), 14, 10, style))?;
                }
                SeriesStyle::Band => {
                    let area = Polygon::new(points.clone(), band(i));
                    chart.draw_series([area])?;
                }
                SeriesStyle::Marks | SeriesStyle::Rings => {}
            }
            match series.look {
                SeriesStyle::Marks | SeriesStyle::LineMarks => {
                    let marks = points
                        .iter()
                        .map(|p| EmptyElement::at(*p) + mark(i, (0, 0)));
                    chart.draw_series(marks)?;
                }
                SeriesStyle::Rings => {
                    let ring = BLACK.stroke_width(4);
                    chart.draw_series(points.iter().map(|p| Circle::new(*p, 18, ring)))?;
                }
                SeriesStyle::Line | SeriesStyle::Dashed | SeriesStyle::Band => {}
            }
        }
        let keys = self.series.iter().enumerate();
        for (line, (i, series)) in keys.filter(|(_, s)| !s.name.is_empty()).enumerate() {
            draw_legend_entry(&legend, line, i, series)?;
        }
        Ok(())
    }
}

/// Draws one entry of a legend.
pub(super) fn draw_legend_entry<B: DrawingBackend>(
    legend: &DrawingArea<B, Shift>,
    line: usize,
    i: usize,
    series: &Series,
) -> DrawResult<B> {
    let at = (52, 120 + 52 * line as i32);
    let stroke = colour(i).stroke_width(4);
    match series.look {
        SeriesStyle::Line | SeriesStyle::LineMarks => legend.draw(&PathElement::new(
            vec![(at.0 - 32, at.1), (at.0 + 32, at.1)],
            stroke,
        ))?,
        SeriesStyle::Dashed => {
            for from in [-32, -8, 16] {
                let dash = vec![(at.0 + from, at.1), (at.0 + from + 16, at.1)];
                legend.draw(&PathElement::new(dash, stroke))?;
            }
        }
        SeriesStyle::Band => {
            let corners = [(at.0 - 32, at.1 - 14), (at.0 + 32, at.1 + 14)];
            legend.draw(&Rectangle::new(corners, band(i)))?;
        }
        SeriesStyle::Marks | SeriesStyle::Rings => {}
    }
    match series.look {
        SeriesStyle::Marks | SeriesStyle::LineMarks => {
            legend.draw(&(EmptyElement::at(at) + mark(i, (0, 0))))?;
        }
        SeriesStyle::Rings => legend.draw(&Circle::new(at, 18, BLACK.stroke_width(4)))?,
        SeriesStyle::Line | SeriesStyle::Dashed | SeriesStyle::Band => {}
    }
    draw_label(legend, &series.name, at)
}

/// Draws the text of a legend entry.
pub(super) fn draw_label<B: DrawingBackend>(
    legend: &DrawingArea<B, Shift>,
    name: &str,
    at: (i32, i32),
) -> DrawResult<B> {
    legend.draw(&Text::new(
        name.to_owned(),
        (at.0 + 48, at.1 - 16),
        (FONT, 30),
    ))
}

pub(super) fn colour(i: usize) -> RGBColor {
    COLOURS[i % COLOURS.len()]
}

/// Returns the style of the area of the `i`th series.
fn band(i: usize) -> ShapeStyle {
    colour(i).mix(0.25).filled()
}

/// Returns the marker of the `i`th series: shapes differ as well as colours.
fn mark(i: usize, at: (i32, i32)) -> Polygon<(i32, i32)> {
    let shape: &[(i32, i32)] = match i % 6 {
        // An octagon, which looks like a disc at this size.
        0 => &[
            (4, 10),
            (10, 4),
            (10, -4),
            (4, -10),
            (-4, -10),
            (-10, -4),
            (-10, 4),
            (-4, 10),
        ],
        1 => &[(0, -12), (12, 10), (-12, 10)],
        2 => &[(-8, -8), (8, -8), (8, 8), (-8, 8)],
        3 => &[(0, -12), (12, 0), (0, 12), (-12, 0)],
        4 => &[(0, 12), (12, -10), (-12, -10)],
        _ => &[
            (-4, -12),
            (4, -12),
            (4, -4),
            (12, -4),
            (12, 4),
            (4, 4),
            (4, 12),
            (-4, 12),
            (-4, 4),
            (-12, 4),
            (-12, -4),
            (-4, -4),
        ],
    };
    let points: Vec<(i32, i32)> = shape.iter().map(|p| (at.0 + p.0, at.1 + p.1)).collect();
    Polygon::new(points, colour(i).filled())
}
