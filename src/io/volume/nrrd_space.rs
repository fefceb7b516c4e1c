//! Spatial axes of a NRRD, and conversion of its frame to RAS in mm.

use super::nrrd::Header;
use crate::io::cursor::ParseResult;
use glam::{DAffine3, DMat3, DVec3};

/// The three spatial axes.
pub(super) struct Axes {
    pub size: [usize; 3],
    pub to_world: DAffine3,
}

impl Axes {
    pub fn new(header: &Header) -> ParseResult<Axes> {
        let (line, sizes) = header.require("sizes")?;
        let sizes: Vec<usize> = sizes
            .split_whitespace()
            .map(|w| w.parse().ok().filter(|n| *n > 0))
            .collect::<Option<_>>()
            .ok_or_else(|| format!("line {line}: `sizes` must be integers ≥ 1, got \"{sizes}\""))?;
        if let Some(dimension) = header.number("dimension")?
            && dimension != sizes.len()
        {
            return Err(format!(
                "line {line}: `dimension` is {dimension}, but `sizes` has {} numbers",
                sizes.len()
            ));
        }
        let directions = match header.get("space directions") {
            Some((line, text)) => Some(vectors(line, text, sizes.len())?),
            None => None,
        };
        // A non-spatial axis must have one sample only.
        let in_space: Vec<usize> = match &directions {
            Some(directions) => (0..sizes.len())
                .filter(|a| directions[*a].is_some())
                .collect(),
            None if sizes.len() > 3 => (0..sizes.len()).filter(|a| sizes[*a] > 1).collect(),
            None => (0..sizes.len()).collect(),
        };
        let beside: usize = (0..sizes.len())
            .filter(|a| !in_space.contains(a))
            .map(|a| sizes[a])
            .product();
        let &[i, j, k] = in_space.as_slice() else {
            return Err(format!(
                "line {line}: expected three spatial axes, got {} of sizes {sizes:?}",
                in_space.len()
            ));
        };
        if beside != 1 {
            return Err(format!(
                "line {line}: sizes {sizes:?} have several values per voxel; only scalar volumes \
                are supported (extract one with `unu slice`)"
            ));
        }
        let axes = [i, j, k];
        let columns = match &directions {
            Some(directions) => axes.map(|a| directions[a].unwrap_or(DVec3::ZERO)),
            None => {
                let spacings = header.spacings(sizes.len())?;
                let mut unit = [DVec3::X, DVec3::Y, DVec3::Z].into_iter();
                axes.map(|a| unit.next().unwrap_or(DVec3::ZERO) * spacings[a])
            }
        };
        let origin = match header.get("space origin") {
            Some((line, text)) => vectors(line, text, 1)?[0].unwrap_or(DVec3::ZERO),
            None if directions.is_none() => {
                let starts = header.axis_starts(sizes.len())?;
                let along = [0, 1, 2].map(|n| columns[n] * starts[axes[n]]);
                along[0] + along[1] + along[2]
            }
            None => DVec3::ZERO,
        };
        let to_ras = to_ras(header)?;
        let linear = to_ras * DMat3::from_cols(columns[0], columns[1], columns[2]);
        if linear.determinant() == 0.0 || !linear.is_finite() {
            return Err("voxels have zero volume; check `space directions` or `spacings`".into());
        }
        Ok(Axes {
            size: axes.map(|a| sizes[a]),
            to_world: DAffine3::from_mat3_translation(linear, to_ras * origin),
        })
    }
}

impl Header {
    /// Returns the spacing of each axis, 1 if unknown.
    fn spacings(&self, axes: usize) -> ParseResult<Vec<f64>> {
        let Some((line, text)) = self.get("spacings") else {
            return Ok(vec![1.0; axes]);
        };
        let spacings: Vec<f64> = text
            .split_whitespace()
            .map_while(|w| w.parse().ok())
            .map(|s: f64| if s.is_nan() { 1.0 } else { s })
            .collect();
        if spacings.len() != axes || spacings.iter().any(|s| !s.is_finite() || *s == 0.0) {
            return Err(format!(
                "line {line}: `spacings` must be {axes} numbers other than 0, got \"{text}\""
            ));
        }
        Ok(spacings)
    }
}

