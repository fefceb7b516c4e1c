//! Bodies made of the cells of a cage: tetrahedra with springs or elements, or a grid of particles.

use super::lattice::Cells;
use crate::generate::{Grid, Split, grid};
use crate::mesh::{LocalFrame, TET_EDGES, TetMesh};
use crate::physics::grid::{GridModel, GridShape, SPRING_KINDS, isotropic_stiffness};
use crate::physics::{
    ConstitutiveModel, DiscreteModel, Discretisation, Edge, Element, Material, SpringNetwork,
};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Creates a body of springs along `edges` with the damping of the fine body.
fn damped_as(
    fine: &DiscreteModel,
    frame: LocalFrame,
    rest: Vec<DVec3>,
    masses: Vec<f64>,
    edges: Vec<Edge>,
) -> DiscreteModel {
    // A constant κ_d for springs of any length is comparable between mesh resolutions only relative
    // to their stiffness.
    let springs = fine.springs().copied().unwrap_or_default();
    let total: f64 = fine.edges.iter().map(|e| e.stiffness).sum();
    let extra = match total > 0.0 {
        true => springs.damping * fine.edges.len() as f64 / total,
        false => 0.0,
    };
    DiscreteModel {
        rest_positions: rest,
        masses,
        edges,
        damping_time: fine.damping_time + extra,
        frame,
        length_unit: fine.length_unit,
        added_masses: Vec::new(),
        discretisation: Discretisation::Springs(SpringNetwork {
            damping: 0.0,
            damping_kind: springs.damping_kind,
        }),
    }
}

/// Creates tetrahedra over the cells, with elements for a body of finite elements, and with springs
/// along their edges otherwise.
///
/// A cell of five tetrahedra has each edge of the cell, and one diagonal of each face. Full cells
/// are isotropic: edges use κ of [`isotropic_stiffness`], shared by four cells; diagonals use twice
/// κ, because there is one in place of two, shared by two cells.
pub(super) fn lattice(cells: &Cells, fine: &DiscreteModel) -> Result<(TetMesh, DiscreteModel)> {
    let held = |c: [usize; 3]| cells.content(c.map(|n| n as i64)).occupied;
    let Grid { nodes, tets } = grid(cells.count, Split::Five, held)?;
    let place = |n: &[usize; 3]| cells.low + cells.spacing * DVec3::from(n.map(|i| i as f64));
    let mesh = TetMesh {
        nodes: nodes.iter().map(place).collect(),
        tets,
        length_unit: Some(fine.length_unit),
        ..TetMesh::default()
    };
    let unit = fine.length_unit;
    let shares = isotropic_stiffness(cells.spacing * unit, 1.0)?;
    let mut masses = vec![0.0; mesh.nodes.len()];
    let mut stiffnesses: BTreeMap<[u32; 2], f64> = BTreeMap::new();
    let mut elements = Vec::new();
    for five in mesh.tets.chunks_exact(5) {
        let corner = |v: u32| nodes[v as usize];
        let lowest = five
            .iter()
            .flatten()
            .map(|v| corner(*v))
            .reduce(|a, b| [0, 1, 2].map(|k| a[k].min(b[k])))
            .unwrap_or_default();
        let content = cells.content(lowest.map(|n| n as i64));
        if let Some(fine) = fine.elements() {
            for tet in five {
                elements.push(element(&mesh, *tet, content.lame, (fine.law, unit))?);
            }
        }
        let mut edges: Vec<[u32; 2]> = five
            .iter()
            .flat_map(|tet| TET_EDGES.map(|[a, b]| [tet[a].min(tet[b]), tet[a].max(tet[b])]))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut corners: Vec<u32> = edges.iter().flatten().copied().collect();
        corners.sort_unstable();
        corners.dedup();
        for v in &corners {
            masses[*v as usize] += content.mass / corners.len() as f64;
        }
        for [a, b] in edges {
            let (p, q) = (corner(a), corner(b));
            let along = [0, 1, 2].map(|k| q[k] as i64 - p[k] as i64);
            let kind = GridShape::SPRING_OFFSETS
                .iter()
                .position(|s| s.map(i64::abs) == along.map(i64::abs));
            let kappa = kind.map_or(0.0, |k| shares[k]);
            let axial = along.iter().filter(|n| **n != 0).count() == 1;
            let share = if axial { 0.25 } else { 1.0 };
            *stiffnesses.entry([a, b]).or_insert(0.0) += share * kappa * content.young;
        }
    }
    let frame = LocalFrame::from_mesh(&mesh);
    let rest: Vec<DVec3> = mesh
        .nodes
        .iter()
        .map(|p| (*p - frame.origin) * unit)
        .collect();
    let edges = stiffnesses
        .into_iter()
        .map(|(nodes, stiffness)| {
            let [a, b] = nodes.map(|v| rest[v as usize]);
            Edge {
                nodes,
                stiffness,
                length: a.distance(b),
            }
        })
        .collect();
    let mut discrete_model = damped_as(fine, frame, rest, masses, edges);
    if let Some(fine) = fine.elements() {
        discrete_model.discretisation = Discretisation::Elements(fine.with_linear_tets(elements));
    }
    Ok((mesh, discrete_model))
}

