//! Global data of a mesh stored with each of its pieces, so that the pictures of pieces fit
//! together: the camera, the ranges of the fields, the displayed field and the regions' appearance.

use super::region_appearance::mean_chords;
use super::{ScalarField, Scene};
use crate::io;
use crate::mesh::{Field, LocalFrame, Location, TetMesh, Topology};
use crate::render::{Camera, TableStatistics, TransferFunction};
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the layout; other versions are rejected.
const LAYOUT: u32 = 1;

/// Global data of the mesh, stored with each piece.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct MeshManifest {
    layout: u32,
    /// Number of pieces.
    pub pieces: usize,
    /// Number of nodes of the whole mesh.
    pub nodes: usize,
    /// Number of tetrahedra of the whole mesh.
    pub tets: usize,
    /// Lower and upper corner of the bounding box.
    bounds: [[f64; 3]; 2],
    /// Nodes that determine the view of the whole mesh.
    outline: Vec<[f64; 3]>,
    fields: Vec<WholeField>,
    /// Indices of the default fields, without a transfer function and with one.
    chosen: [usize; 2],
    /// Index of the region field.
    regions: Option<usize>,
}

/// A field of the whole mesh.
#[derive(Clone, Debug, Deserialize, Serialize)]
struct WholeField {
    name: String,
    /// Name in the pieces.
    stored: String,
    in_tets: bool,
    measures: TableStatistics,
    /// Why it is displayed by default.
    note: Option<String>,
    regions: Option<WholeRegions>,
}

/// Regions of a field, in the order of their labels.
#[derive(Clone, Debug, Deserialize, Serialize)]
struct WholeRegions {
    labels: Vec<i64>,
    /// Mean chord length of rays through each region.
    #[serde(rename = "ways")]
    chord_lengths: Vec<f64>,
    /// Statistics of the region indices, in that order.
    measures: TableStatistics,
    colour: Vec<[f64; 4]>,
    extinction: Vec<[f64; 2]>,
    legend: Option<String>,
}

impl MeshManifest {
    /// Returns the global data for `pieces` pieces of `mesh`, and a field to be stored in addition
    /// to those of the mesh: the depth below the surface, if it is displayed.
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
            // A field with non-finite values cannot be displayed.
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

    /// Serialises the manifest, for [`MeshManifest::from_bytes`].
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>> {
        serde_json::to_vec(self)
            .map_err(|e| Error::Input(format!("cannot encode the data of the whole mesh: {e}")))
    }

    /// Deserialises the output of [`MeshManifest::to_bytes`].
    pub(super) fn from_bytes(bytes: &[u8]) -> Result<MeshManifest> {
        let wrong = |e: &dyn std::fmt::Display| {
            Error::Input(format!(
                "cannot read the data of the whole mesh in the piece ({e}); write the pieces again with this version: palpate convert IN OUT.pvtu --pieces N"
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

    /// Returns the local frame in which the whole mesh is drawn.
    pub fn frame(&self) -> LocalFrame {
        let [low, high] = self.bounds.map(DVec3::from);
        LocalFrame::from_bounds(low, high)
    }

    /// Returns the camera of a scene; by default it frames the whole mesh.
    pub(super) fn camera(&self, scene: &Scene, size: [u32; 2]) -> Result<Camera> {
        let stand_in = TetMesh {
            nodes: self.outline.iter().map(|p| DVec3::from(*p)).collect(),
            ..TetMesh::default()
        };
        scene.camera(&stand_in, &stand_in.nodes, size)
    }

    /// Returns the scalar field of a piece that a scene displays, selected as by
    /// [`Scene::scalar_field`] for the whole mesh, and its table statistics.
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
                "unknown field \"{}\", or its values are not finite; available: {}",
                picture.field.as_deref().unwrap_or_default(),
                names.join(", ")
            )));
        };
        let location = match seen.in_tets {
            true => Location::Cell,
            false => Location::Node,
        };
        let field = mesh
            .field(&seen.stored, location)
            .ok_or_else(|| Error::Input(format!("the piece has no field \"{}\"", seen.stored)))?;
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

    /// Returns the label of each tetrahedron of a piece and the mean chord length of rays through
    /// each region of the whole mesh; `None` without regions.
    pub(super) fn regions(&self, mesh: &TetMesh) -> Option<(Vec<i64>, BTreeMap<i64, f64>)> {
        let seen = self.fields.get(self.regions?)?;
        let regions = seen.regions.as_ref()?;
        let field = mesh.field(&seen.stored, Location::Cell)?;
        let labels = field.values.iter().map(|v| *v as i64).collect();
        let chord_lengths = regions
            .labels
            .iter()
            .copied()
            .zip(regions.chord_lengths.iter().copied());
        Some((labels, chord_lengths.collect()))
    }
}

impl WholeRegions {
    /// Creates the regions of `field`, with the appearance of `seen`.
    fn new(
        mesh: &TetMesh,
        topology: &Topology,
        field: &Field,
        seen: &ScalarField,
    ) -> Result<WholeRegions> {
        let labels: Vec<i64> = field.values.iter().map(|v| *v as i64).collect();
        let chord_lengths = mean_chords(mesh, topology, &labels);
        let transfer = seen.transfer.as_ref().ok_or_else(|| {
            Error::Input(format!("the regions of \"{}\" have no colours", field.name))
        })?;
        // Extinctions are absolute already, so the length does not matter.
        let transfer = transfer.to_absolute(seen.range, 1.0);
        Ok(WholeRegions {
            labels: chord_lengths.keys().copied().collect(),
            chord_lengths: chord_lengths.into_values().collect(),
            measures: TableStatistics::new(mesh, seen.scalars()),
            colour: transfer.colour_nodes().to_vec(),
            extinction: transfer.extinction_nodes().to_vec(),
            legend: seen.note.clone(),
        })
    }
}

/// Returns the nodes that determine the framing of `mesh` for any aspect ratio: the extreme ones
/// along each axis, and the convex hulls seen along the camera's up and right axes.
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

/// Returns the corners of the convex hull of `count` points in a plane (monotone chain, Andrew
/// 1979).
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
