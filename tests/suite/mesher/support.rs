//! Domains with known results, and invariants of every meshed domain.

use glam::{DAffine3, DVec3};
use palpate::mesh::{BoundaryReport, NO_NEIGHBOUR, TetMesh, TetQuality, Topology};
use palpate::mesher::{Domain, MeshOptions, MeshedDomain, Spacing, mesh_domain};
use palpate::no_progress;
use palpate::volume::{Raw, Volume};
use std::collections::BTreeMap;

/// Regions given by functions with a gradient of at most 1, positive inside.
pub struct Solids<F> {
    pub half_size: f64,
    pub weights: F,
}

impl<F: Fn(DVec3) -> Vec<(u16, f64)> + Sync> Domain for Solids<F> {
    fn bounds(&self) -> (DVec3, DVec3) {
        (DVec3::splat(-self.half_size), DVec3::splat(self.half_size))
    }

    fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
        weights.clear();
        weights.extend((self.weights)(p));
    }

    fn uniform(&self, low: DVec3, high: DVec3) -> Option<u16> {
        let mut weights = (self.weights)(0.5 * (low + high));
        weights.push((0, 0.0));
        weights.sort_by(|a, b| b.1.total_cmp(&a.1));
        let lead = weights[0].1 - weights.get(1).map_or(f64::NEG_INFINITY, |w| w.1);
        // The weights change by at most half the diagonal; that of the outside is constant 0.
        let changing = weights.len().min(3) as f64 - 1.0;
        (lead > 0.5 * changing * (high - low).length()).then_some(weights[0].0)
    }
}

pub fn solids<F: Fn(DVec3) -> Vec<(u16, f64)> + Sync>(half_size: f64, weights: F) -> Solids<F> {
    Solids { half_size, weights }
}

pub fn options(edge: f64, grading: f64) -> MeshOptions {
    MeshOptions {
        spacing: Spacing::Edge(edge),
        grading,
        ..MeshOptions::default()
    }
}

pub fn filled(domain: &dyn Domain, options: &MeshOptions) -> MeshedDomain {
    mesh_domain(domain, options, &no_progress).unwrap()
}

/// Returns a volume of unit voxels, the first centred at (0.5, 0.5, 0.5).
pub fn volume_of(size: [usize; 3], label: impl Fn([usize; 3]) -> u8) -> Volume {
    let [nx, ny, nz] = size;
    let at = |n: usize| [n % nx, n / nx % ny, n / nx / ny];
    Volume {
        size,
        raw: Raw::U8((0..nx * ny * nz).map(|n| label(at(n))).collect()),
        to_world: DAffine3::from_translation(DVec3::splat(0.5)),
        ..Volume::default()
    }
}

pub fn mesh_of(filling: &MeshedDomain) -> TetMesh {
    let (nodes, tets) = (filling.nodes.clone(), filling.tets.clone());
    TetMesh::new(nodes, tets, vec![], vec![]).unwrap()
}

/// Returns the part of a meshed domain in one region.
pub fn region_of(filling: &MeshedDomain, region: u16) -> TetMesh {
    let tets = filling.tets.iter().zip(&filling.regions);
    let tets = tets.filter(|t| *t.1 == region).map(|t| *t.0).collect();
    TetMesh::new(filling.nodes.clone(), tets, vec![], vec![]).unwrap()
}

/// Returns the errors in a meshed domain; empty if it is valid.
pub fn faults(filling: &MeshedDomain) -> Vec<String> {
    let mut faults = Vec::new();
    let mut say = |wrong: bool, what: String| {
        if wrong {
            faults.push(what);
        }
    };
    let mesh = mesh_of(filling);
    say(
        mesh.repairs != Default::default(),
        format!("needs repair: {:?}", mesh.repairs.warnings),
    );
    say(
        mesh.tets.len() != filling.regions.len() || filling.regions.contains(&0),
        "not one region per tet".into(),
    );
    let topology = Topology::new(&mesh);
    let shape = BoundaryReport::new(&mesh, &topology);
    say(!shape.closed, "the boundary is not closed".into());
    say(
        !shape.is_vertex_manifold(),
        format!(
            "{} non-manifold edges, {} non-manifold nodes",
            shape.non_manifold_edges.len(),
            shape.non_manifold_nodes.len()
        ),
    );
    // A node within a boundary face, or on its edge, indicates non-conforming tets.
    say(
        hanging_nodes(&mesh, &topology) > 0,
        format!("{} hanging nodes", hanging_nodes(&mesh, &topology)),
    );
    let regions: std::collections::BTreeSet<u16> = filling.regions.iter().copied().collect();
    for region in regions {
        let part = region_of(filling, region);
        let shape = BoundaryReport::new(&part, &Topology::new(&part));
        say(!shape.closed, format!("region {region} is not closed"));
    }
    faults
}

