//! Parameters of contact that follow from the body: gaps, stiffnesses, the speed of static friction,
//! and which bodies can have contact.

use crate::physics::{DiscreteModel, Element, LocalUnits, Shape, SolverKind, Tool};
use crate::{Error, Result};

/// Default contact gap of a tool: as a fraction of its size, and of the mean edge of the body's
/// boundary.
const GAP_PER_TOOL_SIZE: f64 = 1.0 / 2000.0;
const GAP_PER_EDGE: f64 = 1.0 / 100.0;

/// Default self-contact gap over the mean edge of the body's boundary.
const SELF_GAP_PER_EDGE: f64 = 1.0 / 20.0;

/// Smallest gap over the extent of the body: f32 resolves a hundredth of it.
const MIN_GAP_PER_EXTENT: f64 = 2e-5;

/// Speed below which friction is static, in extents of the body per second.
pub(in crate::physics) const STATIC_FRICTION_SPEED: f64 = 1e-4;

/// Stiffness behind the boundary of a fully rigid body, Pa.
const RIGID_SURFACE_STIFFNESS: f64 = 1e6;

/// Approximate ratio of Young's modulus to μ, which is between 2 and 3.
const YOUNG_OVER_MU: f64 = 2.8;

/// Checks that a body can be stepped with contact with `what`.
///
/// # Errors
/// [`Error::Input`].
pub(in crate::physics) fn check_contact(
    what: &str,
    network: &DiscreteModel,
    kind: SolverKind,
) -> Result<()> {
    if network.elements().is_none() {
        return Err(Error::Input(format!(
            "contact with {what} requires finite elements, but the body is made of springs; use --material neo-hookean (or corotated)"
        )));
    }
    match kind {
        SolverKind::Implicit | SolverKind::Bdf2 => Ok(()),
        _ => Err(Error::Input(format!(
            "{kind} does not support contact with {what}; use implicit or bdf2"
        ))),
    }
}

/// Returns the contact gap of `tool`, with a shape in local units, on a body whose boundary has the
/// mean edge length `edge`; `unit` is a file unit.
pub(in crate::physics) fn tool_gap(tool: &Tool, shape: &Shape, edge: f64, unit: f64) -> f64 {
    let gap = match tool.gap {
        Some(gap) => gap * unit,
        None => (GAP_PER_TOOL_SIZE * shape.feature_size()).min(GAP_PER_EDGE * edge),
    };
    gap.max(MIN_GAP_PER_EXTENT)
}

/// Returns the self-contact gap of a body whose boundary has the mean edge length `edge`, given the
/// one of its settings; local units.
pub(in crate::physics::cpu) fn self_contact_gap(given: Option<f64>, edge: f64) -> f64 {
    let gap = given.unwrap_or(SELF_GAP_PER_EDGE * edge);
    gap.max(MIN_GAP_PER_EXTENT)
}

/// Returns the derivatives by μ (Pa) of each element for derivatives `of_faces` by Young's modulus
/// behind each of `faces` (Pa): the transpose of [`face_stiffnesses`], which is linear.
pub(in crate::physics) fn face_stiffness_transpose(
    faces: &[[u32; 3]],
    network: &DiscreteModel,
    of_faces: &[f64],
) -> Vec<f64> {
    let Some(elements) = network.elements() else {
        return Vec::new();
    };
    let nodes = network.rest_positions.len();
    let mut counts = vec![0.0; nodes];
    for t in 0..elements.tets.len() {
        elements.nodes_of(t).for_each(|v| counts[v as usize] += 1.0);
    }
    let (mut of_nodes, mut of_mean) = (vec![0.0; nodes], 0.0);
    for (face, derivative) in faces.iter().zip(of_faces) {
        for v in face.map(|v| v as usize) {
            match counts[v] > 0.0 {
                true => of_nodes[v] += derivative / (3.0 * counts[v]),
                false => of_mean += derivative / 3.0,
            }
        }
    }
    let volume: f64 = elements.tets.iter().map(|e| e.volume).sum();
    let of_element = |(t, e): (usize, &Element)| {
        let nodes: f64 = elements.nodes_of(t).map(|v| of_nodes[v as usize]).sum();
        YOUNG_OVER_MU * (nodes + of_mean * e.volume / volume)
    };
    elements.tets.iter().enumerate().map(of_element).collect()
}

/// Returns `faces` of `network`, each with Young's modulus of the material behind it, local units.
pub(in crate::physics) fn face_stiffnesses(
    faces: &[[u32; 3]],
    network: &DiscreteModel,
    units: &LocalUnits,
) -> impl Iterator<Item = ([u32; 3], f64)> {
    let mut around = vec![(0.0, 0.0); network.rest_positions.len()];
    let (mut all, mut volume) = (0.0, 0.0);
    let elements = network.elements().into_iter();
    for (elements, t) in elements.flat_map(|e| (0..e.tets.len()).map(move |t| (e, t))) {
        let e = &elements.tets[t];
        let young = YOUNG_OVER_MU * e.lame_parameters[0];
        all += young * e.volume;
        volume += e.volume;
        for v in elements.nodes_of(t) {
            let (sum, count) = &mut around[v as usize];
            (*sum, *count) = (*sum + young, *count + 1.0);
        }
    }
    let mean = if volume > 0.0 {
        all / volume
    } else {
        RIGID_SURFACE_STIFFNESS
    };
    let pressure = units.force() / (units.length * units.length);
    faces.iter().map(move |face| {
        let of_node = |v: &u32| match around[*v as usize] {
            (sum, count) if count > 0.0 => sum / count,
            _ => mean,
        };
        let young = face.iter().map(of_node).sum::<f64>() / 3.0;
        (*face, young / pressure)
    })
}
