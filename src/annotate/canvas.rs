//! Text and shapes with a halo, drawn by tiny-skia and composited over an image.

use crate::render::{Background, Image};
use crate::{Error, Result};
use ab_glyph::{Font, FontRef, OutlineCurve};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Shader, Stroke,
    Transform,
};

/// Font size as a fraction of the image height, and the minimum legible size in pixels.
const FONT_SCALE: f32 = 0.028;
const MIN_FONT_SIZE: f32 = 10.0;
/// Aspect ratio below which the font size depends on the width instead of the height.
const ASPECT: f32 = 4.0 / 3.0;
/// Width of the halo around text and shapes, as a multiple of the font size, and its opacity.
const HALO_WIDTH: f32 = 0.13;
const RIM_OPACITY: f32 = 0.7;
/// Height of capital letters, as a multiple of the font size.
pub(super) const CAP_HEIGHT: f32 = 0.714;

/// Horizontal anchor of a line of text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// RGB from 0 to 1.
pub(super) type Colour = [f32; 3];

/// An overlay for an image.
pub(super) struct Canvas {
    pixmap: Pixmap,
    font: FontRef<'static>,
    /// Default font size (em), in pixels.
    pub em: f32,
    /// Colour of text and lines.
    pub foreground: Colour,
    rim: Colour,
}

/// Returns the default font size (em) on an image of `size` pixels, in pixels.
pub(crate) fn font_size([width, height]: [u32; 2]) -> f32 {
    let [width, height] = [width as f32, height as f32];
    (FONT_SCALE * height.min(width / ASPECT)).max(MIN_FONT_SIZE)
}

impl Canvas {
    /// Creates an empty canvas for an image of `size` pixels on `background`.
    pub fn new(size: [u32; 2], background: Background) -> Result<Canvas> {
        Canvas::with_letters(size, background, font_size(size))
    }

    /// As [`Canvas::new`], with a font size of `em` pixels.
    pub fn with_letters(size: [u32; 2], background: Background, em: f32) -> Result<Canvas> {
        let pixmap = Pixmap::new(size[0], size[1]).ok_or_else(|| {
            Error::Input(format!(
                "size of an annotated image must be 1 to 65536 pixels per side, got {} x {}",
                size[0], size[1]
            ))
        })?;
        let font = FontRef::try_from_slice(notosans::REGULAR_TTF)
            .map_err(|e| Error::Input(format!("cannot read the annotation font: {e}")))?;
        let (light, dark) = ([0.96; 3], [0.06; 3]);
        let (ink, rim) = match background.is_light() {
            true => (dark, [1.0; 3]),
            false => (light, [0.0; 3]),
        };
        Ok(Canvas {
            pixmap,
            font,
            em,
            foreground: ink,
            rim,
        })
    }

    /// Returns width and height in pixels.
    pub fn size(&self) -> [f32; 2] {
        [self.pixmap.width() as f32, self.pixmap.height() as f32]
    }

    /// Returns the margin at the edges, in pixels.
    pub fn margin(&self) -> f32 {
        0.8 * self.em
    }

    /// Returns the width of `text` at a font size of `em` pixels.
    pub fn text_width(&self, text: &str, em: f32) -> f32 {
        self.letters(text).1 * self.scale(em)
    }

    /// Returns `text`, truncated with an ellipsis to fit into `width` pixels at font size `em`.
    pub fn shortened(&self, text: &str, em: f32, width: f32) -> String {
        if self.text_width(text, em) <= width {
            return text.to_owned();
        }
        let mut kept: Vec<char> = text.chars().collect();
        loop {
            kept.pop();
            let short: String = kept.iter().chain(&['…']).collect();
            if kept.is_empty() || self.text_width(&short, em) <= width {
                return short;
            }
        }
    }

    /// Draws a line of text at a font size of `em` pixels, with its baseline through `at`.
    pub fn text(&mut self, text: &str, at: [f32; 2], anchor: Anchor, em: f32, colour: Colour) {
        let (glyphs, width) = self.letters(text);
        let scale = self.scale(em);
        let start = match anchor {
            Anchor::Start => at[0],
            Anchor::Middle => at[0] - 0.5 * width * scale,
            Anchor::End => at[0] - width * scale,
        };
        let mut outline = PathBuilder::new();
        for (glyph, place) in glyphs {
            let Some(glyph) = self.font.outline(glyph) else {
                continue;
            };
            let put = |p: ab_glyph::Point| (start + scale * (place + p.x), at[1] - scale * p.y);
            trace(&mut outline, &glyph.curves, put);
        }
        if let Some(path) = outline.finish() {
            self.rim_of(&path, em);
            self.fill(&path, colour, 1.0);
        }
    }