/// Counts the boundary nodes that lie on a boundary face or edge without being one of its corners
/// or coinciding with one.
pub fn hanging_nodes(mesh: &TetMesh, topology: &Topology) -> usize {
    let (low, high) = mesh.bounds();
    let cell = (high - low).max_element() / (mesh.tets.len() as f64).cbrt().max(1.0);
    let place = |p: DVec3| ((p - low) / cell).floor().to_array().map(|c| c as i64);
    let mut nodes: BTreeMap<[i64; 3], Vec<DVec3>> = BTreeMap::new();
    for b in &topology.boundary {
        for v in topology.boundary_nodes(mesh, *b) {
            let p = mesh.nodes[v as usize];
            nodes.entry(place(p)).or_default().push(p);
        }
    }
    let mut hanging = 0;
    for b in &topology.boundary {
        assert_eq!(
            topology.neighbours[b.tet as usize][b.face as usize],
            NO_NEIGHBOUR
        );
        let c = topology
            .boundary_nodes(mesh, *b)
            .map(|v| mesh.nodes[v as usize]);
        let (first, last) = palpate::mesh::bounds(&c);
        let (first, last) = (place(first), place(last));
        for i in first[0]..=last[0] {
            for j in first[1]..=last[1] {
                for k in first[2]..=last[2] {
                    for p in nodes.get(&[i, j, k]).into_iter().flatten() {
                        let apart = c.iter().all(|q| q.distance(*p) > 1e-9 * cell);
                        let on = palpate::mesh::point_triangle_distance(*p, c) < 1e-9 * cell;
                        hanging += usize::from(apart && on);
                    }
                }
            }
        }
    }
    hanging
}

/// Returns the smallest and largest dihedral angle, measured here.
pub fn angles(filling: &MeshedDomain) -> (f64, f64) {
    let all = filling
        .tets
        .iter()
        .flat_map(|t| TetQuality::dihedral_angles(t.map(|v| filling.nodes[v as usize])));
    all.fold((180.0, 0.0), |(low, high): (f64, f64), a| {
        (low.min(a), high.max(a))
    })
}

/// Returns the Euler number nodes − edges + faces of the boundary of a region.
pub fn euler_number(filling: &MeshedDomain, region: u16) -> i64 {
    let part = region_of(filling, region);
    BoundaryReport::new(&part, &Topology::new(&part)).euler_number()
}

pub fn region_volume(filling: &MeshedDomain, region: u16) -> f64 {
    let entry = filling.report.regions.iter().find(|r| r.region == region);
    entry.map_or(0.0, |r| r.volume)
}

/// Returns the two one-sided Hausdorff distances between the boundaries of a meshed domain's
/// regions and the faces between voxels of different labels, in voxels of a volume of unit voxels
/// from the origin.
pub fn farthest_from_labels(filling: &MeshedDomain, volume: &Volume) -> (f64, f64) {
    let size = volume.size.map(|n| n as i64);
    let label = |c: [i64; 3]| match (0..3).all(|a| (0..size[a]).contains(&c[a])) {
        true => volume.value((c[0] + size[0] * (c[1] + size[1] * c[2])) as usize),
        false => 0.0,
    };
    // Faces as boxes of zero thickness.
    let mut walls: Vec<(DVec3, DVec3)> = Vec::new();
    for n in 0..(size[0] + 1) * (size[1] + 1) * (size[2] + 1) {
        let (nx, ny) = (size[0] + 1, size[1] + 1);
        let c = [n % nx, n / nx % ny, n / nx / ny];
        for axis in 0..3 {
            let mut before = c;
            before[axis] -= 1;
            if label(c) != label(before) {
                let low = DVec3::from(c.map(|c| c as f64));
                let mut high = low + 1.0;
                high[axis] = low[axis];
                walls.push((low, high));
            }
        }
    }
    let regions: std::collections::BTreeSet<u16> = filling.regions.iter().copied().collect();
    let mut triangles: Vec<[DVec3; 3]> = Vec::new();
    for region in regions {
        let part = region_of(filling, region);
        let topology = Topology::new(&part);
        let faces = topology.boundary.iter();
        triangles.extend(faces.map(|b| {
            topology
                .boundary_nodes(&part, *b)
                .map(|v| part.nodes[v as usize])
        }));
    }
    let samples = triangles
        .iter()
        .flat_map(|t| [t[0], t[1], t[2], (t[0] + t[1] + t[2]) / 3.0]);
    let there = samples
        .map(|p| {
            let to_wall = |w: &(DVec3, DVec3)| p.distance(p.clamp(w.0, w.1));
            walls.iter().map(to_wall).fold(f64::INFINITY, f64::min)
        })
        .fold(0.0, f64::max);
    let back = walls
        .iter()
        .map(|(low, high)| {
            let p = 0.5 * (*low + *high);
            let near = |t: &&[DVec3; 3]| t[0].distance(p) < 5.0;
            let to_mesh = |t: &[DVec3; 3]| palpate::mesh::point_triangle_distance(p, *t);
            let near = triangles.iter().filter(near);
            near.map(to_mesh).fold(f64::INFINITY, f64::min)
        })
        .fold(0.0, f64::max);
    (there, back)
}
