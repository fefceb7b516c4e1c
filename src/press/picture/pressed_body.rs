//! The body that pictures of a press show: its boundary, and its regions with their names and colours.

use super::super::session::static_body;
use super::body::Body;
use super::drawing::Layout;
use crate::Result;
use crate::annotate::{Legend, Swatch};
use crate::mesh::{SmoothRegions, Topology};
use crate::render::{named_colour, tissue_colour};
use crate::scene::{Motion, Scene, Stage};
use glam::DVec3;
use std::collections::BTreeMap;

/// Colour of the boundary, and of the inside of a body without regions.
const SKIN: [f32; 3] = [0.91, 0.74, 0.63];
const FLESH: [f32; 3] = [0.86, 0.47, 0.42];
/// Colours of regions whose name is no tissue.
const PALETTE: [&str; 8] = [
    "#e7c873", "#d9796b", "#6f9fc4", "#7fb38a", "#a58bc0", "#e0a06a", "#c9c3b6", "#5fb0ad",
];
/// Tissues of an outermost layer that is drawn as skin.
const OUTER_TISSUES: [&str; 3] = ["skin", "fat", "adipose"];

/// What does not change during a press.
pub(super) struct PressedBody {
    /// Numbers of nodes and tets of the body.
    size: [usize; 2],
    rest: Vec<DVec3>,
    faces: Vec<([u32; 3], u32)>,
    tets: Vec<[u32; 4]>,
    /// Region of each tet.
    regions: Vec<u16>,
    /// What carries the nodes, if they are not those of the body.
    pub smooth: Option<SmoothRegions>,
    names: Vec<String>,
    colours: Vec<[f32; 3]>,
    skin: Option<[f32; 3]>,
    /// Metres per file unit.
    pub length_unit: f64,
}

impl PressedBody {
    /// Collects what the pictures of a press on the body of `stage` need.
    pub fn new(stage: &Stage) -> Result<PressedBody> {
        let motion = stage.motion().ok_or_else(static_body)?;
        let own = motion.simulator.mesh();
        let (_, scene) = stage.origin();
        let smooth = scene.smooth_regions(own)?;
        let mesh = smooth.as_ref().map_or(own, |smooth| &smooth.mesh);
        let topology = Topology::new(mesh);
        let faces = topology.boundary.iter();
        let faces: Vec<_> = faces
            .map(|b| (topology.boundary_nodes(mesh, *b), b.tet))
            .collect();
        let labels: Vec<i64> = match mesh.region_field() {
            Some(field) => field.values.iter().map(|v| *v as i64).collect(),
            None => vec![0; mesh.tets.len()],
        };
        let numbers: BTreeMap<i64, u16> = labels
            .iter()
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .zip(0u16..)
            .map(|(label, number)| (*label, number))
            .collect();
        let regions: Vec<u16> = labels.iter().map(|label| numbers[label]).collect();
        let mut names = Vec::new();
        let mut colours = Vec::new();
        for (label, number) in &numbers {
            let name = mesh.region_names.get(label).cloned();
            let name = name.unwrap_or_else(|| format!("region {label}"));
            colours.push(match numbers.len() {
                1 => FLESH,
                _ => region_colour(scene, stage, (*label, &name), *number)?,
            });
            names.push(name);
        }
        let mut outer = vec![0usize; names.len()];
        for (_, tet) in &faces {
            outer[usize::from(regions[*tet as usize])] += 1;
        }
        let outermost = (0..outer.len()).max_by_key(|r| outer[*r]).unwrap_or(0);
        let name = names
            .get(outermost)
            .map(|n| n.to_lowercase())
            .unwrap_or_default();
        let is_skin = names.len() == 1 || OUTER_TISSUES.iter().any(|t| name.contains(t));
        Ok(PressedBody {
            size: [own.nodes.len(), own.tets.len()],
            length_unit: motion.length_unit(),
            rest: mesh.nodes.clone(),
            tets: mesh.tets.clone(),
            faces,
            regions,
            smooth,
            names,
            colours,
            skin: is_skin.then_some(SKIN),
        })
    }

    /// Whether this is the body of `motion`, which a cut changes.
    pub fn is_of(&self, motion: &Motion) -> bool {
        let own = motion.simulator.mesh();
        self.size == [own.nodes.len(), own.tets.len()]
    }

    pub fn body<'a>(&'a self, positions: &'a [DVec3]) -> Body<'a> {
        Body {
            rest: &self.rest,
            nodes: positions,
            tets: &self.tets,
            faces: &self.faces,
            regions: &self.regions,
            colours: &self.colours,
            skin: self.skin,
        }
    }

    /// Returns the regions that are seen on the cut; `None` for a body without regions.
    pub fn legend(&self, layout: &Layout) -> Option<Legend> {
        let seen = layout.regions.iter().map(|r| usize::from(*r));
        let regions: Vec<Swatch> = seen
            .map(|r| Swatch {
                name: self.names[r].clone(),
                colour: self.colours[r].map(f64::from),
            })
            .collect();
        let has_skin = self.names.iter().any(|name| name.contains("skin"));
        let surface = self.skin.filter(|_| !has_skin).map(|colour| Swatch {
            name: "surface".into(),
            colour: colour.map(f64::from),
        });
        (self.names.len() > 1 && !regions.is_empty()).then(|| Legend::Regions {
            name: "regions".into(),
            regions: regions.into_iter().chain(surface).collect(),
        })
    }
}

/// Returns the colour of a region: that of the scene, of its tissue, of the scene's transfer function, or
/// of its number.
fn region_colour(
    scene: &Scene,
    stage: &Stage,
    (label, name): (i64, &str),
    number: u16,
) -> Result<[f32; 3]> {
    let entries = &scene.picture.region;
    let entry = entries
        .get(name)
        .or_else(|| entries.get(&label.to_string()));
    if let Some(colour) = entry.and_then(|entry| entry.colour.as_deref()) {
        return Ok(named_colour(colour)?.map(|c| c as f32));
    }
    let seen = stage.scalar_field();
    let own = scene.picture.transfer.is_some() && !seen.regions.is_empty();
    if own {
        let extent = crate::mesh::LocalFrame::from_mesh(stage.mesh()).scale;
        let transfer = scene.transfer(seen)?.to_absolute(seen.range, extent);
        return Ok(transfer.colour(label as f64).map(|c| c as f32));
    }
    if let Some(colour) = tissue_colour(name) {
        return Ok(colour);
    }
    let colour = PALETTE[usize::from(number) % PALETTE.len()];
    Ok(named_colour(colour)?.map(|c| c as f32))
}
