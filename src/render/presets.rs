//! Transfer functions by name.

use super::TransferFunction;
use crate::{Error, Result};

/// One preset: scalars from 0 to 1 over the field, extinction per extent of the mesh.
struct Preset {
    name: &'static str,
    colour: &'static [[f64; 4]],
    extinction: &'static [[f64; 2]],
}

/// Perceptual colour maps rise in extinction with the scalar, so that high values show inside.
const RISING: &[[f64; 2]] = &[[0.0, 0.8], [0.3, 1.6], [0.7, 6.0], [1.0, 20.0]];
/// Diverging colour maps show both ends and hide the middle.
const BOTH_ENDS: &[[f64; 2]] = &[[0.0, 9.0], [0.35, 1.0], [0.5, 0.3], [0.65, 1.0], [1.0, 9.0]];

const PRESETS: &[Preset] = &[
    Preset {
        name: "bone",
        colour: &[
            [0.0, 0.55, 0.25, 0.15],
            [0.45, 0.85, 0.45, 0.3],
            [0.62, 0.95, 0.85, 0.7],
            [1.0, 1.0, 1.0, 0.95],
        ],
        extinction: &[
            [0.0, 0.0],
            [0.25, 0.15],
            [0.5, 0.6],
            [0.62, 14.0],
            [1.0, 90.0],
        ],
    },
    Preset {
        name: "muscle",
        colour: &[
            [0.0, 0.95, 0.8, 0.5],
            [0.1, 0.9, 0.6, 0.4],
            [0.18, 0.7, 0.15, 0.12],
            [0.4, 0.6, 0.1, 0.1],
            [0.65, 0.95, 0.85, 0.75],
            [1.0, 1.0, 1.0, 0.95],
        ],
        extinction: &[
            [0.0, 0.8],
            [0.1, 2.0],
            [0.17, 22.0],
            [0.4, 22.0],
            [0.65, 50.0],
            [1.0, 120.0],
        ],
    },
    Preset {
        name: "skin",
        colour: &[
            [0.0, 0.9, 0.7, 0.58],
            [0.4, 0.85, 0.55, 0.45],
            [1.0, 1.0, 0.95, 0.9],
        ],
        extinction: &[[0.0, 8.0], [0.15, 40.0], [1.0, 80.0]],
    },
    Preset {
        name: "tissue",
        colour: &[
            [0.0, 1.0, 0.78, 0.5],
            [0.12, 0.95, 0.6, 0.42],
            [0.2, 0.8, 0.25, 0.2],
            [0.35, 0.85, 0.4, 0.3],
            [0.6, 1.0, 0.9, 0.75],
            [1.0, 1.0, 1.0, 1.0],
        ],
        extinction: &[
            [0.0, 5.0],
            [0.12, 7.0],
            [0.2, 12.0],
            [0.35, 10.0],
            [0.55, 16.0],
            [0.65, 50.0],
            [1.0, 160.0],
        ],
    },
    Preset {
        name: "grey",
        colour: &[[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]],
        extinction: &[[0.0, 0.0], [0.2, 4.0], [1.0, 30.0]],
    },
    Preset {
        name: "viridis",
        colour: &[
            [0.0, 0.267, 0.005, 0.329],
            [0.125, 0.278, 0.176, 0.482],
            [0.25, 0.231, 0.322, 0.545],
            [0.375, 0.173, 0.447, 0.557],
            [0.5, 0.129, 0.569, 0.549],
            [0.625, 0.157, 0.682, 0.502],
            [0.75, 0.369, 0.788, 0.384],
            [0.875, 0.678, 0.863, 0.188],
            [1.0, 0.992, 0.906, 0.145],
        ],
        extinction: RISING,
    },
    Preset {
        name: "magma",
        colour: &[
            [0.0, 0.0, 0.0, 0.016],
            [0.125, 0.11, 0.063, 0.267],
            [0.25, 0.31, 0.071, 0.482],
            [0.375, 0.506, 0.145, 0.506],
            [0.5, 0.71, 0.212, 0.478],
            [0.625, 0.898, 0.314, 0.392],
            [0.75, 0.984, 0.529, 0.38],
            [0.875, 0.996, 0.761, 0.529],
            [1.0, 0.984, 0.992, 0.749],
        ],
        extinction: RISING,
    },
    Preset {
        name: "inferno",
        colour: &[
            [0.0, 0.0, 0.0, 0.016],
            [0.125, 0.129, 0.047, 0.29],
            [0.25, 0.337, 0.063, 0.431],
            [0.375, 0.537, 0.133, 0.416],
            [0.5, 0.733, 0.216, 0.329],
            [0.625, 0.89, 0.349, 0.196],
            [0.75, 0.976, 0.549, 0.039],
            [0.875, 0.976, 0.788, 0.196],
            [1.0, 0.988, 1.0, 0.643],
        ],
        extinction: RISING,
    },
    Preset {
        name: "plasma",
        colour: &[
            [0.0, 0.051, 0.031, 0.529],
            [0.125, 0.298, 0.008, 0.631],
            [0.25, 0.494, 0.012, 0.659],
            [0.375, 0.663, 0.137, 0.584],
            [0.5, 0.8, 0.278, 0.471],
            [0.625, 0.898, 0.42, 0.365],
            [0.75, 0.973, 0.584, 0.251],
            [0.875, 0.992, 0.765, 0.157],
            [1.0, 0.941, 0.976, 0.129],
        ],
        extinction: RISING,
    },
    Preset {
        name: "coolwarm",
        colour: &[
            [0.0, 0.231, 0.298, 0.753],
            [0.25, 0.553, 0.69, 0.996],
            [0.5, 0.867, 0.863, 0.863],
            [0.75, 0.957, 0.604, 0.482],
            [1.0, 0.706, 0.016, 0.149],
        ],
        extinction: BOTH_ENDS,
    },
];

impl TransferFunction {
    /// The preset called `name`, relative to the field's range and the mesh's extent.
    ///
    /// # Errors
    /// When there is none of that name; the message lists those there are.
    pub fn preset(name: &str) -> Result<TransferFunction> {
        let found = PRESETS.iter().find(|p| p.name.eq_ignore_ascii_case(name));
        let preset = found.ok_or_else(|| {
            Error::Input(format!(
                "there is no transfer function preset \"{name}\"; the presets are {}",
                TransferFunction::preset_names().join(", ")
            ))
        })?;
        TransferFunction::relative(preset.colour.to_vec(), preset.extinction.to_vec())
    }

    /// The names that [`TransferFunction::preset`] knows.
    pub fn preset_names() -> Vec<&'static str> {
        PRESETS.iter().map(|p| p.name).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_preset_is_well_formed_and_a_wrong_name_lists_them() {
        for name in TransferFunction::preset_names() {
            let tf = TransferFunction::preset(name)
                .unwrap()
                .resolved((0.0, 1.0), 1.0);
            assert!(tf.max_extinction() > 1.0, "{name} shows nothing");
        }
        let message = TransferFunction::preset("bones").unwrap_err().to_string();
        assert!(message.contains("bone, muscle, skin"), "{message}");
    }
}
