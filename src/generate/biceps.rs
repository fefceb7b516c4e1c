//! Phantom of a muscle: a spindle between two tendons.

use super::lattice_fill::{fill_solid, lattice_step};
use crate::mesh::{Field, Location, ScalarType, TetMesh};
use crate::mesher::MeshedDomain;
use crate::{Error, Result, no_progress};
use glam::DVec3;

/// Half the length of the phantom and of its belly, m.
const HALF: f64 = 0.12;
const BELLY: f64 = 0.085;
/// Radius in the middle, and of the tendons, m.
const THICK: f64 = 0.028;
const TENDON: f64 = 0.008;
/// Lattice steps of the coarse meshes from which the step is estimated, m.
const TRIAL_STEPS: [f64; 2] = [0.0085, 0.006];
/// Labels of belly and tendons.
const LABELS: [(i64, &str); 2] = [(1, "muscle"), (2, "tendon")];

/// Returns the radius at `z` and its derivative.
fn radius(z: f64) -> [f64; 2] {
    if z.abs() >= BELLY {
        return [TENDON, 0.0];
    }
    let angle = std::f64::consts::PI * z / BELLY;
    let more = 0.5 * (THICK - TENDON);
    [
        TENDON + more * (1.0 + angle.cos()),
        -more * angle.sin() * std::f64::consts::PI / BELLY,
    ]
}

/// Returns a biceps with about `tets` tets, 24 cm long, in metres, with its axis along z and its
/// centre at the origin. The cell field `label` is 1 in its belly, `muscle`, and 2 in its tendons;
/// `fibre` is the direction of its fibres, which run from one tendon to the other. Deterministic.
///
/// # Errors
/// An error for fewer than 1,000 tets, or more than 32-bit indices can address.
pub fn biceps(tets: usize) -> Result<TetMesh> {
    if !(1_000..=50_000_000).contains(&tets) {
        return Err(Error::Input(format!(
            "biceps must have 1,000 to 50,000,000 tets, got {tets}"
        )));
    }
    let step = lattice_step(tets, TRIAL_STEPS, |step| Ok(filled(step)?.tets.len()))?;
    let MeshedDomain { nodes, tets, .. } = filled(step)?;
    let middles = tets
        .iter()
        .map(|tet| tet.iter().map(|v| nodes[*v as usize]).sum::<DVec3>() / 4.0);
    let (mut labels, mut fibres) = (Vec::new(), Vec::new());
    for p in middles {
        let [muscle, tendon] = LABELS.map(|(label, _)| label as f64);
        labels.push(if p.z.abs() < BELLY { muscle } else { tendon });
        let [r, slope] = radius(p.z);
        let direction = DVec3::new(p.x * slope / r, p.y * slope / r, 1.0).normalize();
        fibres.extend(direction.to_array());
    }
    let fields = vec![
        Field {
            scalar_type: ScalarType::U8,
            ..Field::scalar("label", Location::Cell, labels)
        },
        Field {
            components: 3,
            ..Field::scalar("fibre", Location::Cell, fibres)
        },
    ];
    let mut mesh = TetMesh::new(nodes, tets, fields, Vec::new())?;
    mesh.region_names = LABELS.map(|(label, name)| (label, name.to_owned())).into();
    mesh.length_unit = Some(1.0);
    Ok(mesh)
}

/// Meshes the phantom on a lattice of the given step.
fn filled(step: f64) -> Result<MeshedDomain> {
    let corner = DVec3::new(THICK, THICK, HALF);
    let inside = |q: DVec3| {
        let p = q * step - corner;
        let [r, slope] = radius(p.z);
        // Approximate distance to the side, or to the round end of a tendon.
        let past = (p.z.abs() - (HALF - TENDON)).max(0.0);
        (r - p.truncate().length().hypot(past)) / (step * (1.0 + slope * slope).sqrt())
    };
    let mut filled = fill_solid(2.0 * corner / step, 0.0, inside, &no_progress)?;
    filled
        .nodes
        .iter_mut()
        .for_each(|p| *p = *p * step - corner);
    Ok(filled)
}
