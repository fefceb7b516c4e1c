//! Legends: a colour bar of a scalar field, or a list of regions.

use super::canvas::{Anchor, CAP_HEIGHT, Canvas, Colour};
use super::numbers::{label, ticks};
use crate::render::AbsoluteTransferFunction;

/// Height of the bar as a fraction of the image height.
const HEIGHT: f32 = 0.5;
/// Widths of the bar and of the opacity strip next to it, as multiples of the font size.
const BAR: f32 = 1.1;
const OPACITY_STRIP_WIDTH: f32 = 0.7;
/// Maximum number of tick intervals, and the minimum distance of two ticks as a multiple of the
/// font size.
const TICKS: f32 = 6.0;
const APART: f32 = 2.0;
/// Maximum width of names as a fraction of the image width.
const NAMES: f32 = 0.35;
/// Line spacing of regions, as a multiple of the font size.
const LINE: f32 = 1.4;
/// Checkerboard behind translucent colours, and the size of its squares as a multiple of the font
/// size.
const CHECKER_GREYS: [f32; 2] = [0.85, 0.45];
const CHECK: f32 = 0.35;

/// A colour legend.
#[derive(Clone, Debug, PartialEq)]
pub enum Legend {
    /// Colour bar of a scalar field.
    Bar(ColourBar),
    /// List of regions with their colours.
    Regions {
        /// Heading of the list.
        name: String,
        /// The regions, from the top; those that do not fit are counted in the last line.
        regions: Vec<Swatch>,
    },
}

/// A region and its colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Swatch {
    /// The region's name.
    pub name: String,
    /// RGB from 0 to 1.
    pub colour: [f64; 3],
}

/// Colour bar of a scalar field, with the maximum at the top and ticks at round numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourBar {
    /// The field's name.
    pub name: String,
    /// Its unit; empty if it has none. Large values in Pa and J/m³ are labelled with a prefix: k, M
    /// or G.
    pub unit: String,
    /// Minimum and maximum of the scalar.
    pub range: (f64, f64),
    /// The colours.
    pub colours: BarColours,
}

/// The colours of a [`ColourBar`].
#[derive(Clone, Debug, PartialEq)]
pub enum BarColours {
    /// Greyscale from black to white.
    Grey,
    /// Colours of a transfer function.
    Transfer {
        /// The transfer function, in the units of the range and of the mesh.
        transfer: AbsoluteTransferFunction,
        /// Path length through the body, in mesh units: a strip next to the bar shows the colours
        /// with the opacity of this path length, over a checkerboard. `None` omits the strip.
        path_length: Option<f64>,
    },
}

impl Legend {
    /// Draws the legend and returns its width at the right edge, in pixels.
    pub(super) fn draw(&self, canvas: &mut Canvas) -> f32 {
        match self {
            Legend::Bar(bar) => bar.draw(canvas),
            Legend::Regions { name, regions } => draw_regions(canvas, name, regions),
        }
    }
}

/// Layout of a colour bar, in pixels from the upper left.
struct Layout {
    left: u32,
    top: u32,
    /// Widths of the bar and of the strip next to it.
    widths: [u32; 2],
    height: u32,
}

impl ColourBar {
    /// Returns the scale of the label unit and its name with prefix.
    fn scale(&self) -> (f64, String) {
        let most = self.range.0.abs().max(self.range.1.abs());
        let prefix = match self.unit.as_str() {
            "Pa" | "J/m³" if most >= 1e9 => ("G", 1e9),
            "Pa" | "J/m³" if most >= 1e6 => ("M", 1e6),
            "Pa" | "J/m³" if most >= 1e3 => ("k", 1e3),
            _ => ("", 1.0),
        };
        (prefix.1, format!("{}{}", prefix.0, self.unit))
    }

