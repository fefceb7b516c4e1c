//! Fields computed from the simulated body, for drawing and output.

use super::stage::{NodeSource, Stage};
use super::{Motion, ScalarField, Scene};
use crate::mesh::{Field, Location, ScalarType};
use crate::number_format::significant;
use crate::physics::BodyField;
use crate::render::TransferFunction;
use crate::{Error, Result};

/// Default colours of a computed field.
const COLOURS: &str = "viridis";

/// A field that is recomputed for each picture.
#[derive(Clone, Debug)]
pub(super) struct ComputedField {
    pub(super) field: BodyField,
    /// Version of the nodes for which it was computed.
    version: Option<u64>,
    /// Whether the scene sets its range.
    given: bool,
    /// Range of its values so far.
    pub(super) observed_range: (f64, f64),
    /// Largest rounding error of its values.
    rounding: f64,
}

impl ComputedField {
    /// Returns the computed field set in `scene`, with its values in the current configuration of
    /// `drive`; `None` if the scene's field is not a computed one.
    pub fn new(scene: &Scene, drive: &NodeSource) -> Result<Option<(ComputedField, ScalarField)>> {
        let named = scene.picture.field.as_deref();
        let (Some(name), NodeSource::Simulated(motion)) = (named, drive) else {
            return Ok(None);
        };
        let Ok(field) = name.parse::<BodyField>() else {
            return Ok(None);
        };
        let body = motion.simulator.as_ref();
        let values = field.per_node(body)?;
        let found = range(&values);
        let shown = ComputedField {
            field,
            version: None,
            given: scene.picture.range.is_some(),
            observed_range: found,
            rounding: field.noise_floor(body),
        };
        let own = [Location::Node, Location::Cell];
        let own = own.iter().any(|at| body.mesh().field(name, *at).is_some());
        let mut note = match scene.picture.range {
            Some(_) => None,
            None => Some(format!(
                "{name} is drawn over its range so far; set one range for all pictures with --range LOW,HIGH"
            )),
        };
        if own {
            let also = format!(
                "{name} is computed from the deformation; the mesh field of that name is ignored"
            );
            note = Some(note.map_or(also.clone(), |n| format!("{n}; {also}")));
        }
        let scalars = ScalarField {
            name: name.to_owned(),
            values,
            cells: None,
            range: scene.picture.range.map_or(shown.range(), |[a, b]| (a, b)),
            note,
            transfer: Some(TransferFunction::preset(COLOURS)?),
            regions: Vec::new(),
        };
        Ok(Some((shown, scalars)))
    }

    /// Returns the range of its values so far, at least as wide as the rounding error.
    fn range(&self) -> (f64, f64) {
        let (low, high) = self.observed_range;
        let least = self.rounding.max(f64::MIN_POSITIVE);
        (
            low,
            if high - low > least {
                high
            } else {
                low + least
            },
        )
    }
}

/// Computes the output fields of the scene from the current state of `motion`.
pub(super) fn output_fields(scene: &Scene, motion: &Motion) -> Result<Vec<Field>> {
    let mut fields = Vec::new();
    for (field, location) in wanted(scene)? {
        // Displacements are vectors at all nodes and are always written.
        if field == BodyField::Displacement {
            continue;
        }
        let body = motion.simulator.as_ref();
        let values = match location {
            Location::Node => field.per_node(body)?,
            Location::Cell => field.per_tet(body)?,
        };
        fields.push(Field {
            scalar_type: ScalarType::F32,
            ..Field::scalar(field.name(), location, values)
        });
    }
    Ok(fields)
}

/// Returns the output fields of a scene.
fn wanted(scene: &Scene) -> Result<Vec<(BodyField, Location)>> {
    let parse = |name: &String| match name.strip_suffix("@nodes") {
        Some(name) => Ok((name.parse()?, Location::Node)),
        None => Ok((name.parse()?, Location::Cell)),
    };
    scene.output.fields.iter().map(parse).collect()
}

/// Checks that the body has the output fields of the scene.
pub(super) fn check_output_fields(scene: &Scene, drive: &NodeSource) -> Result<()> {
    let fields = wanted(scene)?;
    match (drive, fields.first()) {
        (NodeSource::Posed(_), Some((field, _))) => Err(Error::Input(format!(
            "output field {field} requires a simulated body; set a solver, such as --solver implicit"
        ))),
        (NodeSource::Posed(_), None) => Ok(()),
        (NodeSource::Simulated(motion), _) => fields
            .iter()
            .try_for_each(|(field, _)| field.check(motion.simulator.as_ref())),
    }
}

impl Stage {
    /// Recomputes the displayed field if it is a computed one and the nodes have moved. On the GPU
    /// this reads back the positions of the last submitted work.
    pub(super) fn refresh_field(&mut self) -> Result<()> {
        let (Some(shown), NodeSource::Simulated(motion)) =
            (&mut self.looks.computed_field, &self.drive)
        else {
            return Ok(());
        };
        let body = motion.simulator.as_ref();
        let version = Some(body.nodes().version());
        if shown.version == version {
            return Ok(());
        }
        let values = shown.field.per_node(body)?;
        shown.version = version;
        let (low, high) = range(&values);
        shown.observed_range = (
            shown.observed_range.0.min(low),
            shown.observed_range.1.max(high),
        );
        self.looks.scalars.values = values;
        if !shown.given {
            self.looks.scalars.range = shown.range();
        }
        let geometry = self.looks.raycaster.geometry_mut();
        geometry.set_scalars(
            body.mesh(),
            &self.looks.scalars.values,
            self.looks.scalars.range,
        )?;
        self.looks.raycaster.update_range()?;
        let geometry = self.looks.raycaster.geometry();
        self.looks
            .surface
            .set_scalars(geometry, &self.looks.scalars.values)
    }

    /// Returns a note of the range of the computed field over the pictures so far.
    pub fn field_note(&self) -> Option<String> {
        let shown = self
            .looks
            .computed_field
            .as_ref()
            .filter(|s| s.version.is_some())?;
        let (low, high) = shown.observed_range;
        let [low, high] = [low, high].map(|x| figures(x, shown.rounding));
        let unit = shown.field.unit();
        let space = if unit.is_empty() { "" } else { " " };
        Some(format!(
            "{} ranged from {low} to {high}{space}{unit}; reproduce these colours with --range {low},{high}",
            shown.field
        ))
    }
}

/// Formats a number with six significant digits; 0 if it is at most `rounding`.
fn figures(x: f64, rounding: f64) -> String {
    significant(if x.abs() <= rounding { 0.0 } else { x })
}

/// Returns the smallest and largest value.
fn range(values: &[f64]) -> (f64, f64) {
    values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(*v), b.max(*v))
        })
}

#[cfg(test)]
mod tests {
    use super::figures;

    #[test]
    fn values_below_rounding_error_are_zero() {
        let cases = [
            (0.0, "0"),
            (-3e-9, "0"),
            (0.012_346_78, "0.0123468"),
            (-1234.56, "-1234.56"),
        ];
        for (x, expected) in cases {
            assert_eq!(figures(x, 1e-8), expected);
        }
    }
}
