//! The discrete model of a body: masses, springs and elements in float64 and SI units, from which
//! the GPU's arrays are created and which the reference steps.

use super::clamped_end::ClampedEnd;
use super::elements::{ConstitutiveModel, Element, Elements};
use super::material::{Damping, Material, MaterialModel, RegionMaterial, Stiffness};
use super::rigid_region::rigid_bodies;
use crate::mesh::{Field, LocalFrame, Location, TET_EDGES, TetCut, TetMesh, replace_sorted};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// A spring between two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// Its two nodes, the smaller first.
    pub nodes: [u32; 2],
    /// Spring constant κ, N/m.
    pub stiffness: f64,
    /// Rest length L, m.
    pub length: f64,
}

/// Masses at the nodes of a mesh, with springs along its edges or finite elements in its tets.
///
/// Positions are in metres from the frame's origin.
#[derive(Clone, Debug, Default)]
pub struct DiscreteModel {
    /// Rest position of every node, m.
    pub rest_positions: Vec<DVec3>,
    /// Lumped mass of every node: a quarter of the mass of its tets, kg.
    pub masses: Vec<f64>,
    /// Every edge of the mesh once, in sorted order.
    pub springs: Vec<Spring>,
    /// κ_d of every spring, N·s/m.
    pub damping: f64,
    /// Stiffness-proportional damping, s: adds `damping_time · κ` to each spring's κ_d.
    pub damping_time: f64,
    /// The damped velocity component.
    pub damping_kind: Damping,
    /// The local frame of the mesh, in file units.
    pub frame: LocalFrame,
    /// Metres per file unit.
    pub length_unit: f64,
    /// Finite elements. If there are any, they are simulated instead of the springs; the springs
    /// then are the edges of the mesh, with the stiffness of springs of the same modulus, and serve
    /// to choose units, loads and clamped ends.
    pub elements: Elements,
}

impl DiscreteModel {
    /// Chooses the clamped end of a body without supports, for loads in the direction `down`: a
    /// flat end, or the one it stands on; see [`ClampedEnd::of_largest_component`]. Also returns
    /// the number of components.
    pub fn find_clamped_end(&self, down: DVec3) -> (ClampedEnd, usize) {
        let ties = self.springs.iter().map(|s| s.nodes);
        ClampedEnd::of_largest_component(&self.rest_positions, &self.masses, ties, down)
    }

    /// Returns the time in which the slowest shear wave crosses the body, s: its extent over
    /// √(μ/ρ), or over the length of springs times √(κ/m); `None` without elements and springs.
    pub fn wave_crossing_time(&self) -> Option<f64> {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for x in &self.rest_positions {
            (low, high) = (low.min(*x), high.max(*x));
        }
        let speed = match self.elements.tets.is_empty() {
            false => {
                let tets = &self.elements.tets;
                let volume: f64 = tets.iter().map(|t| t.volume).sum();
                let modulus = tets.iter().map(|t| t.lame_parameters[0]);
                let density = self.masses.iter().sum::<f64>() / volume;
                (modulus.fold(f64::INFINITY, f64::min) / density).sqrt()
            }
            true => {
                let of = |s: &Spring| {
                    let [a, b] = s.nodes.map(|v| self.masses[v as usize]);
                    s.length * (s.stiffness / (0.5 * (a + b))).sqrt()
                };
                self.springs.iter().map(of).fold(f64::INFINITY, f64::min)
            }
        };
        let time = low.distance(high) / speed;
        (time.is_finite() && time > 0.0).then_some(time)
    }

    /// The model of `mesh` made of `material`.
    ///
    /// # Errors
    /// [`Error::Input`] if a parameter is out of range or the mesh lacks a field.
    pub fn new(mesh: &TetMesh, material: &Material) -> Result<DiscreteModel> {
        material.check()?;
        let frame = LocalFrame::from_mesh(mesh);
        let unit = material.length_unit;
        let rest: Vec<DVec3> = mesh
            .nodes
            .iter()
            .map(|p| (*p - frame.origin) * unit)
            .collect();
        let builder = ModelBuilder::new(mesh, material)?;
        let masses = builder.masses(0..mesh.tets.len())?;
        let springs = builder.springs(&edges_around(mesh), &rest)?;
        let elements = builder.elements(&rest);
        Ok(DiscreteModel {
            rest_positions: rest,
            masses,
            springs,
            damping: material.damping,
            damping_time: material.damping_time,
            damping_kind: material.damping_kind,
            frame,
            length_unit: unit,
            elements,
        })
    }