    /// Returns the ticks: scalars and labels.
    fn ticks(&self, canvas: &Canvas) -> Vec<(f64, String)> {
        let (scale, _) = self.scale();
        let height = HEIGHT * canvas.size()[1];
        let most = (height / (APART * canvas.em)).clamp(1.0, TICKS) as usize;
        let (low, high) = (self.range.0 / scale, self.range.1 / scale);
        let (ticks, step) = ticks(low, high, most);
        let words = ticks.into_iter().map(|t| (t * scale, label(t, step)));
        words.collect()
    }

    fn layout(&self, canvas: &Canvas, labels: f32) -> Layout {
        let (em, [width, height]) = (canvas.em, canvas.size());
        let strip = match &self.colours {
            BarColours::Transfer {
                path_length: Some(_),
                ..
            } => (OPACITY_STRIP_WIDTH * em).round(),
            _ => 0.0,
        };
        let bar = (BAR * em).round();
        let high = (HEIGHT * height).round().max(1.0);
        let left = width - canvas.margin() - labels - bar - strip;
        // Leaves room for the name above it.
        let top = 0.5 * (height - high) + 0.3 * em;
        Layout {
            left: left.max(0.0) as u32,
            top: top.max(0.0) as u32,
            widths: [bar, strip].map(|n| n as u32),
            height: high as u32,
        }
    }

    /// Returns the colour of a scalar, and its opacity along the path length of the strip.
    fn colour(&self, scalar: f64) -> (Colour, f32) {
        match &self.colours {
            BarColours::Grey => {
                let (low, high) = self.range;
                let grey = (scalar - low) / (high - low).max(f64::MIN_POSITIVE);
                ([grey.clamp(0.0, 1.0) as f32; 3], 1.0)
            }
            BarColours::Transfer {
                transfer,
                path_length,
            } => {
                let depth = transfer.extinction(scalar) * path_length.unwrap_or(0.0);
                let colour = transfer.colour(scalar).map(|c| c as f32);
                (colour, (1.0 - (-depth).exp()) as f32)
            }
        }
    }

    fn draw(&self, canvas: &mut Canvas) -> f32 {
        let (em, ink, margin) = (canvas.em, canvas.foreground, canvas.margin());
        let ticks = self.ticks(canvas);
        let (gap, dash) = (0.25 * em, 0.3 * em);
        let widest = ticks.iter().map(|(_, words)| canvas.text_width(words, em));
        let labels = widest.fold(0.0, f32::max) + gap + dash;
        let layout = self.layout(canvas, labels);
        let [left, top] = [layout.left, layout.top].map(|n| n as f32);
        let [bar, strip] = layout.widths.map(|n| n as f32);
        let height = layout.height as f32;
        // An outline around bar and strip.
        canvas.bar([left - 1.0, top - 1.0, bar + strip + 2.0, height + 2.0]);
        let corner = [layout.left, layout.top];
        self.fill(canvas, corner, layout.height, layout.widths, false);
        let right = left + bar + strip;
        let (low, high) = self.range;
        for (scalar, words) in ticks {
            let up = match high > low {
                true => (scalar - low) / (high - low),
                false => 0.5,
            };
            let y = top + height * (1.0 - up as f32);
            let line = (0.08 * em).max(1.0);
            canvas.line([right + 1.0, y], [right + dash, y], line, ink);
            let at = [right + dash + gap, y + 0.5 * CAP_HEIGHT * em];
            canvas.text(&words, at, Anchor::Start, em, ink);
        }
        let (_, unit) = self.scale();
        let name = match unit.is_empty() {
            true => self.name.clone(),
            false => format!("{} [{unit}]", self.name),
        };
        let [width, _] = canvas.size();
        let name = canvas.shortened(&name, em, NAMES * width);
        let at = [width - margin, top - 0.7 * em];
        canvas.text(&name, at, Anchor::End, em, ink);
        let name = canvas.text_width(&name, em) + margin;
        (width - left).max(name) + margin
    }

