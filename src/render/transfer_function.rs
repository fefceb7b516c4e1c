//! Transfer functions: colour and extinction as functions of a scalar.

use crate::{Error, Result, files};
use serde::Deserialize;
use std::path::Path;

/// Colour and extinction as piecewise linear functions of a scalar.
///
/// The file form is JSON, `{"colour": [[s, r, g, b], …], "extinction": [[s, per_length], …]}`; the
/// two lists may have different nodes, and are constant beyond their ends. Extinction is per length
/// unit of the mesh file. Presets are relative, as are files with `"relative": true`: the scalar is
/// normalised to 0…1 over the field's range, and extinction is per extent of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    colour: Vec<[f64; 4]>,
    extinction: Vec<[f64; 2]>,
    relative: bool,
}

/// A [`TransferFunction`] in absolute units, for one field of one mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct AbsoluteTransferFunction {
    colour: Vec<[f64; 4]>,
    extinction: Vec<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TransferFile {
    colour: Vec<[f64; 4]>,
    extinction: Vec<[f64; 2]>,
    #[serde(default)]
    relative: bool,
}

impl TransferFunction {
    /// Creates a transfer function in absolute units: colour nodes (s, r, g, b) and extinction
    /// nodes (s, extinction per length unit of the mesh file).
    ///
    /// # Errors
    /// An error if a list is empty, not sorted by scalar, or contains a non-finite number, a
    /// negative extinction or a negative colour; the message names the entry.
    pub fn new(colour: Vec<[f64; 4]>, extinction: Vec<[f64; 2]>) -> Result<TransferFunction> {
        check("colour", &colour)?;
        check("extinction", &extinction)?;
        Ok(TransferFunction {
            colour,
            extinction,
            relative: false,
        })
    }

    /// As [`TransferFunction::new`], with scalars from 0 to 1 over the range of the field, and
    /// extinction per extent (longest side of the bounds) of the mesh.
    ///
    /// # Errors
    /// As [`TransferFunction::new`].
    pub fn relative(colour: Vec<[f64; 4]>, extinction: Vec<[f64; 2]>) -> Result<TransferFunction> {
        let absolute = TransferFunction::new(colour, extinction)?;
        Ok(TransferFunction {
            relative: true,
            ..absolute
        })
    }

    /// Parses the JSON form.
    ///
    /// # Errors
    /// An error if the text is not JSON of this form, or as [`TransferFunction::new`].
    pub fn from_json(text: &str) -> Result<TransferFunction> {
        let file: TransferFile = serde_json::from_str(text).map_err(|e| {
            Error::Input(format!(
                "transfer function: {e}; expected {{\"colour\": [[s, r, g, b], …], \
                 \"extinction\": [[s, per_length], …]}}"
            ))
        })?;
        match file.relative {
            true => TransferFunction::relative(file.colour, file.extinction),
            false => TransferFunction::new(file.colour, file.extinction),
        }
    }

    /// Reads the JSON form from a file.
    ///
    /// # Errors
    /// An error if the file cannot be read, or as [`TransferFunction::from_json`].
    pub fn read(path: impl AsRef<Path>) -> Result<TransferFunction> {
        let path = path.as_ref();
        let text = files::read_text(path)?;
        TransferFunction::from_json(&text).map_err(|e| Error::format(path, e.to_string()))
    }

    /// Converts to absolute units for a field with values in `range` on a mesh of extent `size`
    /// (longest side of its bounds, in file units).
    pub fn to_absolute(&self, range: (f64, f64), size: f64) -> AbsoluteTransferFunction {
        let (mut colour, mut extinction) = (self.colour.clone(), self.extinction.clone());
        if self.relative {
            let scalar = |s: f64| range.0 + s * (range.1 - range.0);
            colour.iter_mut().for_each(|node| node[0] = scalar(node[0]));
            for node in &mut extinction {
                *node = [scalar(node[0]), node[1] / size.max(f64::MIN_POSITIVE)];
            }
        }
        AbsoluteTransferFunction { colour, extinction }
    }

    /// Returns the same colours with every extinction multiplied by `factor`.
    pub fn scale_extinction(&self, factor: f64) -> TransferFunction {
        let mut denser = self.clone();
        denser.extinction.iter_mut().for_each(|n| n[1] *= factor);
        denser
    }

    /// Returns the same extinction with a constant colour.
    pub fn with_colour(&self, [r, g, b]: [f64; 3]) -> TransferFunction {
        TransferFunction {
            colour: vec![[0.0, r, g, b]],
            ..self.clone()
        }
    }

    /// Returns the same colours with the constant extinction `density` per length unit, for a mesh
    /// of extent `size` (longest side of its bounds).
    pub fn with_constant_extinction(&self, density: f64, size: f64) -> TransferFunction {
        let unit = if self.relative { size } else { 1.0 };
        TransferFunction {
            extinction: vec![[0.0, density * unit]],
            ..self.clone()
        }
    }
}

/// Parses a CSS colour name or `#RRGGBB`; returns red, green and blue from 0 to 1.
pub(crate) fn named_colour(name: &str) -> Result<[f64; 3]> {
    let colour = csscolorparser::parse(name).map_err(|_| {
        Error::Input(format!(
            "unknown colour \"{name}\"; give a CSS name or #RRGGBB, such as tomato or #d04030"
        ))
    })?;
    let [r, g, b, _] = colour.to_array();
    Ok([r, g, b].map(f64::from))
}

impl AbsoluteTransferFunction {
    /// Creates a white transfer function of constant extinction.
    pub(super) fn constant(extinction: f64) -> AbsoluteTransferFunction {
        AbsoluteTransferFunction {
            colour: vec![[0.0, 1.0, 1.0, 1.0]],
            extinction: vec![[0.0, extinction]],
        }
    }