    /// Applies `cut`, which produced `mesh` from this model's mesh: duplicated nodes share the mass
    /// of their tets, and the springs at their edges are recomputed from the tets around them, so
    /// that the model equals [`DiscreteModel::new`] of the new mesh. Returns the springs at
    /// duplicated nodes. Takes time proportional to the cut, except for shifting the lists.
    ///
    /// # Errors
    /// As [`DiscreteModel::new`], and [`Error::Input`] if `mesh` is not the cut mesh; nothing is
    /// changed then.
    pub fn apply_cut(
        &mut self,
        mesh: &TetMesh,
        material: &Material,
        cut: &TetCut,
    ) -> Result<Vec<Spring>> {
        if mesh.nodes.len() != self.rest_positions.len() + cut.duplicated_nodes.len() {
            return Err(Error::Input(format!(
                "cannot apply the cut to a body of {} nodes: it duplicated {} nodes, but the cut mesh has {}; apply every cut in order",
                self.rest_positions.len(),
                cut.duplicated_nodes.len(),
                mesh.nodes.len()
            )));
        }
        if !cut.removed.is_empty() {
            let (frame, damping, kept) = (
                self.frame,
                self.elements.mass_damping,
                self.elements.per_tet_lambda_ratio,
            );
            *self = DiscreteModel::new(mesh, material)?;
            self.elements.mass_damping = damping;
            self.elements.per_tet_lambda_ratio = kept;
            // Positions stay in their present frame.
            let moved = (self.frame.origin - frame.origin) * self.length_unit;
            self.rest_positions.iter_mut().for_each(|x| *x += moved);
            self.frame = frame;
            return Ok(Vec::new());
        }
        let builder = ModelBuilder::new(mesh, material)?;
        let mut rest = self.rest_positions.clone();
        rest.extend(
            cut.duplicated_nodes
                .iter()
                .map(|[_, old]| self.rest_positions[*old as usize]),
        );
        let masses = builder.masses(cut.incident_tets.iter().map(|t| *t as usize))?;
        let springs = builder.springs(&cut.edge_tets, &rest)?;
        replace_sorted(
            &mut self.springs,
            |s| s.nodes,
            &cut.previous_edges,
            &springs,
        );
        builder.rename(&mut self.elements, &cut.incident_tets, &rest);
        self.masses.resize(mesh.nodes.len(), 0.0);
        for v in &cut.nodes {
            self.masses[*v as usize] = masses[*v as usize];
        }
        self.rest_positions = rest;
        Ok(springs)
    }

    /// Returns κ_d of a spring, N·s/m.
    pub fn spring_damping(&self, spring: &Spring) -> f64 {
        self.damping + self.damping_time * spring.stiffness
    }

    /// Converts a point from file coordinates to metres from the frame's origin.
    pub fn to_metres(&self, p: DVec3) -> DVec3 {
        (p - self.frame.origin) * self.length_unit
    }

    /// Converts a point from metres from the frame's origin to file coordinates.
    pub fn to_file(&self, x: DVec3) -> DVec3 {
        self.frame.origin + x / self.length_unit
    }
}

/// Assembles masses, springs and elements from a mesh and its material.
struct ModelBuilder<'a, F> {
    mesh: &'a TetMesh,
    material: &'a Material,
    material_of_tet: F,
    /// The region labels of the tets.
    labels: Option<&'a [f64]>,
    factors: Option<Factors<'a>>,
}