    /// Draws the halo of a shape, scaled for a font size of `em` pixels.
    fn rim_of(&mut self, path: &Path, em: f32) {
        let stroke = Stroke {
            width: 2.0 * HALO_WIDTH * em,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        let paint = paint(self.rim, RIM_OPACITY);
        let identity = Transform::identity();
        self.pixmap
            .stroke_path(path, &paint, &stroke, identity, None);
    }

    fn fill(&mut self, path: &Path, colour: Colour, opacity: f32) {
        let paint = paint(colour, opacity);
        let (rule, identity) = (FillRule::Winding, Transform::identity());
        self.pixmap.fill_path(path, &paint, rule, identity, None);
    }

    /// Fills a rectangle: left, top, width, height in pixels.
    pub fn rectangle(&mut self, [x, y, width, height]: [f32; 4], colour: Colour, opacity: f32) {
        if let Some(rect) = Rect::from_xywh(x, y, width, height) {
            let (paint, identity) = (paint(colour, opacity), Transform::identity());
            self.pixmap.fill_rect(rect, &paint, identity, None);
        }
    }

    /// Fills a rectangle in the foreground colour with a halo.
    pub fn bar(&mut self, [x, y, width, height]: [f32; 4]) {
        if let Some(rect) = Rect::from_xywh(x, y, width, height) {
            let path = PathBuilder::from_rect(rect);
            self.rim_of(&path, self.em);
            self.fill(&path, self.foreground, 1.0);
        }
    }

    /// Draws a line with a halo.
    pub fn line(&mut self, from: [f32; 2], to: [f32; 2], width: f32, colour: Colour) {
        let mut line = PathBuilder::new();
        line.move_to(from[0], from[1]);
        line.line_to(to[0], to[1]);
        let Some(path) = line.finish() else {
            return;
        };
        let rim = 2.0 * HALO_WIDTH * self.em;
        let rims = [(width + rim, self.rim, RIM_OPACITY), (width, colour, 1.0)];
        for (width, colour, opacity) in rims {
            let stroke = Stroke {
                width,
                line_cap: LineCap::Round,
                ..Stroke::default()
            };
            let (paint, identity) = (paint(colour, opacity), Transform::identity());
            self.pixmap
                .stroke_path(&path, &paint, &stroke, identity, None);
        }
    }

    /// Composites the canvas over `image`, of the same size and four channels.
    pub fn composite_over(&self, image: &mut Image) {
        let drawn = self.pixmap.pixels();
        for (under, over) in image.values.chunks_exact_mut(4).zip(drawn) {
            let alpha = f32::from(over.alpha()) / 255.0;
            if alpha > 0.0 {
                let over = [over.red(), over.green(), over.blue(), over.alpha()];
                for (under, over) in under.iter_mut().zip(over) {
                    *under = f32::from(over) / 255.0 + (1.0 - alpha) * *under;
                }
            }
        }
    }

    /// Returns pixels per font unit.
    fn scale(&self, em: f32) -> f32 {
        em / self.font.units_per_em().unwrap_or(1000.0)
    }

    /// Returns the glyphs of `text` with their positions, and the total width, in font units.
    fn letters(&self, text: &str) -> (Vec<(ab_glyph::GlyphId, f32)>, f32) {
        let (mut glyphs, mut width): (Vec<(ab_glyph::GlyphId, f32)>, f32) = (Vec::new(), 0.0);
        for letter in text.chars().filter(|c| !c.is_control()) {
            let glyph = self.font.glyph_id(letter);
            if let Some((last, _)) = glyphs.last() {
                width += self.font.kern_unscaled(*last, glyph);
            }
            glyphs.push((glyph, width));
            width += self.font.h_advance_unscaled(glyph);
        }
        (glyphs, width)
    }
}

/// Returns the letters of `text` that the font of annotations does not have: they are drawn as
/// boxes.
pub(crate) fn missing_letters(text: &str) -> String {
    let Ok(font) = FontRef::try_from_slice(notosans::REGULAR_TTF) else {
        return String::new();
    };
    let mut missing = String::new();
    for letter in text.chars().filter(|c| !c.is_control()) {
        if font.glyph_id(letter).0 == 0 && !missing.contains(letter) {
            missing.push(letter);
        }
    }
    missing
}

fn paint(colour: Colour, opacity: f32) -> Paint<'static> {
    let [r, g, b] = colour.map(|c| c.clamp(0.0, 1.0));
    let colour = Color::from_rgba(r, g, b, opacity.clamp(0.0, 1.0)).unwrap_or(Color::BLACK);
    Paint {
        shader: Shader::SolidColor(colour),
        // The fast pipeline rounds colours to fewer levels than a legend has.
        force_hq_pipeline: true,
        ..Paint::default()
    }
}