    /// Returns the colour nodes: (s, red, green, blue).
    pub fn colour_nodes(&self) -> &[[f64; 4]] {
        &self.colour
    }

    /// Returns the extinction nodes: (s, extinction per length unit of the mesh file).
    pub fn extinction_nodes(&self) -> &[[f64; 2]] {
        &self.extinction
    }

    /// Returns red, green and blue at scalar `s`.
    pub fn colour(&self, s: f64) -> [f64; 3] {
        let [_, r, g, b] = interpolated(&self.colour, s);
        [r, g, b]
    }

    /// Returns the extinction at scalar `s`, per length unit of the mesh file.
    pub fn extinction(&self, s: f64) -> f64 {
        interpolated(&self.extinction, s)[1]
    }

    /// Returns the maximum extinction over all scalars.
    pub fn max_extinction(&self) -> f64 {
        self.extinction.iter().map(|n| n[1]).fold(0.0, f64::max)
    }

    /// Returns the maximum extinction for scalars from `low` to `high`.
    pub fn max_extinction_between(&self, low: f64, high: f64) -> f64 {
        let inside = self
            .extinction
            .iter()
            .filter(|n| n[0] >= low && n[0] <= high);
        let ends = self.extinction(low).max(self.extinction(high));
        inside.map(|n| n[1]).fold(ends, f64::max)
    }

    /// Returns the scalars of all colour and extinction nodes, sorted and without duplicates.
    pub fn breakpoints(&self) -> Vec<f64> {
        let mut nodes: Vec<f64> = self.colour.iter().map(|n| n[0]).collect();
        nodes.extend(self.extinction.iter().map(|n| n[0]));
        nodes.sort_by(f64::total_cmp);
        nodes.dedup();
        nodes
    }
}

/// Validates one list of nodes; each is a scalar followed by its values.
fn check<const N: usize>(name: &str, nodes: &[[f64; N]]) -> Result<()> {
    let wrong = |i: usize, what: &str| {
        Err(Error::Input(format!(
            "transfer function: {name} entry {} ({:?}) {what}",
            i + 1,
            nodes[i]
        )))
    };
    if nodes.is_empty() {
        return Err(Error::Input(format!(
            "transfer function: the {name} list is empty; it needs at least one entry"
        )));
    }
    for (i, node) in nodes.iter().enumerate() {
        if node.iter().any(|x| !x.is_finite() || x.abs() > 1e30) {
            return wrong(i, "has a non-finite value");
        }
        if node[1..].iter().any(|x| *x < 0.0) {
            return wrong(i, "has a negative value; values must be ≥ 0");
        }
        if i > 0 && node[0] < nodes[i - 1][0] {
            return wrong(
                i,
                "has a smaller scalar than the previous entry; sort the list by scalar",
            );
        }
    }
    Ok(())
}

/// Interpolates `nodes` linearly at `s`, constant beyond the ends. Two nodes with the same scalar
/// define a jump, where the later node applies.
fn interpolated<const N: usize>(nodes: &[[f64; N]], s: f64) -> [f64; N] {
    let after = nodes.partition_point(|n| n[0] <= s);
    if after == 0 {
        return nodes[0];
    }
    if after == nodes.len() {
        return nodes[after - 1];
    }
    let (a, b) = (nodes[after - 1], nodes[after]);
    let w = (s - a[0]) / (b[0] - a[0]);
    std::array::from_fn(|k| a[k] + w * (b[k] - a[k]))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn colour_and_extinction_are_interpolated_independently() {
        let tf = TransferFunction::from_json(
            r#"{"colour": [[0, 1, 0, 0], [10, 0, 1, 0.5]], "extinction": [[4, 0], [6, 2], [8, 0]]}"#,
        )
        .unwrap()
        .to_absolute((0.0, 1.0), 1.0);
        assert_eq!(tf.colour(5.0), [0.5, 0.5, 0.25]);
        assert_eq!(tf.colour(-1.0), [1.0, 0.0, 0.0]);
        assert_eq!(tf.colour(11.0), [0.0, 1.0, 0.5]);
        assert_eq!(
            [5.0, 6.0, 7.5, 9.0].map(|s| tf.extinction(s)),
            [1.0, 2.0, 0.5, 0.0]
        );
        assert_eq!(tf.breakpoints(), [0.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(tf.max_extinction(), 2.0);
    }

    #[test]
    fn invalid_entries_are_rejected_by_name() {
        let error = |json: &str| TransferFunction::from_json(json).unwrap_err().to_string();
        let colour = r#""colour": [[0, 1, 1, 1]]"#;
        for (json, expected) in [
            (r#"{"extinction": [[0, 1], [2, -1]]"#, "extinction entry 2"),
            (r#"{"extinction": [[1, 1], [0, 1]]"#, "extinction entry 2"),
            (r#"{"extinction": []"#, "extinction list is empty"),
            (r#"{"extinction": [[0, 1e999]]"#, "number out of range"),
            (r#"{"opacity": [[0, 1]]"#, "unknown field `opacity`"),
        ] {
            let message = error(&format!("{json}, {colour}}}"));
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn relative_function_scales_with_range_and_size() {
        let tf = TransferFunction::relative(
            vec![[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0]],
            vec![[0.5, 8.0]],
        )
        .unwrap();
        let absolute = tf.to_absolute((100.0, 300.0), 4.0);
        assert_eq!(absolute.colour(200.0), [0.5; 3]);
        assert_eq!(absolute.extinction(0.0), 2.0);
    }
}