    /// Fills `length` lines of pixels from `corner` with the colours, each as long as the widths of
    /// bar and strip: from the top down, or from left to right if `across`.
    pub(super) fn fill(
        &self,
        canvas: &mut Canvas,
        corner: [u32; 2],
        length: u32,
        [bar, strip]: [u32; 2],
        across: bool,
    ) {
        let (low, high) = self.range;
        let check = ((CHECK * canvas.em) as u32).max(2);
        for step in 0..length {
            let share = (f64::from(step) + 0.5) / f64::from(length);
            let share = if across { share } else { 1.0 - share };
            let (colour, opacity) = self.colour(low + share * (high - low));
            let place = |from: u32, long: u32| {
                let [x, y, width, height] = match across {
                    true => [corner[0] + step, corner[1] + from, 1, long],
                    false => [corner[0] + from, corner[1] + step, long, 1],
                };
                [x, y, width, height].map(|n| n as f32)
            };
            canvas.rectangle(place(0, bar), colour, 1.0);
            for first in (0..strip).step_by(check as usize) {
                let grey = CHECKER_GREYS[((first / check + step / check) % 2) as usize];
                let square = place(bar + first, check.min(strip - first));
                canvas.rectangle(square, [grey; 3], 1.0);
                canvas.rectangle(square, colour, opacity);
            }
        }
    }
}

