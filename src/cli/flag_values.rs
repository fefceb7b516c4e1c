//! Values of flags and their parsers.

use palpate::annotate::Axes;
use palpate::scene::Unit;
use std::str::FromStr;

/// Two numbers separated by a comma, the smaller first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair(pub [f64; 2]);

/// Reads LOW,HIGH.
pub(super) fn pair(text: &str) -> Result<Pair, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.ok().map(<[f64; 2]>::try_from) {
        Some(Ok([low, high])) if low < high && (high - low).is_finite() => Ok(Pair([low, high])),
        _ => Err("expected two numbers LOW,HIGH, the smaller first".into()),
    }
}

/// Three numbers separated by commas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub [f64; 3]);

/// Reads x,y,z.
pub(super) fn triple(text: &str) -> Result<Triple, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|t| f64::from_str(t.trim()).map_err(|_| format!("\"{t}\" is not a number")))
        .collect::<Result<_, _>>()?;
    match <[f64; 3]>::try_from(numbers) {
        Ok(three) if three.iter().all(|x| x.is_finite()) => Ok(Triple(three)),
        _ => Err("expected three finite numbers x,y,z".into()),
    }
}

/// Six numbers separated by commas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Six(pub [f64; 6]);

/// Reads six numbers of a plane or a box.
pub(super) fn six(text: &str) -> Result<Six, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.ok().map(<[f64; 6]>::try_from) {
        Some(Ok(six)) if six.iter().all(|x| x.is_finite()) => Ok(Six(six)),
        _ => Err(
            "expected six finite numbers: x,y,z,nx,ny,nz of a plane, x,y,z,x,y,z of a box".into(),
        ),
    }
}

/// Reads the kind of axes.
pub(super) fn axes(text: &str) -> Result<Axes, String> {
    match text {
        "xyz" => Ok(Axes::Xyz),
        "anatomical" => Ok(Axes::Anatomical),
        _ => Err("axes must be xyz (the default) or anatomical".into()),
    }
}

/// Reads WIDTHxHEIGHT.
pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let expected = || "expected WIDTHxHEIGHT in pixels, such as 1024x768".to_owned();
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(expected)?;
    match (width.trim().parse(), height.trim().parse()) {
        (Ok(w), Ok(h)) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err(expected()),
    }
}

/// Reads a unit of length, by name or in metres.
pub(super) fn unit(text: &str) -> Result<Unit, String> {
    let unit = match text.parse() {
        Ok(metres) => Unit::Metres(metres),
        Err(_) => Unit::Name(text.to_owned()),
    };
    unit.metres().map(|_| unit).map_err(|e| e.to_string())
}
