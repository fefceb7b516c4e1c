//! Overview sheet of all transfer function presets.

use super::canvas::{Anchor, CAP_HEIGHT, Canvas};
use super::legend::{BarColours, ColourBar};
use crate::Result;
use crate::render::{Background, Image, TransferFunction};

/// Font size and size of a cell, in pixels.
const LETTERS: f32 = 15.0;
const CELL_SIZE: [u32; 2] = [400, 44];
const COLUMNS: u32 = 3;
const MARGIN: u32 = 16;
/// Left edge of the bar, its width, and the heights of bar and strip, in pixels.
const BEGIN: u32 = 96;
const WIDTH: u32 = 280;
const BAR: u32 = 16;
const STRIP: u32 = 12;
/// Path length of the opacity strip, as a fraction of the body's extent.
const STRIP_DEPTH: f64 = 0.1;

/// Draws a sheet of all presets ([`TransferFunction::preset_names`]) on white: the name, the
/// colours from the minimum to the maximum, and below them the colours with the opacity of a tenth
/// of the body's extent, over a checkerboard.
///
/// # Errors
/// None in practice: the font and the presets are part of the library.
pub fn preset_sheet() -> Result<Image> {
    let names = TransferFunction::preset_names();
    let rows = (names.len() as u32).div_ceil(COLUMNS);
    let size = [
        COLUMNS * CELL_SIZE[0] + 2 * MARGIN,
        rows * CELL_SIZE[1] + 2 * MARGIN,
    ];
    let mut canvas = Canvas::with_letters(size, Background::White, LETTERS)?;
    let ink = canvas.foreground;
    for (i, name) in names.iter().enumerate() {
        let [column, row] = [i as u32 / rows, i as u32 % rows];
        let (left, top) = (MARGIN + column * CELL_SIZE[0], MARGIN + row * CELL_SIZE[1]);
        let middle = top as f32 + 0.5 * ((BAR + STRIP) as f32 + CAP_HEIGHT * LETTERS);
        let end = [(left + BEGIN - 8) as f32, middle];
        canvas.text(name, end, Anchor::End, LETTERS, ink);
        let transfer = TransferFunction::preset(name)?.to_absolute((0.0, 1.0), 1.0);
        let bar = ColourBar {
            name: String::new(),
            unit: String::new(),
            range: (0.0, 1.0),
            colours: BarColours::Transfer {
                transfer,
                path_length: Some(STRIP_DEPTH),
            },
        };
        let corner = [left + BEGIN, top];
        bar.fill(&mut canvas, corner, WIDTH, [BAR, STRIP], true);
    }
    let pixels = size[0] as usize * size[1] as usize;
    let mut sheet = Image {
        size,
        channels: 4,
        values: vec![1.0; 4 * pixels],
    };
    canvas.composite_over(&mut sheet);
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn preset_sheet_shows_preset_colours() {
        let sheet = preset_sheet().unwrap();
        let names = TransferFunction::preset_names();
        let rows = (names.len() as u32).div_ceil(COLUMNS);
        for (i, name) in names.iter().enumerate() {
            let [column, row] = [i as u32 / rows, i as u32 % rows];
            let x = MARGIN + column * CELL_SIZE[0] + BEGIN;
            let y = MARGIN + row * CELL_SIZE[1] + BAR / 2;
            let transfer = TransferFunction::preset(name).unwrap();
            let transfer = transfer.to_absolute((0.0, 1.0), 1.0);
            for across in [0, 100, WIDTH - 1] {
                let scalar = (f64::from(across) + 0.5) / f64::from(WIDTH);
                let seen = sheet.pixel(x + across, y);
                for (seen, colour) in seen.iter().zip(transfer.colour(scalar)) {
                    assert!((f64::from(*seen) - colour).abs() < 1.5 / 255.0, "{name}");
                }
            }
        }
    }
}
