//! Bodies for studies: generated ones with slivers and cavities, as in meshes from scans, thin
//! ones, and bodies from files.

use crate::generate;
use crate::mesh::{Field, Location, TetMesh, signed_volume};
use crate::physics::{ClampedEnd, Simulator};
use crate::scene::Scene;
use crate::{Error, Result};
use glam::{DVec3, dvec3};
use std::path::Path;

/// Clamps one end of a body, and sets gravity transverse to it, 9.81 m/s².
///
/// # Errors
/// As [`Simulator::pin_nodes`].
pub fn hold_one_end(body: &mut dyn Simulator) -> Result<()> {
    let (rest, edges) = (&body.mesh().nodes, body.edge_nodes().into_iter());
    let (end, _) = ClampedEnd::of_largest_component(rest, body.masses(), edges, DVec3::NEG_Z);
    body.pin_nodes(&end.nodes)?;
    body.loads_mut().set_gravity(9.81 * end.load_direction());
    Ok(())
}

/// Fraction of its height to which a tet is flattened; gives dihedral angles of at most eight
/// degrees.
const FLAT: f64 = 0.05;

/// One tet in this number is flattened, if possible.
const FLATTEN_EVERY: usize = 9;

/// Generates a thick-walled body with a through hole, 864 tets, in centimetres. About one tet in
/// forty is a sliver, as in coarse meshes from scans. Its node field `distance` is the distance
/// from a point next to it.
///
/// # Errors
/// An error if the mesh cannot be generated.
pub(super) fn hollow() -> Result<TetMesh> {
    let mut mesh = generate::duct([6, 6, 3], DVec3::splat(2.0), generate::Bore::Round)?;
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    // Rounded like a ventricle: narrower towards one end, and bent.
    for p in &mut mesh.nodes {
        let t = (p.z - low.z) / (high.z - low.z);
        let narrow = 1.0 - 0.45 * t * t;
        let [x, y] = [p.x - middle.x, p.y - middle.y];
        let round = 1.0 - 0.12 * (x * y).abs();
        *p = dvec3(
            middle.x + narrow * round * x + 0.25 * t * t,
            middle.y + narrow * round * y,
            p.z,
        );
    }
    flatten(&mut mesh);
    let place = low - dvec3(0.3, 0.4, 0.2);
    let distance = mesh.nodes.iter().map(|p| p.distance(place)).collect();
    mesh.set_field(Field::scalar("distance", Location::Node, distance))?;
    mesh.length_unit = Some(0.01);
    Ok(mesh)
}

/// Flattens some tets by moving a corner towards the opposite face, if this inverts no other tet.
fn flatten(mesh: &mut TetMesh) {
    let mut around = vec![Vec::new(); mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        for v in tet {
            around[*v as usize].push(t);
        }
    }
    let mut moved = vec![false; mesh.nodes.len()];
    for t in (0..mesh.tets.len()).step_by(FLATTEN_EVERY) {
        let tet = mesh.tets[t];
        for corner in 0..4 {
            let v = tet[corner] as usize;
            let others = [1, 2, 3].map(|k| tet[(corner + k) % 4] as usize);
            if moved[v] || others.iter().any(|v| moved[*v]) {
                continue;
            }
            let [a, b, c] = others.map(|v| mesh.nodes[v]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let height = (mesh.nodes[v] - a).dot(normal);
            let before = mesh.nodes[v];
            mesh.nodes[v] -= (1.0 - FLAT) * height * normal;
            let volume = |t: &usize| signed_volume(mesh.tet_nodes(*t));
            let smallest = around[v].iter().map(volume).fold(f64::INFINITY, f64::min);
            if smallest > 1e-4 {
                moved[v] = true;
                others.iter().for_each(|v| moved[*v] = true);
                break;
            }
            mesh.nodes[v] = before;
        }
    }
}

/// Generates a flat ring whose tets are thin, most so at its faces, as in meshes for flow
/// simulation. Its node field `heat` decreases steeply from the hub and from one face.
///
/// # Errors
/// An error if the mesh cannot be generated.
pub(super) fn ring() -> Result<TetMesh> {
    let mut mesh = generate::duct([12, 12, 10], dvec3(1.0, 1.0, 0.3), generate::Bore::Round)?;
    let (low, high) = mesh.bounds();
    let middle = 0.5 * (low + high);
    for p in &mut mesh.nodes {
        let t = (p.z - low.z) / (high.z - low.z);
        p.z = low.z + (high.z - low.z) * t * t * (3.0 - 2.0 * t);
    }
    let heat = mesh.nodes.iter().map(|p| {
        let t = (p.z - low.z) / (high.z - low.z);
        let r = (*p - middle).truncate().length();
        293.0 + 600.0 * (-6.0 * t).exp() * (-2.0 * r).exp()
    });
    let heat = heat.collect();
    mesh.set_field(Field::scalar("heat", Location::Node, heat))?;
    Ok(mesh)
}

/// Reads the scene at `path`, or makes a scene of the mesh file there.
pub(super) fn named(path: &Path) -> Result<Scene> {
    let is_scene = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    match is_scene {
        true => Scene::read(path),
        false if path.is_file() => Ok(Scene::of_mesh(path)),
        false => Err(Error::Input(format!(
            "{}: scene (.toml) or mesh file not found",
            path.display()
        ))),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::mesh::{BoundaryReport, QualityReport, Topology};

    #[test]
    fn hollow_body_has_slivers_and_no_inverted_tets() {
        let mesh = hollow().unwrap();
        let quality = QualityReport::new(&mesh);
        let volume = |t: usize| signed_volume(mesh.tet_nodes(t));
        assert!((0..mesh.tets.len()).all(|t| volume(t) > 0.0));
        assert!(
            quality.slivers * 100 > mesh.tets.len() && quality.slivers * 5 < mesh.tets.len(),
            "{} of {}",
            quality.slivers,
            mesh.tets.len()
        );
        let topology = Topology::new(&mesh);
        assert_eq!(BoundaryReport::new(&mesh, &topology).euler_number(), 0);
    }

    #[test]
    fn ring_is_flat_and_not_inverted() {
        let mesh = ring().unwrap();
        assert!((0..mesh.tets.len()).all(|t| signed_volume(mesh.tet_nodes(t)) > 0.0));
        let heat = &mesh.field("heat", Location::Node).unwrap().values;
        let most = heat.iter().copied().fold(0.0, f64::max);
        assert!(most > 400.0, "{most}");
    }
}
