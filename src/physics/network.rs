//! The particles and springs of a body, in float64 and SI units: what the GPU's arrays are made
//! from, and what the reference steps.

use super::material::{Damping, Material, RegionMaterial, Stiffness};
use crate::mesh::{Field, LocalFrame, Location, TET_EDGES, TetMesh};
use crate::{Error, Result};
use glam::DVec3;
use rayon::prelude::*;

/// A spring between two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// Its two nodes, the smaller first.
    pub nodes: [u32; 2],
    /// κ, N/m.
    pub stiffness: f64,
    /// L, m.
    pub length: f64,
}

/// Masses at the nodes of a mesh, springs along its edges.
///
/// Positions are in metres from the frame's origin.
#[derive(Clone, Debug)]
pub struct SpringNetwork {
    /// Rest position of every node, m.
    pub rest: Vec<DVec3>,
    /// Mass of every node: a quarter of that of its tets, kg.
    pub masses: Vec<f64>,
    /// Every edge of the mesh once, sorted.
    pub springs: Vec<Spring>,
    /// κ_d of every spring, N·s/m.
    pub damping: f64,
    /// Seconds; adds `damping_time · κ` to each spring's κ_d.
    pub damping_time: f64,
    /// What is damped.
    pub damping_kind: Damping,
    /// The local frame of the mesh, in file units.
    pub frame: LocalFrame,
    /// Metres in a file unit.
    pub length_unit: f64,
}

impl SpringNetwork {
    /// The network of `mesh` made of `material`.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers that make no sense or fields the mesh does not have.
    pub fn new(mesh: &TetMesh, material: &Material) -> Result<SpringNetwork> {
        material.check()?;
        let frame = LocalFrame::of_mesh(mesh);
        let unit = material.length_unit;
        let volumes: Vec<f64> = (0..mesh.tets.len())
            .into_par_iter()
            .map(|t| mesh.tet_volume(t).abs() * unit.powi(3))
            .collect();
        let made_of = made_of(mesh, material)?;
        let mut masses = vec![0.0; mesh.nodes.len()];
        for (t, (tet, volume)) in mesh.tets.iter().zip(&volumes).enumerate() {
            for v in tet {
                masses[*v as usize] += made_of(t).density * volume / 4.0;
            }
        }
        let rest: Vec<DVec3> = mesh
            .nodes
            .iter()
            .map(|p| (*p - frame.origin) * unit)
            .collect();
        if !masses.iter().all(|m| m.is_finite()) {
            return Err(Error::Input(format!(
                "the masses of this mesh overflow with a length unit of {unit} m; is that the mesh's unit?"
            )));
        }
        let springs = springs(mesh, material, &made_of, &rest, &volumes)?;
        Ok(SpringNetwork {
            rest,
            masses,
            springs,
            damping: material.damping,
            damping_time: material.damping_time,
            damping_kind: material.damping_kind,
            frame,
            length_unit: unit,
        })
    }

    /// κ_d of a spring, N·s/m.
    pub fn spring_damping(&self, spring: &Spring) -> f64 {
        self.damping + self.damping_time * spring.stiffness
    }

    /// Metres from the frame's origin of a point in file coordinates.
    pub fn to_metres(&self, p: DVec3) -> DVec3 {
        (p - self.frame.origin) * self.length_unit
    }

    /// File coordinates of a point in metres from the frame's origin.
    pub fn to_file(&self, x: DVec3) -> DVec3 {
        self.frame.origin + x / self.length_unit
    }
}

/// The springs along the edges of `mesh`.
fn springs(
    mesh: &TetMesh,
    material: &Material,
    made_of: &(impl Fn(usize) -> RegionMaterial + Sync),
    rest: &[DVec3],
    volumes: &[f64],
) -> Result<Vec<Spring>> {
    let node_factors = match &material.node_field {
        Some(name) => Some(scalar_field(mesh, name, Location::Node)?),
        None => None,
    };
    let mut around: Vec<([u32; 2], u32)> = mesh
        .tets
        .par_iter()
        .enumerate()
        .flat_map_iter(|(t, tet)| {
            TET_EDGES.map(|[a, b]| ([tet[a].min(tet[b]), tet[a].max(tet[b])], t as u32))
        })
        .collect();
    around.par_sort_unstable();
    let edges: Vec<&[([u32; 2], u32)]> = around.chunk_by(|a, b| a.0 == b.0).collect();
    let spring = |tets: &&[([u32; 2], u32)]| {
        let nodes = tets[0].0;
        let [i, j] = nodes.map(|v| v as usize);
        let length = rest[i].distance(rest[j]);
        let (mut volume, mut weighted) = (0.0, 0.0);
        for (_, t) in tets.iter() {
            volume += volumes[*t as usize];
            weighted += volumes[*t as usize] * made_of(*t as usize).stiffness;
        }
        let stiffness = match material.stiffness {
            // A zero-length edge has no direction to resist in.
            Stiffness::Young(_) if length * length <= f64::MIN_POSITIVE => 0.0,
            Stiffness::Young(_) => weighted / (length * length),
            Stiffness::Uniform(_) if volume > 0.0 => weighted / volume,
            Stiffness::Uniform(k) => k,
        };
        let node_factor = node_factors.as_ref().map_or(1.0, |f| 0.5 * (f[i] + f[j]));
        Spring {
            nodes,
            stiffness: stiffness * node_factor,
            length,
        }
    };
    let springs: Vec<Spring> = edges.par_iter().map(spring).collect();
    match springs
        .iter()
        .find(|s| !s.stiffness.is_finite() || s.stiffness < 0.0)
    {
        Some(s) => Err(Error::Input(format!(
            "the spring between nodes {} and {} would have the stiffness {} N/m; check the modulus, the length unit and the fields that scale them",
            s.nodes[0], s.nodes[1], s.stiffness
        ))),
        None => Ok(springs),
    }
}

/// What each tet is made of, by its region.
fn made_of(mesh: &TetMesh, material: &Material) -> Result<impl Fn(usize) -> RegionMaterial> {
    let (Stiffness::Young(stiffness) | Stiffness::Uniform(stiffness)) = material.stiffness;
    let rest = RegionMaterial {
        stiffness,
        density: material.density,
    };
    let labels = match &material.region_field {
        Some(name) => Some(scalar_field(mesh, name, Location::Cell)?),
        None => None,
    };
    Ok(move |t: usize| {
        let label = labels.map(|labels| labels[t].round() as i64);
        let region = label.and_then(|label| material.regions.get(&label));
        region.copied().unwrap_or(rest)
    })
}

fn scalar_field<'a>(mesh: &'a TetMesh, name: &str, location: Location) -> Result<&'a [f64]> {
    match mesh.field(name, location) {
        Some(Field {
            components: 1,
            values,
            ..
        }) => Ok(values),
        found => {
            let names: Vec<&str> = mesh
                .fields
                .iter()
                .filter(|f| f.location == location && f.components == 1)
                .map(|f| f.name.as_str())
                .collect();
            Err(Error::Input(format!(
                "the material needs one number at the {location} called \"{name}\", and {}; the mesh has {names:?}",
                if found.is_some() {
                    "that field has several components"
                } else {
                    "there is none"
                }
            )))
        }
    }
}
