//! Quantities and parameters of gradients from Python.

use crate::body::{motion, simulator};
use crate::stage::Stage;
use crate::work::LongTask;
use glam::DVec3;
use numpy::{IntoPyArray, PyArray1};
use palpate::physics::{AmplitudeId, Capability, Gradient, Parameter, Quantity, Simulator, ToolId};
use palpate::{Error, Result};
use pyo3::prelude::*;

/// Kind, indices (none: of all tets), weights and directions of a quantity or a parameter, and the
/// label of its region.
pub type Item = (
    String,
    Option<Vec<u32>>,
    Vec<f64>,
    Vec<[f64; 3]>,
    Option<i64>,
);

/// Value, derivatives, imbalance and iterations of a gradient.
type Found<'py> = (f64, Bound<'py, PyArray1<f64>>, f64, u32);

fn found(py: Python<'_>, gradient: Gradient) -> Found<'_> {
    let derivatives = gradient.derivatives.into_pyarray(py);
    (
        gradient.value,
        derivatives,
        gradient.imbalance,
        gradient.iterations,
    )
}

/// Steps the body of `stage` in double precision from now on.
#[pyfunction]
pub fn use_double_precision(py: Python<'_>, stage: &Stage) -> PyResult<()> {
    stage.with(py, |stage| {
        let gradients = simulator(stage)?.gradients();
        Capability::Gradients
            .require(gradients)?
            .use_double_precision()
    })
}

/// Returns a quantity of the body of `stage` at rest and its derivatives.
#[pyfunction]
pub fn gradient<'py>(
    py: Python<'py>,
    stage: &Stage,
    quantity: Item,
    parameters: Vec<Item>,
) -> PyResult<Found<'py>> {
    let gradient = stage.with(py, |stage| {
        let body = simulator(stage)?;
        let (quantity, parameters) = read(body, &quantity, &parameters)?;
        let gradients = Capability::Gradients.require(body.gradients())?;
        gradients.gradient(&quantity, &parameters)
    })?;
    Ok(found(py, gradient))
}

/// Takes a number of steps with the body of `stage`. Returns a quantity of this motion, integrated over
/// time or at the end, and its derivatives.
#[pyfunction]
pub fn gradient_of_motion<'py>(
    py: Python<'py>,
    stage: &Stage,
    steps: u32,
    integral: bool,
    quantity: Item,
    parameters: Vec<Item>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Found<'py>> {
    let gradient = LongTask::new(progress).run(py, |progress| {
        let stage = &mut stage.lock().stage;
        let (quantity, parameters) = read(simulator(stage)?, &quantity, &parameters)?;
        motion(stage)?.gradient_of_motion(steps, &quantity, integral, &parameters, progress)
    })?;
    Ok(found(py, gradient))
}

fn read(
    body: &dyn Simulator,
    quantity: &Item,
    parameters: &[Item],
) -> Result<(Quantity, Vec<Parameter>)> {
    let all = parameters.iter().map(|p| to_parameter(body, p));
    Ok((to_quantity(body, quantity)?, all.collect::<Result<_>>()?))
}

fn unknown(what: &str, kind: &str) -> Error {
    Error::Input(format!(
        "{kind} is not a {what}; see palpate.gradients for the {what} types"
    ))
}

fn to_quantity(body: &dyn Simulator, item: &Item) -> Result<Quantity> {
    let (kind, numbers, weights, vectors, region) = item;
    let numbers = numbers.as_deref().unwrap_or_default();
    let first = numbers.first().copied().unwrap_or_default();
    let vector = |k: usize| vectors.get(k).copied().map(DVec3::from).unwrap_or_default();
    let direction = vector(0);
    Ok(match kind.as_str() {
        "ToolForce" => Quantity::ToolForce {
            tool: ToolId::from_index(first as usize),
            direction,
        },
        "PinReaction" => Quantity::PinReaction {
            nodes: numbers.to_vec(),
            direction,
        },
        "RegionForce" => Quantity::RegionForce {
            label: region.unwrap_or_default(),
            direction,
        },
        "Displacement" => Quantity::Displacement {
            nodes: numbers
                .iter()
                .copied()
                .zip(weights.iter().copied())
                .collect(),
            direction,
        },
        "LargestDisplacement" => Quantity::LargestDisplacement,
        "Volume" => Quantity::Volume {
            tets: tets(body, item)?,
        },
        "Stress" => Quantity::Stress {
            tet: first,
            along: [vector(0), vector(1)],
        },
        "VonMises" => Quantity::VonMises { tet: first },
        "ElasticEnergy" => Quantity::ElasticEnergy,
        _ => return Err(unknown("quantity", kind)),
    })
}

fn to_parameter(body: &dyn Simulator, item: &Item) -> Result<Parameter> {
    let (kind, numbers, _, vectors, _) = item;
    let numbers = numbers.as_deref().unwrap_or_default();
    let node = numbers.first().copied().unwrap_or_default();
    let tool = ToolId::from_index(node as usize);
    let direction = vectors
        .first()
        .copied()
        .map(DVec3::from)
        .unwrap_or_default();
    Ok(match kind.as_str() {
        "Young" => Parameter::Young {
            tets: tets(body, item)?,
        },
        "Poisson" => Parameter::Poisson {
            tets: tets(body, item)?,
        },
        "Density" => Parameter::Density {
            tets: tets(body, item)?,
        },
        "Load" => Parameter::Load { node, direction },
        "Gravity" => Parameter::Gravity { direction },
        "Amplitude" => Parameter::Amplitude(AmplitudeId::from_index(node as usize)),
        "ToolPosition" => Parameter::ToolPosition { tool, direction },
        "ToolRotation" => Parameter::ToolRotation {
            tool,
            axis: direction,
        },
        "ToolFriction" => Parameter::ToolFriction { tool },
        "DampingTime" => Parameter::DampingTime,
        "MassDamping" => Parameter::MassDamping,
        "Support" => Parameter::Support {
            nodes: numbers.to_vec(),
            direction,
        },
        "RestPosition" => Parameter::RestPosition { node, direction },
        "InitialPosition" => Parameter::InitialPosition { node, direction },
        "InitialVelocity" => Parameter::InitialVelocity { node, direction },
        _ => return Err(unknown("parameter", kind)),
    })
}

/// Returns the tets of an item: its own, those of its region, or all.
fn tets(body: &dyn Simulator, (_, numbers, _, _, region): &Item) -> Result<Vec<u32>> {
    let mesh = body.mesh();
    let all = 0..mesh.tets.len() as u32;
    let Some(label) = region else {
        return Ok(numbers.clone().unwrap_or_else(|| all.collect()));
    };
    let field = mesh.region_field().ok_or_else(|| {
        Error::Input("the mesh has no regions; give tets instead of a region".into())
    })?;
    let own: Vec<u32> = all
        .filter(|t| field.values[*t as usize] == *label as f64)
        .collect();
    match own.is_empty() {
        true => Err(Error::Input(format!(
            "region {label} does not exist; the labels are those of the field \"{}\"",
            field.name
        ))),
        false => Ok(own),
    }
}
