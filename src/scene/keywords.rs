//! Keyword entries of a scene, checked during deserialisation so that errors have their line
//! number.

use super::Unit;
use crate::annotate::Axes;
use crate::generate;
use crate::mesh::AnatomicalFrame;
use crate::physics::{EngineChoice, SolverKind};
use crate::render::{Light, TransferFunction, named_colour};
use crate::{Error, Result};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

/// Picture modes.
pub(super) const MODES: [&str; 8] = [
    "composite",
    "thickness",
    "mip",
    "minip",
    "mean",
    "xray",
    "surface",
    "skin",
];
/// Ray traversals of the tetrahedra.
pub(super) const TRAVERSALS: [&str; 2] = ["vertices", "planes"];
/// Models of light.
const LIGHT_MODELS: [&str; 2] = ["local", "path"];
/// Backgrounds of a picture.
pub(super) const BACKGROUNDS: [&str; 4] = ["gradient", "transparent", "black", "white"];
/// Boundaries between regions.
const BOUNDARIES: [&str; 2] = ["smooth", "tets"];
/// Kinds of axes.
const AXES: [&str; 2] = ["xyz", "anatomical"];
/// Kinds of spring damping.
pub(super) const DAMPING_KINDS: [&str; 2] = ["axial", "relative"];

/// Returns the error for a `word` that is not in `words`.
pub(super) fn unknown_keyword_error(what: &str, words: &[&str], word: &str) -> Error {
    let (last, rest) = words.split_last().unwrap_or((&"", &[]));
    Error::Input(format!(
        "unknown {what} \"{word}\"; use {} or {last}",
        rest.join(", ")
    ))
}

fn one_of(what: &str, words: &[&str], word: &str) -> Result<()> {
    match words.contains(&word) {
        true => Ok(()),
        false => Err(unknown_keyword_error(what, words, word)),
    }
}

type Entry<T, E> = std::result::Result<Option<T>, E>;

fn checked<'de, D: Deserializer<'de>>(
    from: D,
    check: impl Fn(&str) -> Result<()>,
) -> Entry<String, D::Error> {
    let word = String::deserialize(from)?;
    check(&word).map_err(D::Error::custom)?;
    Ok(Some(word))
}

pub(super) fn mode<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| one_of("mode", &MODES, word))
}

pub(super) fn traversal<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| one_of("traversal", &TRAVERSALS, word))
}

pub(super) fn background<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| one_of("background", &BACKGROUNDS, word))
}

pub(super) fn light_model<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| one_of("model of light", &LIGHT_MODELS, word))
}

pub(super) fn boundaries<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| one_of("boundaries", &BOUNDARIES, word))
}

pub(super) fn damping_kind<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| one_of("damping kind", &DAMPING_KINDS, word))
}

pub(super) fn solver<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| word.parse::<SolverKind>().map(drop))
}

pub(super) fn engine<'de, D: Deserializer<'de>>(from: D) -> Entry<EngineChoice, D::Error> {
    let word = String::deserialize(from)?;
    word.parse().map(Some).map_err(D::Error::custom)
}

/// Deserialises a light: a keyword, or the direction to the light.
pub(super) fn light<'de, D: Deserializer<'de>>(from: D) -> Entry<Light, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "light must be \"head\", \"none\", or a direction [x, y, z] towards it"
    )]
    enum LightValue {
        Word(String),
        Direction([f64; 3]),
    }
    let light = match LightValue::deserialize(from)? {
        LightValue::Word(word) => word.parse(),
        LightValue::Direction([x, y, z]) => format!("{x},{y},{z}").parse(),
    };
    light.map(Some).map_err(D::Error::custom)
}

/// Deserialises axes: a keyword, or whether to draw them.
pub(super) fn axes<'de, D: Deserializer<'de>>(from: D) -> Entry<Axes, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "axes must be true, false, \"xyz\" or \"anatomical\""
    )]
    enum AxesValue {
        Drawn(bool),
        Word(String),
    }
    match AxesValue::deserialize(from)? {
        AxesValue::Drawn(drawn) => Ok(drawn.then_some(Axes::Xyz)),
        AxesValue::Word(word) => match word.as_str() {
            "xyz" => Ok(Some(Axes::Xyz)),
            "anatomical" => Ok(Some(Axes::Anatomical)),
            other => Err(D::Error::custom(unknown_keyword_error(
                "axes", &AXES, other,
            ))),
        },
    }
}

pub(super) fn generator<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, generate::check_name)
}

/// Checks a transfer function: a preset, JSON, or the name of a JSON file, which is read later.
pub(super) fn transfer<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| match word {
        json if json.trim_start().starts_with('{') => TransferFunction::from_json(json).map(drop),
        file if file.ends_with(".json") => Ok(()),
        name => TransferFunction::preset(name).map(drop),
    })
}

/// Checks a colour name or `#RRGGBB`.
pub(super) fn colour<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| named_colour(word).map(drop))
}

pub(super) fn preset<'de, D: Deserializer<'de>>(from: D) -> Entry<String, D::Error> {
    checked(from, |word| TransferFunction::preset(word).map(drop))
}

/// Parses the name of a frame of reference.
pub(super) fn frame<'de, D: Deserializer<'de>>(from: D) -> Entry<AnatomicalFrame, D::Error> {
    let name = String::deserialize(from)?;
    name.parse().map(Some).map_err(D::Error::custom)
}

pub(super) fn unit<'de, D: Deserializer<'de>>(from: D) -> Entry<Unit, D::Error> {
    let unit = Unit::deserialize(from)?;
    unit.metres().map_err(D::Error::custom)?;
    Ok(Some(unit))
}

/// Checks a fraction of the bounds along an axis, as in `below` and `above` of a region.
pub(super) fn fraction<'de, D: Deserializer<'de>>(from: D) -> Entry<f64, D::Error> {
    let share = f64::deserialize(from)?;
    check_fraction(share).map_err(D::Error::custom)?;
    Ok(Some(share))
}

/// Checks that `share` lies between 0 and 1.
pub(super) fn check_fraction(share: f64) -> Result<()> {
    match (0.0..=1.0).contains(&share) {
        true => Ok(()),
        false => Err(Error::Input(format!(
            "a fraction of the bounds along `axis` must be in [0, 1], got {share}; for a coordinate in the mesh's unit use x_below, x_above, y_below, y_above, z_below or z_above, without `axis`"
        ))),
    }
}
