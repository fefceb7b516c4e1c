//! What a piece of a mesh is to know of the whole, so that its pictures are parts of the whole's: the
//! view, the fields' ranges, which field is seen, what its regions look like.

use super::region_appearance::mean_chords;
use super::{ScalarField, Scene};
use crate::io;
use crate::mesh::{Field, LocalFrame, Location, TetMesh, Topology};
use crate::render::{Camera, TableStatistics, TransferFunction};
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Of the layout that is written; others are refused.
const LAYOUT: u32 = 1;

/// What pieces are told of the mesh that they are of.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct MeshManifest {
    layout: u32,
    /// How many pieces there are.
    pub pieces: usize,
    /// Nodes of the whole.
    pub nodes: usize,
    /// Tets of the whole.
    pub tets: usize,
    /// Lower and upper corner of its box.
    bounds: [[f64; 3]; 2],
    /// The nodes that a view of all of it goes by.
    outline: Vec<[f64; 3]>,
    fields: Vec<WholeField>,
    /// Which of them is seen where nothing is said, without a transfer function and with one.
    chosen: [usize; 2],
    /// Which of them says the regions.
    regions: Option<usize>,
}

/// A field as the whole mesh has it.
#[derive(Clone, Debug, Deserialize, Serialize)]
struct WholeField {
    name: String,
    /// What pieces call it.
    stored: String,
    in_tets: bool,
    measures: TableStatistics,
    /// How it came to be seen where nobody asked for it.
    note: Option<String>,
    regions: Option<WholeRegions>,
}

/// A field's regions, in the order of their labels.
#[derive(Clone, Debug, Deserialize, Serialize)]
struct WholeRegions {
    labels: Vec<i64>,
    /// The mean way of a ray through each.
    ways: Vec<f64>,
    /// Of their numbers, in that order.
    measures: TableStatistics,
    colour: Vec<[f64; 4]>,
    extinction: Vec<[f64; 2]>,
    legend: Option<String>,
}

impl MeshManifest {
    /// What pieces of `mesh` are to know, and what is to be stored with them beside its fields: the
    /// depth below the surface, where that is seen.
    pub(super) fn new(mesh: &TetMesh, pieces: usize) -> Result<(MeshManifest, Option<Field>)> {
        let topology = Topology::new(mesh);
        let seen_in = |field: Option<&str>, plain: bool| {
            let mut scene = Scene::default();
            scene.picture.field = field.map(str::to_owned);
            scene.picture.transfer = (!plain).then(|| "tissue".to_owned());
            scene.scalar_field(mesh, &topology)
        };
        let defaults = [seen_in(None, true)?, seen_in(None, false)?];
        let mut fields: Vec<WholeField> = Vec::new();
        let mut extra = None;
        for field in &mesh.fields {
            if fields.iter().any(|known| known.name == field.name) {
                continue;
            }
            // One that is not finite is seen in no picture.
            let Ok(values) = seen_in(Some(&field.name), false) else {
                continue;
            };
            let regions = mesh.is_region_field(field).then(|| {
                let seen = seen_in(Some(&field.name), true)?;
                WholeRegions::new(mesh, &topology, field, &seen)
            });
            fields.push(WholeField {
                name: field.name.clone(),
                stored: field.name.clone(),
                in_tets: values.cells.is_some(),
                measures: TableStatistics::new(mesh, values.scalars()),
                note: None,
                regions: regions.transpose()?,
            });
        }
        let mut chosen = [0; 2];
        for (chosen, seen) in chosen.iter_mut().zip(&defaults) {
            let known = fields.iter().position(|f| f.name == seen.name);
            *chosen = match known {
                Some(known) => known,
                None => {
                    let stored = format!("{}{}", io::PRIVATE_PREFIX, seen.name);
                    extra = Some(Field::scalar(&stored, Location::Node, seen.values.clone()));
                    fields.push(WholeField {
                        name: seen.name.clone(),
                        stored,
                        in_tets: false,
                        measures: TableStatistics::new(mesh, seen.scalars()),
                        note: seen.note.clone(),
                        regions: None,
                    });
                    fields.len() - 1
                }
            };
        }
        let of_regions = mesh.region_field().map(|f| &f.name);
        let (low, high) = mesh.bounds();
        let whole = MeshManifest {
            layout: LAYOUT,
            pieces,
            nodes: mesh.nodes.len(),
            tets: mesh.tets.len(),
            bounds: [low, high].map(|p| p.to_array()),
            outline: outline(mesh).iter().map(|p| p.to_array()).collect(),
            regions: of_regions.and_then(|name| fields.iter().position(|f| &f.name == name)),
            fields,
            chosen,
        };
        Ok((whole, extra))
    }