/// Adds the curves of a glyph to `path`, mapped to image coordinates by `put`.
fn trace(
    path: &mut PathBuilder,
    curves: &[OutlineCurve],
    put: impl Fn(ab_glyph::Point) -> (f32, f32),
) {
    let mut last = None;
    for curve in curves {
        let (start, end) = match curve {
            OutlineCurve::Line(a, b)
            | OutlineCurve::Quad(a, _, b)
            | OutlineCurve::Cubic(a, _, _, b) => (*a, *b),
        };
        if last != Some(start) {
            if last.is_some() {
                path.close();
            }
            let (x, y) = put(start);
            path.move_to(x, y);
        }
        let (x, y) = put(end);
        match curve {
            OutlineCurve::Line(..) => path.line_to(x, y),
            OutlineCurve::Quad(_, c, _) => {
                let (cx, cy) = put(*c);
                path.quad_to(cx, cy, x, y);
            }
            OutlineCurve::Cubic(_, c, d, _) => {
                let ((cx, cy), (dx, dy)) = (put(*c), put(*d));
                path.cubic_to(cx, cy, dx, dy, x, y);
            }
        }
        last = Some(end);
    }
    if last.is_some() {
        path.close();
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn drawn(text: &str, background: Background) -> Canvas {
        let mut canvas = Canvas::new([400, 100], background).unwrap();
        let ink = canvas.foreground;
        canvas.text(text, [20.0, 60.0], Anchor::Start, 30.0, ink);
        canvas
    }

    #[test]
    fn text_is_drawn_with_counters() {
        let canvas = drawn("O", Background::Black);
        let width = canvas.text_width("O", 30.0);
        let light = |x: f32, y: f32| canvas.pixmap.pixel(x as u32, y as u32).unwrap().red();
        let middle = 20.0 + 0.5 * width;
        let high = 60.0 - 0.5 * CAP_HEIGHT * 30.0;
        assert!(light(middle, high) < 20, "the centre of an O must be empty");
        let row = (20..20 + width as u32).map(|x| light(x as f32, high));
        assert!(row.max().unwrap() > 200, "the sides of an O must be filled");
    }

    #[test]
    fn font_contains_every_used_letter() {
        let canvas = Canvas::new([8, 8], Background::Black).unwrap();
        for letter in "azAZ09µ³²−…·()[]/".chars() {
            assert_ne!(canvas.font.glyph_id(letter).0, 0, "{letter}");
        }
    }

    #[test]
    fn text_contrasts_with_background() {
        for (background, behind) in [(Background::Black, 0.0f32), (Background::White, 1.0)] {
            let mut image = Image {
                size: [400, 100],
                channels: 4,
                values: [behind, behind, behind, 1.0].repeat(40_000),
            };
            drawn("palpate", background).composite_over(&mut image);
            let apart = image.values.iter().map(|v| (v - behind).abs());
            assert!(apart.fold(0.0, f32::max) > 0.85, "{background:?}");
        }
    }

    #[test]
    fn long_text_is_truncated_to_width() {
        let canvas = Canvas::new([400, 100], Background::Black).unwrap();
        let short = canvas.shortened("a name that is far too long", 20.0, 120.0);
        assert!(short.ends_with('…') && short.len() > 5, "{short}");
        assert!(canvas.text_width(&short, 20.0) <= 120.0);
        assert_eq!(canvas.shortened("bone", 20.0, 120.0), "bone");
    }
}
