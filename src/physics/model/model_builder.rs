//! Assembly of a discrete model from a mesh and its material.

use super::discretisation::{Discretisation, Edge, SpringNetwork};
use super::elements::{ConstitutiveModel, Element, Elements};
use super::material::{Material, MaterialModel, RegionMaterial, Stiffness};
use super::quadratic::{MidEdges, QuadraticShape};
use super::rigid_region::rigid_bodies;
use crate::mesh::{ElementOrder, Field, Location, PIECES, TET_EDGES, TenNodes, TetMesh};
use crate::parallel;
use crate::{Error, Result};
use glam::DVec3;
use rayon::slice::ParallelSliceMut;

/// Assembles masses, edges and elements from a mesh and its material.
pub(super) struct ModelBuilder<'a, F> {
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
    pub(super) fn new(
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
    pub(super) fn masses(&self, tets: impl Iterator<Item = usize>) -> Result<Vec<f64>> {
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

    /// The springs or elements of the material; springs too if every tet is degenerate.
    pub(super) fn discretisation(&self, rest: &[DVec3]) -> Result<Discretisation> {
        let elements = match self.material.model {
            MaterialModel::Springs => None,
            MaterialModel::NeoHookean => Some(self.elements(ConstitutiveModel::NeoHookean, rest)?),
            MaterialModel::Corotated => Some(self.elements(ConstitutiveModel::Corotated, rest)?),
        };
        Ok(match elements {
            Some(elements) if !elements.is_empty() => Discretisation::Elements(elements),
            _ => Discretisation::Springs(SpringNetwork {
                damping: self.material.damping,
                damping_kind: self.material.damping_kind,
            }),
        })
    }

    /// The finite elements of the tets; degenerate tets are left out.
    fn elements(&self, law: ConstitutiveModel, rest: &[DVec3]) -> Result<Elements> {
        let (tets, mid_edges) = match self.material.order {
            ElementOrder::Linear => {
                let tets = parallel::collect(self.mesh.tets.len(), |range, tets| {
                    tets.extend(range.filter_map(|t| self.element(t, law, rest)));
                });
                (tets, Vec::new())
            }
            ElementOrder::Quadratic => self.quadratic_elements(law, rest)?,
        };
        Ok(Elements {
            law,
            volume: self.material.volume,
            tets,
            mid_edges,
            rigid: rigid_bodies(self.mesh, |t| self.rigid_label(t)),
            mass_damping: self.material.mass_damping,
            ..Elements::default()
        })
    }

    /// The ten-node tets; those that are degenerate or folded at rest are left out.
    fn quadratic_elements(
        &self,
        law: ConstitutiveModel,
        rest: &[DVec3],
    ) -> Result<(Vec<Element>, Vec<MidEdges>)> {
        let nodes = self.mesh.ten_node_tets()?;
        let all = parallel::collect(nodes.len(), |range, all| {
            all.extend(range.filter_map(|t| self.quadratic_element(t, &nodes[t], law, rest)));
        });
        Ok(all.into_iter().unzip())
    }

    /// The ten-node tet with pieces `PIECES * t` and on.
    fn quadratic_element(
        &self,
        t: usize,
        nodes: &TenNodes,
        law: ConstitutiveModel,
        rest: &[DVec3],
    ) -> Option<(Element, MidEdges)> {
        let x = nodes.map(|v| rest[v as usize]);
        let shape = QuadraticShape::new(&x)?;
        let [a, b, c, d, middles @ ..] = *nodes;
        let element = self.element_of(PIECES * t, [a, b, c, d], law, rest)?;
        let mut offsets = [DVec3::ZERO; 6];
        for (k, [a, b]) in TET_EDGES.into_iter().enumerate() {
            offsets[k] = x[4 + k] - x[a].midpoint(x[b]);
        }
        let element = Element {
            volume: shape.volumes.iter().sum(),
            ..element
        };
        let mid_edges = MidEdges {
            nodes: middles,
            offsets,
        };
        Some((element, mid_edges))
    }

    /// The region of a tet, if it is rigid.
    fn rigid_label(&self, tet: usize) -> Option<i64> {
        let label = self.labels?.get(tet)?.round() as i64;
        self.material.rigid.contains(&label).then_some(label)
    }

    fn element(&self, t: usize, law: ConstitutiveModel, rest: &[DVec3]) -> Option<Element> {
        self.element_of(t, self.mesh.tets[t], law, rest)
    }

    /// The element with corners `nodes` of the material of tet `t`; `None` if it is degenerate or
    /// rigid.
    fn element_of(
        &self,
        t: usize,
        nodes: [u32; 4],
        law: ConstitutiveModel,
        rest: &[DVec3],
    ) -> Option<Element> {
        if self.rigid_label(t).is_some() {
            return None;
        }
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
    ///
    /// # Errors
    /// [`Error::Input`] if the tets of a body of order 2 are no longer the pieces of its elements.
    pub(super) fn renumber(
        &self,
        elements: &mut Elements,
        star: &[u32],
        rest: &[DVec3],
    ) -> Result<()> {
        if elements.order() == 2 || elements.tets.len() != self.mesh.tets.len() {
            // Elements and tets do not correspond one to one: rebuild.
            *elements = Elements {
                mass_damping: elements.mass_damping,
                per_tet_lambda_ratio: elements.per_tet_lambda_ratio,
                ..self.elements(elements.law, rest)?
            };
            return Ok(());
        }
        for t in star {
            elements.tets[*t as usize].nodes = self.mesh.tets[*t as usize];
        }
        Ok(())
    }

    /// The number in the material that is the stiffness of each tet, without factors.
    pub(super) fn stiffness_numbers(&self) -> Vec<f64> {
        let tets = 0..self.mesh.tets.len();
        tets.map(|t| (self.material_of_tet)(t).stiffness).collect()
    }

    /// The derivative of the stiffness of the edge between two nodes by the stiffness number of each
    /// incident tet.
    pub(super) fn edge_shares(
        &self,
        nodes: [u32; 2],
        tets: &[([u32; 2], u32)],
        rest: &[DVec3],
    ) -> Vec<(u32, f64)> {
        let [i, j] = nodes.map(|v| v as usize);
        let over = match self.material.stiffness {
            Stiffness::Young(_) => rest[i].distance_squared(rest[j]),
            Stiffness::Uniform(_) => tets.iter().map(|t| self.volume(t.1 as usize)).sum(),
        };
        let factor = self.node_factor(&nodes);
        let of_tet = |t: u32| {
            let own = match &self.factors {
                Some(Factors::Cells(factors)) => factors[t as usize],
                _ => 1.0,
            };
            match over > 0.0 {
                true => factor * own * self.volume(t as usize) / over,
                false => 0.0,
            }
        };
        tets.iter().map(|(_, t)| (*t, of_tet(*t))).collect()
    }

    /// The edges, given as a sorted list with every incident tet.
    pub(super) fn edges(&self, around: &[([u32; 2], u32)], rest: &[DVec3]) -> Result<Vec<Edge>> {
        let groups: Vec<&[([u32; 2], u32)]> = around.chunk_by(|a, b| a.0 == b.0).collect();
        let edges = parallel::map(groups.len(), |e| {
            let tets = groups[e].iter().map(|t| t.1 as usize);
            self.edge(groups[e][0].0, tets, rest)
        });
        match edges
            .iter()
            .find(|e| !e.stiffness.is_finite() || e.stiffness < 0.0)
        {
            Some(e) => Err(Error::Input(format!(
                "invalid stiffness of the spring between nodes {} and {}: {} N/m; check Young's modulus, the length unit and the stiffness scale fields",
                e.nodes[0], e.nodes[1], e.stiffness
            ))),
            None => Ok(edges),
        }
    }

    /// The edge between two nodes, with these incident tets.
    fn edge(&self, nodes: [u32; 2], tets: impl Iterator<Item = usize>, rest: &[DVec3]) -> Edge {
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
        Edge {
            nodes,
            stiffness: stiffness * self.node_factor(&nodes),
            length,
        }
    }
}

/// Every edge with every incident tet, sorted.
pub(super) fn edges_around(mesh: &TetMesh) -> Vec<([u32; 2], u32)> {
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
