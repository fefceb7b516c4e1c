//! Transfer function presets: tissue presets and the colour maps of matplotlib.

use super::{TransferFunction, tissue_optics};
use crate::{Error, Result};
use colorous::Gradient;

/// A preset: scalars normalised to the field's range, extinction per extent of the mesh.
struct Preset {
    name: &'static str,
    colour: &'static [[f64; 4]],
    extinction: &'static [[f64; 2]],
}

/// Extinction for sequential colour maps: increases with the scalar, so that high values are
/// visible inside.
const SEQUENTIAL_EXTINCTION: &[[f64; 2]] = &[[0.0, 0.8], [0.3, 1.6], [0.7, 6.0], [1.0, 20.0]];
/// Extinction for diverging colour maps: both ends are visible, the middle is nearly transparent.
const DIVERGING_EXTINCTION: &[[f64; 2]] =
    &[[0.0, 9.0], [0.35, 1.0], [0.5, 0.3], [0.65, 1.0], [1.0, 9.0]];

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
        name: "scan",
        colour: &[
            [0.0, 0.55, 0.25, 0.2],
            [0.2, 0.8, 0.4, 0.32],
            [0.32, 0.93, 0.62, 0.5],
            [0.5, 1.0, 0.9, 0.75],
            [1.0, 1.0, 1.0, 0.97],
        ],
        extinction: &[
            [0.0, 0.0],
            [0.1, 0.0],
            [0.2, 6.0],
            [0.32, 12.0],
            [0.5, 60.0],
            [1.0, 200.0],
        ],
    },
    Preset {
        name: "grey",
        colour: &[[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]],
        extinction: &[[0.0, 0.0], [0.2, 4.0], [1.0, 30.0]],
    },
];

/// A colour map sampled at evenly spaced scalars.
struct ColourMap {
    name: &'static str,
    colours: Colours,
    nodes: usize,
    extinction: &'static [[f64; 2]],
}

