//! Lists of numbers in flags.

use std::str::FromStr;

/// Two numbers separated by a comma, the smaller first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair(pub [f64; 2]);

pub fn pair(text: &str) -> Result<Pair, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.ok().map(<[f64; 2]>::try_from) {
        Some(Ok([low, high])) if low < high && (high - low).is_finite() => Ok(Pair([low, high])),
        _ => Err("expected two numbers LOW,HIGH, the smaller first".into()),
    }
}

/// Three numbers separated by commas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triple(pub [f64; 3]);

pub fn triple(text: &str) -> Result<Triple, String> {
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

pub fn six(text: &str) -> Result<Six, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.ok().map(<[f64; 6]>::try_from) {
        Some(Ok(six)) if six.iter().all(|x| x.is_finite()) => Ok(Six(six)),
        _ => Err(
            "expected six finite numbers: x,y,z,nx,ny,nz of a plane, x,y,z,x,y,z of a box".into(),
        ),
    }
}

pub fn size(text: &str) -> Result<[u32; 2], String> {
    let expected = || "expected WIDTHxHEIGHT in pixels, such as 1024x768".to_owned();
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(expected)?;
    match (width.trim().parse(), height.trim().parse()) {
        (Ok(w), Ok(h)) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err(expected()),
    }
}
