//! Spatial axes of a NRRD, and conversion of its frame to RAS in mm.

use super::nrrd::Header;
use crate::io::cursor::ParseResult;
use glam::{DAffine3, DMat3, DVec3};

/// The three spatial axes, and one of several volumes.
pub(super) struct Axes {
    pub size: [usize; 3],
    pub to_world: DAffine3,
    /// Number of volumes: layers, times or components.
    pub count: usize,
    /// Number of values of a volume that precede those of the next.
    pub faster: usize,
}

impl Axes {
    /// Long because it reads every key of the space.
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
        let kinds = header.kinds(sizes.len());
        let spatial = |axis: usize| match (&directions, kinds.as_deref()) {
            (Some(directions), _) => directions[axis].is_some(),
            (None, Some(kinds)) if sizes.len() > 3 => {
                matches!(kinds[axis].as_str(), "domain" | "space" | "???" | "none")
            }
            _ => sizes.len() <= 3 || sizes[axis] > 1,
        };
        let in_space: Vec<usize> = (0..sizes.len()).filter(|a| spatial(*a)).collect();
        let &[i, j, k] = in_space.as_slice() else {
            return Err(format!(
                "line {line}: expected three spatial axes, got {} of sizes {sizes:?}",
                in_space.len()
            ));
        };
        let beside = |a: &usize| !in_space.contains(a) && sizes[*a] > 1;
        let beside: Vec<usize> = (0..sizes.len()).filter(beside).collect();
        let (count, faster) = match beside.as_slice() {
            [] => (1, 1),
            [axis] => {
                let faster = sizes[..*axis]
                    .iter()
                    .try_fold(1usize, |n, s| n.checked_mul(*s));
                let faster = faster.ok_or_else(|| format!("line {line}: `sizes` are too large"))?;
                (sizes[*axis], faster)
            }
            _ => {
                return Err(format!(
                    "line {line}: sizes {sizes:?} have several values per voxel in more than one \
                    axis; extract a volume with `unu slice`"
                ));
            }
        };
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
        let to_ras = to_ras(header, axes)?;
        let linear = to_ras * DMat3::from_cols(columns[0], columns[1], columns[2]);
        if linear.determinant() == 0.0 || !linear.is_finite() {
            return Err("voxels have zero volume; check `space directions` or `spacings`".into());
        }
        Ok(Axes {
            size: axes.map(|a| sizes[a]),
            to_world: DAffine3::from_mat3_translation(linear, to_ras * origin),
            count,
            faster,
        })
    }
}

impl Header {
    /// Returns the kind of each axis in lower case, if they are stated.
    fn kinds(&self, axes: usize) -> Option<Vec<String>> {
        let (_, text) = self.get("kinds")?;
        let kinds = text.split_whitespace().map(str::to_lowercase);
        Some(kinds.collect::<Vec<_>>()).filter(|kinds| kinds.len() == axes)
    }

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

/// Returns a unit of length in mm, by any of its usual names.
fn millimetres_in(name: &str) -> Option<f64> {
    let name = name.trim().to_lowercase();
    let long = match name.as_str() {
        "" | "???" | "none" | "unknown" => return Some(1.0),
        "micron" | "microns" | "\u{3bc}m" | "mum" | "usm" => "um",
        "inch" | "inches" => "in",
        "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => return Some(1e-6),
        "angstrom" | "angstroms" | "\u{e5}" => return Some(1e-7),
        other => {
            let other = other.strip_suffix('s').unwrap_or(other);
            let stem = other
                .strip_suffix("meter")
                .or_else(|| other.strip_suffix("metre"));
            match stem.map(|stem| stem.trim_end_matches([' ', '-'])) {
                Some("milli") => "mm",
                Some("centi") => "cm",
                Some("deci") => return Some(1e2),
                Some("micro") => "um",
                Some("") => "m",
                _ => other,
            }
        }
    };
    crate::mesh::metres_in(long).map(|metres| metres * 1e3)
}

/// Returns the map from the header's space, in its units, to RAS in mm.
fn to_ras(header: &Header, axes: [usize; 3]) -> ParseResult<DMat3> {
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
    Ok(DMat3::from_diagonal(signs * unit(header, axes)?))
}

/// Returns the unit of the header's space in mm. Without a space the axes themselves have units.
fn unit(header: &Header, axes: [usize; 3]) -> ParseResult<f64> {
    let space = header.get("space units");
    let Some((line, text)) = space.or_else(|| header.get("units")) else {
        return Ok(1.0);
    };
    let mut names: Vec<&str> = match text.contains('"') {
        true => text.split('"').skip(1).step_by(2).collect(),
        false => text.split_whitespace().collect(),
    };
    if space.is_none() && axes.iter().all(|a| *a < names.len()) {
        names = axes.iter().map(|a| names[*a]).collect();
    }
    let mut found: Option<(&str, f64)> = None;
    for name in names {
        let unit = millimetres_in(name).ok_or_else(|| {
            format!(
                "line {line}: `space units` must be a unit of length (mm, cm, m, um, nm or in), \
                got \"{name}\""
            )
        })?;
        match found {
            _ if name.trim().is_empty() => {}
            None => found = Some((name, unit)),
            Some((first, other)) if (other / unit - 1.0).abs() > 1e-9 => {
                return Err(format!(
                    "line {line}: axes must have the same unit, got \"{first}\" and \"{name}\""
                ));
            }
            Some(_) => {}
        }
    }
    Ok(found.map_or(1.0, |(_, unit)| unit))
}
