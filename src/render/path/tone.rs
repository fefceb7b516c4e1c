//! From linear light to a picture: a filmic curve for brightness, and sRGB.

/// Returns a display value, 0 to 1, of linear light: the filmic curve of Narkowicz (2015), which
/// approximates that of the Academy Color Encoding System, scaled so that white stays white.
pub(super) fn tone_mapped(light: f32) -> f32 {
    let x = light.max(0.0);
    let curve = |x: f32| x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    srgb((curve(x) / curve(WHITE)).min(1.0))
}

/// Light that is shown as white.
pub(super) const WHITE: f32 = 4.0;

/// Encodes a linear value in sRGB.
pub(super) fn srgb(x: f32) -> f32 {
    match x <= 0.003_130_8 {
        true => 12.92 * x,
        false => 1.055 * x.powf(1.0 / 2.4) - 0.055,
    }
}

/// Returns the linear light of a colour in sRGB.
pub(crate) fn linear_light(colour: glam::Vec3) -> glam::Vec3 {
    colour
        .to_array()
        .map(|c| linear(f64::from(c)) as f32)
        .into()
}

/// Decodes an sRGB value.
pub(super) fn linear(x: f64) -> f64 {
    match x <= 0.04045 {
        true => x / 12.92,
        false => ((x + 0.055) / 1.055).powf(2.4),
    }
}