    /// As bytes, for [`MeshManifest::from_bytes`].
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>> {
        serde_json::to_vec(self).map_err(|e| Error::Input(format!("the whole mesh: {e}")))
    }

    /// What [`MeshManifest::to_bytes`] made.
    pub(super) fn from_bytes(bytes: &[u8]) -> Result<MeshManifest> {
        let wrong = |e: &dyn std::fmt::Display| {
            Error::Input(format!(
                "what the piece says of the whole cannot be understood ({e}); cut the mesh anew with this version: palpate convert IN OUT.pvtu --pieces N"
            ))
        };
        let whole: MeshManifest = serde_json::from_slice(bytes).map_err(|e| wrong(&e))?;
        let fields = whole.fields.len();
        let known = whole
            .chosen
            .iter()
            .chain(&whole.regions)
            .all(|f| *f < fields);
        match whole.layout == LAYOUT && known {
            true => Ok(whole),
            false => Err(wrong(&format!("layout {}", whole.layout))),
        }
    }

    /// The frame that the whole is drawn in.
    pub fn frame(&self) -> LocalFrame {
        let [low, high] = self.bounds.map(DVec3::from);
        LocalFrame::from_bounds(low, high)
    }

    /// The view of a scene: of the whole, where it says nothing else.
    pub(super) fn camera(&self, scene: &Scene, size: [u32; 2]) -> Result<Camera> {
        let stand_in = TetMesh {
            nodes: self.outline.iter().map(|p| DVec3::from(*p)).collect(),
            ..TetMesh::default()
        };
        scene.camera(&stand_in, &stand_in.nodes, size)
    }

    /// The scalar of a piece that a scene sees, as [`Scene::scalar_field`] finds it in the whole, and
    /// what tables are made for.
    pub(super) fn scalar_field(
        &self,
        scene: &Scene,
        mesh: &TetMesh,
    ) -> Result<(ScalarField, TableStatistics)> {
        let picture = &scene.picture;
        let plain = picture.transfer.is_none();
        let seen = match &picture.field {
            None => self.fields.get(self.chosen[usize::from(!plain)]),
            Some(name) => self.fields.iter().find(|f| &f.name == name),
        };
        let Some(seen) = seen else {
            let names: Vec<&str> = self.fields.iter().map(|f| f.name.as_str()).collect();
            return Err(Error::Input(format!(
                "there is no field \"{}\", or none of finite numbers; there are {}",
                picture.field.as_deref().unwrap_or_default(),
                names.join(", ")
            )));
        };
        let location = match seen.in_tets {
            true => Location::Cell,
            false => Location::Node,
        };
        let field = mesh.field(&seen.stored, location).ok_or_else(|| {
            Error::Input(format!("the piece lacks the field \"{}\"", seen.stored))
        })?;
        let mut found = ScalarField {
            name: seen.name.clone(),
            values: Vec::new(),
            cells: None,
            range: seen.measures.range,
            note: seen.note.clone(),
            transfer: None,
            regions: Vec::new(),
        };
        let mut measures = seen.measures.clone();
        if let (true, Some(regions)) = (plain, &seen.regions) {
            let number = |label: &f64| {
                let place = regions.labels.binary_search(&(*label as i64));
                place.map_or(0.0, |n| n as f64)
            };
            found.cells = Some(field.values.iter().map(number).collect());
            found.note = regions.legend.clone();
            found.transfer = Some(TransferFunction::new(
                regions.colour.clone(),
                regions.extinction.clone(),
            )?);
            measures = regions.measures.clone();
            found.range = measures.range;
        } else {
            let values = super::mesh_source::magnitudes(field);
            match seen.in_tets {
                true => found.cells = Some(values),
                false => found.values = values,
            }
            if let Some([low, high]) = picture.range {
                found.range = (low, high);
                if low < high {
                    measures = measures.with_range((low, high));
                }
            }
        }
        Ok((found, measures))
    }