impl Header {
    /// Returns the position of the first sample of each axis, in samples: from `axis mins`, which
    /// is the border of the first cell if `centers` states so; 0 by default.
    fn axis_starts(&self, axes: usize) -> ParseResult<Vec<f64>> {
        let named = self.get("axis mins").or_else(|| self.get("axismins"));
        let Some((line, text)) = named else {
            return Ok(vec![0.0; axes]);
        };
        let mins: Option<Vec<f64>> = text
            .split_whitespace()
            .map(|w| w.parse().ok().filter(|m: &f64| !m.is_infinite()))
            .collect();
        let mins = mins.filter(|m| m.len() == axes).ok_or_else(|| {
            format!("line {line}: `axis mins` must be {axes} numbers, got \"{text}\"")
        })?;
        let centers = self.get("centers").or_else(|| self.get("centerings"));
        let mut centers = centers.map_or("", |c| c.1).split_whitespace();
        let starts = mins.into_iter().zip(self.spacings(axes)?);
        Ok(starts
            .map(|(min, spacing)| {
                let half = match centers.next() {
                    Some("cell") => 0.5,
                    _ => 0.0,
                };
                if min.is_nan() {
                    0.0
                } else {
                    min / spacing + half
                }
            })
            .collect())
    }
}

/// Parses `count` vectors such as `(1,0,0)`; `none` for an axis that is not spatial.
fn vectors(line: usize, text: &str, count: usize) -> ParseResult<Vec<Option<DVec3>>> {
    let wrong = || {
        format!(
            "line {line}: expected {count} vectors of three numbers, such as (0.5,0,0), found \
            \"{text}\""
        )
    };
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            found.push(None);
            rest = after.trim_start();
            continue;
        }
        let inner = rest.strip_prefix('(').ok_or_else(wrong)?;
        let (inner, after) = inner.split_once(')').ok_or_else(wrong)?;
        let numbers: Vec<f64> = inner
            .split(',')
            .map(|w| w.trim().parse().ok())
            .collect::<Option<_>>()
            .ok_or_else(wrong)?;
        let three: [f64; 3] = numbers.try_into().map_err(|_| wrong())?;
        found.push(Some(DVec3::from(three)).filter(|v| v.is_finite()));
        rest = after.trim_start();
    }
    match found.len() == count {
        true => Ok(found),
        false => Err(wrong()),
    }
}

/// Returns the map from the header's space, in its units, to RAS in mm.
fn to_ras(header: &Header) -> ParseResult<DMat3> {
    let signs = match header.get("space") {
        // Unspecified: coordinates are used as they are.
        None => DVec3::ONE,
        Some((line, name)) => match name.to_lowercase().as_str() {
            "right-anterior-superior" | "ras" | "scanner-xyz" | "3d-right-handed" => DVec3::ONE,
            "left-anterior-superior" | "las" => DVec3::new(-1.0, 1.0, 1.0),
            "left-posterior-superior" | "lps" => DVec3::new(-1.0, -1.0, 1.0),
            "3d-left-handed" => DVec3::new(1.0, 1.0, -1.0),
            other => {
                return Err(format!(
                    "line {line}: space \"{other}\" is not supported; use a three-dimensional \
                    space without time (for example left-posterior-superior)"
                ));
            }
        },
    };
    // Without a space the axes themselves have units.
    let units = header.get("space units").or_else(|| header.get("units"));
    let unit = match units {
        None => 1.0,
        Some((line, text)) => {
            let mut names = text.split('"').skip(1).step_by(2).map(str::trim);
            let name = names.next().unwrap_or(text).trim();
            if let Some(other) = names.find(|n| *n != name && !n.is_empty()) {
                return Err(format!(
                    "line {line}: axes must have the same unit, got \"{name}\" and \"{other}\""
                ));
            }
            match crate::mesh::metres_in(name) {
                Some(metres) => metres * 1e3,
                None if name.is_empty() || name == "???" => 1.0,
                None => {
                    return Err(format!(
                        "line {line}: `space units` must be mm, cm, m or um, got \"{name}\""
                    ));
                }
            }
        }
    };
    Ok(DMat3::from_diagonal(signs * unit))
}
