//! The derivative by the rest position of a node: central differences of the forces at fixed
//! positions, with the model made of the moved mesh. Each takes four assemblies of the body.

use super::equilibrium::Equilibrium;
use super::parameters::Sensitivity;
use super::quantities::derivative;
use super::slopes::face_area;
use crate::mesh::TetMesh;
use crate::physics::cpu::{STATIC_FRICTION_SPEED, face_stiffnesses, tool_gap};
use crate::physics::loads::fibre_points::FibrePoint;
use crate::physics::{DiscreteModel, Discretisation, LocalUnits, Muscle};
use crate::{Error, Result};
use glam::DVec3;

/// Step of the differences, over the shortest edge at the node.
const DIFFERENCE_STEP: f64 = 1e-3;

/// Checks that a body has a derivative by the rest position of a node.
///
/// # Errors
/// [`Error::Input`] for an unknown node, one of a rigid region, and a body with self-contact.
pub(super) fn check_rest_position(body: &Equilibrium<'_>, node: u32) -> Result<()> {
    body.check_nodes([node])?;
    if body.is_rigid(node) {
        return Err(Error::Input(format!(
            "node {node} belongs to a rigid region, which has no derivative by rest positions; choose a node of the soft tissue"
        )));
    }
    match body.self_contact.is_some() {
        true => Err(Error::Input(
            "the gaps of self-contact depend on the distances at rest: there is no derivative by rest positions; disable self-contact".into(),
        )),
        false => Ok(()),
    }
}

/// Returns the derivative by the rest position of a node along `direction`, per file unit.
///
/// # Errors
/// [`Error::Input`] if the moved mesh has no model.
pub(super) fn rest_position_slope(
    sensitivity: &Sensitivity<'_>,
    node: u32,
    direction: DVec3,
) -> Result<f64> {
    let body = sensitivity.body;
    let length = direction.length();
    if length == 0.0 {
        return Ok(0.0);
    }
    let unit = body.network.length_unit;
    let h = DIFFERENCE_STEP * shortest_edge(body.mesh, node) / length;
    let models = [-2.0, -1.0, 1.0, 2.0].map(|by| moved_model(body, node, by * h * direction));
    let mut values = Vec::with_capacity(models.len());
    for model in models {
        values.push(potential(sensitivity, &model?));
    }
    let at = |by: f64| match by / h {
        by if by < -1.5 => values[0],
        by if by < 0.0 => values[1],
        by if by < 1.5 => values[2],
        _ => values[3],
    };
    let slope = derivative(at, h);
    // A pinned node stays at its rest position.
    let with_pin = match body.pinned[node as usize] {
        true => sensitivity.solution.supports[node as usize].dot(direction) * unit,
        false => 0.0,
    };
    Ok(slope + with_pin)
}

fn shortest_edge(mesh: &TetMesh, node: u32) -> f64 {
    let at = mesh.nodes[node as usize];
    let tets = mesh.tets.iter().filter(|tet| tet.contains(&node));
    let lengths = tets
        .flatten()
        .map(|v| mesh.nodes[*v as usize].distance(at))
        .filter(|l| *l > 0.0);
    lengths.fold(f64::INFINITY, f64::min).min(1e300)
}

/// Returns the model of the mesh with a node moved, in the frame of the body's.
fn moved_model(body: &Equilibrium<'_>, node: u32, by: DVec3) -> Result<DiscreteModel> {
    let mut mesh = body.mesh.clone();
    mesh.nodes[node as usize] += by;
    let mut model = DiscreteModel::new(&mesh, body.material)?;
    let shift = (model.frame.origin - body.network.frame.origin) * body.network.length_unit;
    model.rest_positions.iter_mut().for_each(|x| *x += shift);
    if let (Some(elements), Some(own)) = (model.elements_mut(), body.network.elements()) {
        elements.per_tet_lambda_ratio = own.per_tet_lambda_ratio;
    }
    Ok(model)
}

/// Returns the quantity plus λ times the forces of a body of `model` with its nodes at the same
/// positions, apart from a constant.
fn potential(sensitivity: &Sensitivity<'_>, model: &DiscreteModel) -> f64 {
    let (body, solution) = (sensitivity.body, &sensitivity.solution);
    let x = &body.x;
    let own = sensitivity.function.as_ref();
    let explicit = own.map_or(0.0, |f| f.linearised(body, model, x));
    let forces = match &model.discretisation {
        Discretisation::Elements(elements) => elements.forces(x),
        Discretisation::Springs(_) => model.static_forces(x, &[]),
    };
    let matter: f64 = solution
        .terms
        .iter()
        .zip(forces)
        .map(|(l, f)| l.dot(f))
        .sum();
    // Forces of gravity and of terms are linear in the change of the masses; an energy has its own
    // part in `explicit`.
    let masses = model.masses.iter().zip(&body.network.masses);
    let by_mass = sensitivity.mass_force_slopes();
    let masses: f64 = masses
        .zip(by_mass)
        .map(|((new, old), by)| (new - old) * by)
        .sum();
    let muscles: f64 = body
        .muscles
        .iter()
        .map(|(muscle, level)| {
            let strength = body.amplitudes[*level] * muscle.tension;
            strength * muscle_work(sensitivity, model, muscle)
        })
        .sum();
    explicit + matter + masses + muscles + contact(sensitivity, model)
}

/// Returns λ times the forces of a muscle of unit strength: −Σ V (F m)·(∇λ m).
fn muscle_work(sensitivity: &Sensitivity<'_>, model: &DiscreteModel, muscle: &Muscle) -> f64 {
    let body = sensitivity.body;
    let (x, lambda) = (&body.x, &sensitivity.solution.terms);
    let mut work = 0.0;
    muscle.for_each_element((model, &body.mesh.tets), 1.0, |nodes, points| {
        // The slopes of a point sum to zero.
        let along = |of: &[DVec3], point: &FibrePoint| -> DVec3 {
            let first = of[nodes[0] as usize];
            let all = nodes.iter().zip(point.slopes);
            all.map(|(v, s)| s * (of[*v as usize] - first)).sum()
        };
        for point in points {
            work -= point.volume * along(x, point).dot(along(lambda, point));
        }
    });
    work
}

/// Returns the part of the contact stiffnesses and gaps.
fn contact(sensitivity: &Sensitivity<'_>, model: &DiscreteModel) -> f64 {
    let (body, solution) = (sensitivity.body, &sensitivity.solution);
    if solution.faces.is_empty() {
        return 0.0;
    }
    let units = LocalUnits::from_model(model);
    let pressure = units.force() / (units.length * units.length);
    let faces = face_stiffnesses(body.faces, model, &units).zip(&solution.faces);
    let stiffnesses: f64 = faces
        .map(|((face, young), by)| by * young * pressure * face_area(&face, &model.rest_positions))
        .sum();
    let (rest, count) = (&model.rest_positions, 3.0 * body.faces.len().max(1) as f64);
    let around = body.faces.iter().map(|face| {
        let [a, b, c] = face.map(|v| rest[v as usize]);
        a.distance(b) + b.distance(c) + c.distance(a)
    });
    let edge = around.sum::<f64>() / (count * units.length);
    let unit = model.length_unit / units.length;
    let gaps = body
        .tools
        .iter()
        .zip(&solution.tools)
        .map(|(tool, slopes)| {
            let gap = tool_gap(tool, &tool.shape.with_scale(unit), edge, unit);
            slopes.gap * gap * units.length
        });
    let speed = STATIC_FRICTION_SPEED * units.length;
    stiffnesses + gaps.sum::<f64>() + solution.static_speed * speed
}