/// Source of the colours of a [`ColourMap`].
#[derive(Clone, Copy)]
enum Colours {
    Gradient(Gradient),
    /// The `colorous` crate defines it in the opposite direction.
    Reversed(Gradient),
    Listed(&'static [[f64; 3]]),
}

/// Creates a sequential map; ColorBrewer's maps have 9 colours.
const fn sequential(name: &'static str, gradient: Gradient, nodes: usize) -> ColourMap {
    ColourMap {
        name,
        colours: Colours::Gradient(gradient),
        nodes,
        extinction: SEQUENTIAL_EXTINCTION,
    }
}

/// Creates one of ColorBrewer's diverging maps, with 11 colours.
const fn diverging(name: &'static str, gradient: Gradient) -> ColourMap {
    ColourMap {
        name,
        colours: Colours::Gradient(gradient),
        nodes: 11,
        extinction: DIVERGING_EXTINCTION,
    }
}

/// Colour maps under their matplotlib names.
const MAPS: [ColourMap; 34] = [
    sequential("viridis", colorous::VIRIDIS, 17),
    sequential("plasma", colorous::PLASMA, 17),
    sequential("inferno", colorous::INFERNO, 17),
    sequential("magma", colorous::MAGMA, 17),
    sequential("cividis", colorous::CIVIDIS, 17),
    sequential("turbo", colorous::TURBO, 33),
    sequential("Blues", colorous::BLUES, 9),
    sequential("Greens", colorous::GREENS, 9),
    sequential("Greys", colorous::GREYS, 9),
    sequential("Oranges", colorous::ORANGES, 9),
    sequential("Purples", colorous::PURPLES, 9),
    sequential("Reds", colorous::REDS, 9),
    sequential("BuGn", colorous::BLUE_GREEN, 9),
    sequential("BuPu", colorous::BLUE_PURPLE, 9),
    sequential("GnBu", colorous::GREEN_BLUE, 9),
    sequential("OrRd", colorous::ORANGE_RED, 9),
    sequential("PuBu", colorous::PURPLE_BLUE, 9),
    sequential("PuBuGn", colorous::PURPLE_BLUE_GREEN, 9),
    sequential("PuRd", colorous::PURPLE_RED, 9),
    sequential("RdPu", colorous::RED_PURPLE, 9),
    sequential("YlGn", colorous::YELLOW_GREEN, 9),
    sequential("YlGnBu", colorous::YELLOW_GREEN_BLUE, 9),
    sequential("YlOrBr", colorous::YELLOW_ORANGE_BROWN, 9),
    sequential("YlOrRd", colorous::YELLOW_ORANGE_RED, 9),
    ColourMap {
        name: "coolwarm",
        colours: Colours::Listed(&[
            [0.231, 0.298, 0.753],
            [0.553, 0.69, 0.996],
            [0.867, 0.863, 0.863],
            [0.957, 0.604, 0.482],
            [0.706, 0.016, 0.149],
        ]),
        nodes: 5,
        extinction: DIVERGING_EXTINCTION,
    },
    diverging("Spectral", colorous::SPECTRAL),
    diverging("RdBu", colorous::RED_BLUE),
    diverging("RdGy", colorous::RED_GREY),
    diverging("RdYlBu", colorous::RED_YELLOW_BLUE),
    diverging("RdYlGn", colorous::RED_YELLOW_GREEN),
    diverging("BrBG", colorous::BROWN_GREEN),
    diverging("PiYG", colorous::PINK_GREEN),
    diverging("PRGn", colorous::PURPLE_GREEN),
    ColourMap {
        colours: Colours::Reversed(colorous::PURPLE_ORANGE),
        ..diverging("PuOr", colorous::PURPLE_ORANGE)
    },
];
/// Name suffix of a reversed map, as in matplotlib.
const REVERSED_SUFFIX: &str = "_r";

impl ColourMap {
    /// Returns the map, reversed if requested.
    fn transfer(&self, reversed: bool) -> Result<TransferFunction> {
        let last = self.nodes - 1;
        let of = |gradient: Gradient, i: usize| {
            let colour = gradient.eval_rational(i, self.nodes);
            colour.into_array().map(|c| f64::from(c) / 255.0)
        };
        let node = |i: usize| {
            let from = if reversed { last - i } else { i };
            let [r, g, b] = match self.colours {
                Colours::Gradient(gradient) => of(gradient, from),
                Colours::Reversed(gradient) => of(gradient, last - from),
                Colours::Listed(colours) => colours[from],
            };
            [i as f64 / last as f64, r, g, b]
        };
        let colour = (0..self.nodes).map(node).collect();
        TransferFunction::relative(colour, self.extinction.to_vec())
    }
}

/// Returns the error for an unknown name, with the closest known name first, if there is one.
fn unknown(name: &str) -> Error {
    let lower = name.to_lowercase();
    let names = TransferFunction::preset_names();
    let near = names
        .iter()
        .map(|known| (strsim::osa_distance(&known.to_lowercase(), &lower), known))
        .min()
        .filter(|(distance, _)| *distance <= 1 + lower.len() / 4);
    let meant = near.map_or(String::new(), |(_, known)| {
        format!("did you mean \"{known}\"? ")
    });
    Error::Input(format!(
        "unknown transfer function preset \"{name}\"; {meant}available presets: {}; append _r to reverse a colour map, such as viridis_r",
        names.join(", ")
    ))
}

impl TransferFunction {
    /// Returns the preset `name`, relative to the field's range and the mesh's extent; the suffix
    /// `_r` reverses a colour map.
    ///
    /// # Errors
    /// An error for an unknown name; the message suggests the closest name and lists all.
    pub fn preset(name: &str) -> Result<TransferFunction> {
        let is = |known: &str, name: &str| known.eq_ignore_ascii_case(name);
        if let Some(preset) = PRESETS.iter().find(|p| is(p.name, name)) {
            return TransferFunction::relative(preset.colour.to_vec(), preset.extinction.to_vec());
        }
        if let Some((colour, extinction)) = tissue_optics::look(&name.to_lowercase()) {
            let [r, g, b] = colour;
            let ends = |k: f64| [k, r, g, b];
            let flat = vec![[0.0, extinction], [1.0, extinction]];
            return TransferFunction::relative(vec![ends(0.0), ends(1.0)], flat);
        }
        let map = |name: &str| MAPS.iter().find(|m| is(m.name, name));
        let reversed = name.strip_suffix(REVERSED_SUFFIX).and_then(map);
        match (map(name), reversed) {
            (Some(map), _) => map.transfer(false),
            (None, Some(map)) => map.transfer(true),
            (None, None) => Err(unknown(name)),
        }
    }