    /// The label of each tet of a piece, and of each region of the whole the mean way of a ray through
    /// it; none where there are no regions.
    pub(super) fn regions(&self, mesh: &TetMesh) -> Option<(Vec<i64>, BTreeMap<i64, f64>)> {
        let seen = self.fields.get(self.regions?)?;
        let regions = seen.regions.as_ref()?;
        let field = mesh.field(&seen.stored, Location::Cell)?;
        let labels = field.values.iter().map(|v| *v as i64).collect();
        let ways = regions
            .labels
            .iter()
            .copied()
            .zip(regions.ways.iter().copied());
        Some((labels, ways.collect()))
    }
}

impl WholeRegions {
    /// Those that `field` says, which are seen as in `seen`.
    fn new(
        mesh: &TetMesh,
        topology: &Topology,
        field: &Field,
        seen: &ScalarField,
    ) -> Result<WholeRegions> {
        let labels: Vec<i64> = field.values.iter().map(|v| *v as i64).collect();
        let ways = mean_chords(mesh, topology, &labels);
        let transfer = seen.transfer.as_ref().ok_or_else(|| {
            Error::Input(format!("the regions of \"{}\" have no colours", field.name))
        })?;
        // These are absolute, whatever they are resolved for.
        let transfer = transfer.to_absolute(seen.range, 1.0);
        Ok(WholeRegions {
            labels: ways.keys().copied().collect(),
            ways: ways.into_values().collect(),
            measures: TableStatistics::new(mesh, seen.scalars()),
            colour: transfer.colour_nodes().to_vec(),
            extinction: transfer.extinction_nodes().to_vec(),
            legend: seen.note.clone(),
        })
    }
}

/// The nodes by which all of `mesh` is framed, whatever the shape of the picture: those that are
/// farthest along an axis, and farthest out for their distance from the eye, sideways and upwards.
fn outline(mesh: &TetMesh) -> Vec<DVec3> {
    let axes = Camera::fit_mesh(mesh).axes();
    let mut found = Vec::new();
    for k in 0..3 {
        let along = |p: &&DVec3, q: &&DVec3| p[k].total_cmp(&q[k]);
        found.extend(mesh.nodes.iter().min_by(along));
        found.extend(mesh.nodes.iter().max_by(along));
    }
    for side in [axes.right, axes.up] {
        let seen = |v: &u32| {
            let p = mesh.nodes[*v as usize];
            DVec2::new(p.dot(side), p.dot(axes.forward))
        };
        found.extend(hull(mesh.nodes.len() as u32, seen).map(|v| mesh.nodes[v as usize]));
    }
    found
}

/// Which of so many points are corners of their convex hull in a plane (Andrew 1979).
fn hull(count: u32, at: impl Fn(&u32) -> DVec2) -> impl Iterator<Item = u32> {
    let mut order: Vec<u32> = (0..count).collect();
    order.sort_by(|a, b| {
        let (a, b) = (at(a), at(b));
        a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y))
    });
    let half = |points: &mut dyn Iterator<Item = &u32>| {
        let mut chain: Vec<u32> = Vec::new();
        for v in points {
            while let [.., a, b] = chain[..]
                && (at(&b) - at(&a)).perp_dot(at(v) - at(&b)) <= 0.0
            {
                chain.pop();
            }
            chain.push(*v);
        }
        chain
    };
    let lower = half(&mut order.iter());
    let upper = half(&mut order.iter().rev());
    lower.into_iter().chain(upper)
}