/// Stiffness factors, per tet or per node.
enum Factors<'a> {
    Cells(&'a [f64]),
    Nodes(&'a [f64]),
}

impl<'a> ModelBuilder<'a, ()> {
    fn new(
        mesh: &'a TetMesh,
        material: &'a Material,
    ) -> Result<ModelBuilder<'a, impl Fn(usize) -> RegionMaterial + Sync>> {
        Ok(ModelBuilder {
            mesh,
            material,
            material_of_tet: material_lookup(mesh, material)?,
            labels: match &material.region_field {
                Some(name) => Some(scalar_field(mesh, name, Location::Cell)?),
                None => None,
            },
            factors: match &material.stiffness_scale_field {
                Some(name) if mesh.field(name, Location::Cell).is_some() => {
                    Some(Factors::Cells(scalar_field(mesh, name, Location::Cell)?))
                }
                Some(name) => Some(Factors::Nodes(scalar_field(mesh, name, Location::Node)?)),
                None => None,
            },
        })
    }
}

impl<F: Fn(usize) -> RegionMaterial + Sync> ModelBuilder<'_, F> {
    /// Volume of a tet, m³.
    fn volume(&self, tet: usize) -> f64 {
        self.mesh.tet_volume(tet).abs() * self.material.length_unit.powi(3)
    }

    /// The material of a tet, without factors at nodes.
    fn material_of(&self, tet: usize) -> RegionMaterial {
        let tet_material = (self.material_of_tet)(tet);
        match &self.factors {
            Some(Factors::Cells(factors)) => RegionMaterial {
                stiffness: factors[tet] * tet_material.stiffness,
                ..tet_material
            },
            _ => tet_material,
        }
    }

    /// The mean factor of the given nodes.
    fn node_factor(&self, nodes: &[u32]) -> f64 {
        match &self.factors {
            Some(Factors::Nodes(factors)) => {
                let sum: f64 = nodes.iter().map(|v| factors[*v as usize]).sum();
                sum / nodes.len() as f64
            }
            _ => 1.0,
        }
    }

    /// The nodal masses contributed by `tets`, in ascending order.
    fn masses(&self, tets: impl Iterator<Item = usize>) -> Result<Vec<f64>> {
        let mut masses = vec![0.0; self.mesh.nodes.len()];
        for t in tets {
            let share = (self.material_of_tet)(t).density * self.volume(t) / 4.0;
            for v in self.mesh.tets[t] {
                masses[v as usize] += share;
            }
        }
        if !masses.iter().all(|m| m.is_finite()) {
            return Err(Error::Input(format!(
                "the masses of the mesh overflow with a length unit of {} m; check the length unit",
                self.material.length_unit
            )));
        }
        Ok(masses)
    }

    /// The finite elements of the tets, if the material has elements; degenerate tets are left out.
    fn elements(&self, rest: &[DVec3]) -> Elements {
        let law = match self.material.model {
            MaterialModel::Springs => return Elements::default(),
            MaterialModel::NeoHookean => ConstitutiveModel::NeoHookean,
            MaterialModel::Corotated => ConstitutiveModel::Corotated,
        };
        Elements {
            law,
            volume: self.material.volume,
            tets: parallel::collect(self.mesh.tets.len(), |range, tets| {
                tets.extend(range.filter_map(|t| self.element(t, law, rest)));
            }),
            rigid: rigid_bodies(self.mesh, |t| self.rigid_label(t)),
            mass_damping: self.material.mass_damping,
            ..Elements::default()
        }
    }

    /// The region of a tet, if it is rigid.
    fn rigid_label(&self, tet: usize) -> Option<i64> {
        let label = self.labels?.get(tet)?.round() as i64;
        self.material.rigid.contains(&label).then_some(label)
    }

    fn element(&self, t: usize, law: ConstitutiveModel, rest: &[DVec3]) -> Option<Element> {
        if self.rigid_label(t).is_some() {
            return None;
        }
        let nodes = self.mesh.tets[t];
        let tet_material = self.material_of(t);
        let stiffness = self.node_factor(&nodes) * tet_material.stiffness;
        let corners = nodes.map(|v| rest[v as usize]);
        let element = Element::new(nodes, corners, stiffness, tet_material.poisson, law)?;
        let regions = &self.material.regions;
        let region = self.labels.map_or(0, |labels| {
            let label = labels[t].round() as i64;
            regions
                .keys()
                .position(|l| *l == label)
                .map_or(0, |n| n + 1)
        });
        Some(Element {
            region: region as u32,
            ..element
        })
    }

    /// Updates the nodes of `elements` for the tets `star`.
    fn rename(&self, elements: &mut Elements, star: &[u32], rest: &[DVec3]) {
        if elements.is_empty() {
            return;
        }
        if elements.tets.len() != self.mesh.tets.len() {
            // Some tets were left out, so elements and tets do not correspond: rebuild.
            let (damping, kept) = (elements.mass_damping, elements.per_tet_lambda_ratio);
            *elements = self.elements(rest);
            elements.mass_damping = damping;
            elements.per_tet_lambda_ratio = kept;
            return;
        }
        for t in star {
            elements.tets[*t as usize].nodes = self.mesh.tets[*t as usize];
        }
    }

    /// The springs along edges, given as a sorted list with every incident tet.
    fn springs(&self, around: &[([u32; 2], u32)], rest: &[DVec3]) -> Result<Vec<Spring>> {
        let edges: Vec<&[([u32; 2], u32)]> = around.chunk_by(|a, b| a.0 == b.0).collect();
        let springs = parallel::map(edges.len(), |e| {
            let tets = edges[e].iter().map(|t| t.1 as usize);
            self.spring(edges[e][0].0, tets, rest)
        });
        match springs
            .iter()
            .find(|s| !s.stiffness.is_finite() || s.stiffness < 0.0)
        {
            Some(s) => Err(Error::Input(format!(
                "invalid stiffness of the spring between nodes {} and {}: {} N/m; check Young's modulus, the length unit and the stiffness scale fields",
                s.nodes[0], s.nodes[1], s.stiffness
            ))),
            None => Ok(springs),
        }
    }

    /// The spring along an edge with these incident tets.
    fn spring(&self, nodes: [u32; 2], tets: impl Iterator<Item = usize>, rest: &[DVec3]) -> Spring {
        let [i, j] = nodes.map(|v| v as usize);
        let length = rest[i].distance(rest[j]);
        let (mut volume, mut weighted) = (0.0, 0.0);
        for t in tets {
            let share = self.volume(t);
            volume += share;
            weighted += share * self.material_of(t).stiffness;
        }
        let stiffness = match self.material.stiffness {
            // A zero-length edge has no direction in which to resist.
            Stiffness::Young(_) if length * length <= f64::MIN_POSITIVE => 0.0,
            Stiffness::Young(_) => weighted / (length * length),
            Stiffness::Uniform(_) if volume > 0.0 => weighted / volume,
            Stiffness::Uniform(k) => k,
        };
        Spring {
            nodes,
            stiffness: stiffness * self.node_factor(&nodes),
            length,
        }
    }
}