/// Creates an element of `mesh` from Lamé parameters μ and λ, Pa, with the constitutive model
/// `law`; the mesh has the length unit `unit`.
fn element(
    mesh: &TetMesh,
    tet: [u32; 4],
    [mu, lambda]: [f64; 2],
    (law, unit): (ConstitutiveModel, f64),
) -> Result<Element> {
    let young = mu * (3.0 * lambda + 2.0 * mu) / (lambda + mu);
    let poisson = 0.5 * lambda / (lambda + mu);
    let corners = tet.map(|v| mesh.nodes[v as usize] * unit);
    Element::new(tet, corners, young, poisson, law).ok_or_else(|| {
        Error::Mesh(format!(
            "invalid material of a cage cell: Young's modulus {young} Pa, Poisson's ratio {poisson}; reduce the number of cage nodes"
        ))
    })
}

/// Creates particles at the corners of the cells: each has an eighth of the mass of its incident
/// cells, and the mean of their moduli.
pub(super) fn particles(cells: &Cells, fine: &DiscreteModel) -> Result<GridModel> {
    // A layer of empty particles surrounds those of the cells.
    let size = cells.count.map(|n| n + 3);
    let total: usize = size.iter().product();
    let at = |i: usize| {
        let [nx, ny, _] = size;
        [i % nx, i / nx % ny, i / (nx * ny)].map(|n| n as i64 - 1)
    };
    let around = |p: [i64; 3]| {
        (0..8i64)
            .map(move |k| cells.content([p[0] - (k & 1), p[1] - (k >> 1 & 1), p[2] - (k >> 2)]))
    };
    let shape = GridShape {
        size,
        spacing: cells.spacing,
        axes: DMat3::IDENTITY,
        origin: cells.low - cells.spacing,
        regions: (0..total)
            .map(|i| u16::from(around(at(i)).any(|c| c.occupied)))
            .collect(),
        labels: vec![1],
    };
    let held = |c: [i64; 3]| cells.content(c).occupied;
    // Keeps only springs within an occupied cell.
    let mut springs = shape.springs();
    for (i, mask) in springs.iter_mut().enumerate() {
        let p = at(i);
        for bit in 0..2 * SPRING_KINDS {
            let step =
                GridShape::SPRING_OFFSETS[bit / 2].map(|s| if bit % 2 == 0 { s } else { -s });
            let shared = (0..8i64).any(|k| {
                let cell = [p[0] - (k & 1), p[1] - (k >> 1 & 1), p[2] - (k >> 2)];
                let inside = |a: usize| (0..=1).contains(&(p[a] + step[a] - cell[a]));
                held(cell) && (0..3).all(inside)
            });
            if !shared {
                *mask &= !(1 << bit);
            }
        }
    }
    let means: Vec<f64> = (0..total)
        .map(|i| around(at(i)).map(|c| c.young).sum::<f64>() / 8.0)
        .collect();
    let body = means.iter().copied().fold(0.0, f64::max);
    let material = Material {
        length_unit: fine.length_unit,
        ..Material::from_young(body)
    };
    let mut model = GridModel::new(shape, &material)?;
    model.springs = springs;
    model.masses = (0..total)
        .map(|i| around(at(i)).map(|c| c.mass).sum::<f64>() / 8.0)
        .collect();
    model.stiffness_scales = means
        .iter()
        .map(|k| if body > 0.0 { k / body } else { 0.0 })
        .collect();
    Ok(model)
}

/// Converts the masses and springs of a grid to a body of springs.
pub(super) fn model_of(model: &GridModel, fine: &DiscreteModel) -> DiscreteModel {
    let (shape, frame, unit) = (&model.shape, model.frame, model.length_unit);
    let offsets = shape.offsets();
    let lengths = shape.rest_lengths();
    let mut edges = Vec::new();
    for i in shape.particles() {
        for k in (0..SPRING_KINDS).filter(|k| model.springs[i] >> (2 * k) & 1 == 1) {
            let j = (i as i64 + offsets[k]) as usize;
            edges.push(Edge {
                nodes: [i.min(j) as u32, i.max(j) as u32],
                stiffness: 0.5
                    * (model.stiffness_scales[i] + model.stiffness_scales[j])
                    * model.stiffness[k],
                length: lengths[k] * unit,
            });
        }
    }
    edges.sort_unstable_by_key(|e| e.nodes);
    let rest = (0..shape.regions.len())
        .map(|i| (shape.rest_position(i) - frame.origin) * unit)
        .collect();
    damped_as(fine, frame, rest, model.masses.clone(), edges)
}