fn draw_regions(canvas: &mut Canvas, name: &str, regions: &[Swatch]) -> f32 {
    let (em, ink, margin) = (canvas.em, canvas.foreground, canvas.margin());
    let [width, height] = canvas.size();
    let room = (0.8 * height / (LINE * em)) as usize;
    // The last line gives the number of regions that do not fit.
    let shown = match regions.len() > room.saturating_sub(1) {
        true => room.saturating_sub(2),
        false => regions.len(),
    };
    let rest = regions.len() - shown;
    let more = (rest > 0).then(|| format!("and {rest} more"));
    let regions = &regions[..shown];
    let names = regions.iter().map(|r| &r.name).chain(&more);
    let names: Vec<String> = names
        .map(|n| canvas.shortened(n, em, NAMES * width))
        .collect();
    let name = canvas.shortened(name, em, NAMES * width);
    let side = (0.9 * em).round();
    let beside = side + 0.5 * em;
    let widest = names.iter().map(|n| canvas.text_width(n, em) + beside);
    let widest = widest.fold(canvas.text_width(&name, em), f32::max);
    let left = (width - margin - widest).floor();
    let lines = names.len() as f32 + 1.0;
    let top = 0.5 * (height - lines * LINE * em);
    let baseline = |line: usize| (top + (line as f32 + 0.8) * LINE * em).round();
    canvas.text(&name, [left, baseline(0)], Anchor::Start, em, ink);
    for (i, words) in names.iter().enumerate() {
        let y = baseline(i + 1);
        if let Some(region) = regions.get(i) {
            let square = [
                left,
                (y - 0.5 * (CAP_HEIGHT * em + side)).round(),
                side,
                side,
            ];
            canvas.bar([square[0] - 1.0, square[1] - 1.0, side + 2.0, side + 2.0]);
            canvas.rectangle(square, region.colour.map(|c| c as f32), 1.0);
        }
        canvas.text(words, [left + beside, y], Anchor::Start, em, ink);
    }
    width - left + margin
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::annotate::Annotations;
    use crate::render::{Background, Camera, Image, TransferFunction};
    use glam::DVec3;

    fn bar(colours: BarColours) -> ColourBar {
        ColourBar {
            name: "intensity".into(),
            unit: String::new(),
            range: (-200.0, 900.0),
            colours,
        }
    }

    fn transfer() -> AbsoluteTransferFunction {
        let preset = TransferFunction::preset("tissue").unwrap();
        preset.to_absolute((-200.0, 900.0), 3.0)
    }

    fn drawn(bar: &ColourBar, size: [u32; 2]) -> (Image, Layout) {
        let count = (size[0] * size[1]) as usize;
        let mut image = Image {
            size,
            channels: 4,
            values: vec![0.0; 4 * count],
        };
        let annotations = Annotations {
            legend: Some(Legend::Bar(bar.clone())),
            ..Annotations::default()
        };
        let camera = Camera::perspective(DVec3::Z, DVec3::ZERO, DVec3::Y, 30.0);
        annotations
            .draw(&mut image, &camera, Background::Black)
            .unwrap();
        let canvas = Canvas::new(size, Background::Black).unwrap();
        let widths = bar.ticks(&canvas).into_iter();
        let labels = widths.map(|(_, t)| canvas.text_width(&t, canvas.em));
        let labels = labels.fold(0.0, f32::max) + 0.55 * canvas.em;
        (image, bar.layout(&canvas, labels))
    }

    #[test]
    fn colour_bar_rows_match_transfer_function() {
        let transfer = transfer();
        for size in [[256, 256], [1024, 768]] {
            let bar = bar(BarColours::Transfer {
                transfer: transfer.clone(),
                path_length: Some(0.3),
            });
            let (image, layout) = drawn(&bar, size);
            for row in 0..layout.height {
                let up = 1.0 - (f64::from(row) + 0.5) / f64::from(layout.height);
                let scalar = -200.0 + up * 1100.0;
                let middle = layout.left + layout.widths[0] / 2;
                let seen = image.pixel(middle, layout.top + row);
                for (seen, colour) in seen.iter().zip(transfer.colour(scalar)) {
                    assert!((f64::from(*seen) - colour).abs() < 1.5 / 255.0, "row {row}");
                }
            }
        }
    }

    #[test]
    fn opacity_strip_matches_body_opacity() {
        let clear =
            TransferFunction::new(vec![[0.0, 1.0, 0.0, 0.0]], vec![[0.0, 0.0], [0.0, 1000.0]]);
        let bar = bar(BarColours::Transfer {
            transfer: clear.unwrap().to_absolute((0.0, 1.0), 1.0),
            path_length: Some(0.3),
        });
        let (image, layout) = drawn(&bar, [600, 600]);
        let x = layout.left + layout.widths[0] + layout.widths[1] / 2;
        let [top, low] = [layout.top, layout.top + layout.height - 1].map(|y| image.pixel(x, y));
        assert_eq!(top[..3], [1.0, 0.0, 0.0]);
        assert!(
            low[0] == low[1] && low[0] > 0.4,
            "the checkerboard must show through: {low:?}"
        );
    }

    #[test]
    fn grey_bar_spans_black_to_white() {
        let (image, layout) = drawn(&bar(BarColours::Grey), [400, 300]);
        let at = |row: u32| image.pixel(layout.left + 2, layout.top + row)[0];
        assert!(at(0) > 0.98 && at(layout.height - 1) < 0.02);
        assert!((at(layout.height / 2) - 0.5).abs() < 0.02);
    }

    #[test]
    fn large_pressures_use_kilopascals() {
        let stress = ColourBar {
            name: "von_mises".into(),
            unit: "Pa".into(),
            range: (0.0, 12_400.0),
            colours: BarColours::Grey,
        };
        assert_eq!(stress.scale(), (1000.0, "kPa".to_owned()));
        let canvas = Canvas::new([800, 600], Background::Black).unwrap();
        let words: Vec<String> = stress.ticks(&canvas).into_iter().map(|t| t.1).collect();
        assert_eq!(words, ["0", "5", "10"]);
    }

    #[test]
    fn small_images_accept_long_legends() {
        let many: Vec<Swatch> = (0..100)
            .map(|i| Swatch {
                name: format!("region number {i}"),
                colour: [0.2, 0.4, 0.6],
            })
            .collect();
        for size in [[1, 1], [7, 40], [64, 64], [300, 20]] {
            let (image, _) = drawn(&bar(BarColours::Grey), size);
            assert_eq!(image.size, size);
            assert!(image.values.iter().all(|v| (0.0..=1.0).contains(v)));
            let mut canvas = Canvas::new(size, Background::White).unwrap();
            draw_regions(&mut canvas, "label", &many);
        }
    }
}