/// Every edge with every incident tet, sorted.
fn edges_around(mesh: &TetMesh) -> Vec<([u32; 2], u32)> {
    let mut around = parallel::collect(mesh.tets.len(), |range, around| {
        for t in range {
            let tet = mesh.tets[t];
            let edges = TET_EDGES.map(|[a, b]| [tet[a].min(tet[b]), tet[a].max(tet[b])]);
            around.extend(edges.map(|edge| (edge, t as u32)));
        }
    });
    around.par_sort_unstable();
    around
}

/// The material of each tet, by its region.
fn material_lookup(
    mesh: &TetMesh,
    material: &Material,
) -> Result<impl Fn(usize) -> RegionMaterial> {
    let (Stiffness::Young(stiffness) | Stiffness::Uniform(stiffness)) = material.stiffness;
    let rest = RegionMaterial {
        stiffness,
        density: material.density,
        poisson: material.poisson,
    };
    let labels = match &material.region_field {
        Some(name) => Some(scalar_field(mesh, name, Location::Cell)?),
        None => None,
    };
    Ok(move |t: usize| {
        let label = labels.map(|labels| labels[t].round() as i64);
        let region = label.and_then(|label| material.regions.get(&label));
        let base = region.copied().unwrap_or(rest);
        match label.is_some_and(|label| material.rigid.contains(&label)) {
            // The stiffness of rigid tets affects the units only.
            true => RegionMaterial { stiffness, ..base },
            false => base,
        }
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
                "the material requires a field \"{name}\" with one component on the {location}, but {}; the mesh has {}",
                if found.is_some() {
                    "it has several components"
                } else {
                    "it does not exist"
                },
                match names.as_slice() {
                    [] => "no field of this kind".to_owned(),
                    _ => names.join(", "),
                }
            )))
        }
    }
}
