//! Lines drawn over a picture: the outline at rest, the depth, the frame of the inset.

/// Draws lines with smooth edges over premultiplied `pixels`; widths are in pixels.
pub(super) struct Pen<'a> {
    pub pixels: &'a mut [f32],
    pub size: [u32; 2],
    pub colour: [f32; 3],
    pub opacity: f32,
    pub width: f32,
}

impl Pen<'_> {
    /// Draws the line from `a` to `b`, in pixels.
    pub fn line(&mut self, a: [f64; 2], b: [f64; 2]) {
        let [a, b] = [a, b].map(|p| p.map(|x| x as f32));
        let reach = 0.5 * self.width + 1.0;
        let range = |k: usize| {
            let end = self.size[k] as f32;
            let low = (a[k].min(b[k]) - reach).clamp(0.0, end);
            let high = (a[k].max(b[k]) + reach).clamp(0.0, end);
            low as u32..high.ceil() as u32
        };
        let along = [b[0] - a[0], b[1] - a[1]];
        let square = (along[0] * along[0] + along[1] * along[1]).max(1e-12);
        if !square.is_finite() {
            return;
        }
        let (columns, rows) = (range(0), range(1));
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let p = [x as f32 + 0.5 - a[0], y as f32 + 0.5 - a[1]];
            let t = ((p[0] * along[0] + p[1] * along[1]) / square).clamp(0.0, 1.0);
            let off = [p[0] - t * along[0], p[1] - t * along[1]];
            let far = (off[0] * off[0] + off[1] * off[1]).sqrt();
            let cover = (0.5 * self.width + 0.5 - far).clamp(0.0, 1.0) * self.opacity;
            self.blend(x, y, cover);
        }
    }

    /// Blends the colour over a pixel.
    fn blend(&mut self, x: u32, y: u32, cover: f32) {
        if cover <= 0.0 {
            return;
        }
        let at = 4 * (y * self.size[0] + x) as usize;
        for k in 0..3 {
            self.pixels[at + k] += cover * (self.colour[k] - self.pixels[at + k]);
        }
        self.pixels[at + 3] += cover * (1.0 - self.pixels[at + 3]);
    }

    /// Draws segments as dashes of `dash` pixels by their place along the picture's diagonal.
    pub fn dashed(&mut self, segments: &[[[f64; 2]; 2]], dash: f64) {
        for [a, b] in segments {
            let long = f64::hypot(b[0] - a[0], b[1] - a[1]);
            let pieces = (2.0 * long / dash).ceil().clamp(1.0, 200.0) as usize;
            for k in 0..pieces {
                let at = |k: usize| [0, 1].map(|i| a[i] + (b[i] - a[i]) * k as f64 / pieces as f64);
                let (from, to) = (at(k), at(k + 1));
                let place = 0.5 * (from[0] + to[0] + 0.6 * (from[1] + to[1]));
                if (place / dash).rem_euclid(2.0) < 1.25 {
                    self.line(from, to);
                }
            }
        }
    }

    /// Draws the frame of a rectangle from `low` to `high`.
    pub fn frame(&mut self, low: [f64; 2], high: [f64; 2]) {
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        for k in 0..4 {
            self.line(corners[k], corners[(k + 1) % 4]);
        }
    }
}