    /// Returns the names accepted by [`TransferFunction::preset`].
    pub fn preset_names() -> Vec<&'static str> {
        let own = PRESETS.iter().map(|p| p.name);
        own.chain(tissue_optics::names())
            .chain(MAPS.iter().map(|m| m.name))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn presets_are_valid_and_unknown_name_lists_them() {
        for name in TransferFunction::preset_names() {
            let tf = TransferFunction::preset(name)
                .unwrap()
                .to_absolute((0.0, 1.0), 1.0);
            assert!(
                tf.max_extinction() > 1.0,
                "{name} has too little extinction"
            );
        }
        let error = |name: &str| TransferFunction::preset(name).unwrap_err().to_string();
        let message = error("bones");
        assert!(message.contains("bone, muscle, skin"), "{message}");
        assert!(message.contains("did you mean \"bone\"?"), "{message}");
        assert!(error("virdis").contains("did you mean \"viridis\"?"));
        assert!(!error("something else").contains("did you mean"));
    }

    fn colours(name: &str, scalars: &[f64]) -> Vec<[u8; 3]> {
        let transfer = TransferFunction::preset(name).unwrap();
        let transfer = transfer.to_absolute((0.0, 1.0), 1.0);
        let bytes = |s: &f64| transfer.colour(*s).map(|c| (255.0 * c).round() as u8);
        scalars.iter().map(bytes).collect()
    }

    #[test]
    fn colour_maps_match_matplotlib() {
        // Values of `matplotlib.colormaps[name]([0.0, 0.5, 1.0])`.
        for (name, expected) in [
            ("viridis", [[68, 1, 84], [33, 145, 140], [253, 231, 37]]),
            ("magma", [[0, 0, 4], [183, 55, 121], [252, 253, 191]]),
            ("RdBu", [[103, 0, 31], [247, 247, 247], [5, 48, 97]]),
            ("PuOr", [[127, 59, 8], [247, 247, 247], [45, 0, 75]]),
            ("YlGn", [[255, 255, 229], [120, 198, 121], [0, 69, 41]]),
            ("Greys", [[255, 255, 255], [150, 150, 150], [0, 0, 0]]),
        ] {
            for (seen, expected) in colours(name, &[0.0, 0.5, 1.0]).iter().zip(expected) {
                let off = seen.iter().zip(expected).map(|(a, b)| a.abs_diff(b));
                assert!(off.max().unwrap() <= 2, "{name}: {seen:?} {expected:?}");
            }
        }
    }

    #[test]
    fn reversed_map_equals_map_read_backwards() {
        let scalars: Vec<f64> = (0..=20).map(|i| f64::from(i) / 20.0).collect();
        for name in ["viridis", "RdBu", "PuOr", "coolwarm"] {
            let mut backwards = colours(name, &scalars);
            backwards.reverse();
            for (a, b) in colours(&format!("{name}_r"), &scalars)
                .iter()
                .zip(&backwards)
            {
                // A value of one half may be rounded up or down.
                assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 1), "{name}");
            }
        }
        assert!(
            TransferFunction::preset("bone_r").is_err(),
            "a tissue preset has no reversed form"
        );
    }

    #[test]
    fn interpolated_maps_stay_close_to_originals() {
        for map in &MAPS[..6] {
            let Colours::Gradient(gradient) = map.colours else {
                unreachable!()
            };
            let scalars: Vec<f64> = (0..=100).map(|i| f64::from(i) / 100.0).collect();
            for (s, seen) in scalars.iter().zip(colours(map.name, &scalars)) {
                let true_one = gradient.eval_continuous(*s).into_array();
                let off = seen.iter().zip(true_one).map(|(a, b)| a.abs_diff(b));
                let off = off.max().unwrap();
                assert!(off <= 8, "{} at {s}: {off} of 255", map.name);
            }
        }
    }
}
