//! A scene's skins: read, bound to the body, cut open with it.

use super::stage::Actor;
use super::{Mover, SkinEntry};
use crate::gpu::Gpu;
use crate::mesh::{Blade, TetMesh, Topology, TriMesh};
use crate::mesher::{Labels, Recipe};
use crate::render::TransferFunction;
use crate::skin::{Carrier, Map, Skin, SkinColour};
use crate::{Error, Result};
use glam::DVec3;

/// A skin as its scene describes it, to be bound again after a cut.
pub(super) struct Dress {
    entry: SkinEntry,
    surface: TriMesh,
    normal_map: Option<Map>,
    height_map: Option<(Map, f32)>,
    /// Triangles that no cut has opened.
    shown: Vec<bool>,
}

impl Dress {
    /// Reads what the entry names.
    pub fn new(entry: &SkinEntry) -> Result<Dress> {
        let recipe = Recipe {
            input: vec![entry.file.clone()],
            above: entry.above.clone(),
            labels: entry.labels.clone().map(Labels::These),
            ..Recipe::default()
        };
        let surface = recipe.surface(entry.smooth.unwrap_or(0), &|_, _| {})?;
        if entry.height.is_some() && entry.height_map.is_none() {
            return Err(Error::Input(
                "a skin has a `height` without a `height_map`".into(),
            ));
        }
        let height_map = match &entry.height_map {
            Some(file) => Some((Map::read(file)?, entry.height.unwrap_or(0.02))),
            None => None,
        };
        Ok(Dress {
            normal_map: entry.normal_map.as_ref().map(Map::read).transpose()?,
            height_map,
            shown: vec![true; surface.triangles.len()],
            entry: entry.clone(),
            surface,
        })
    }

    /// The skin, bound to `carrier`.
    pub fn bind(&self, gpu: &Gpu, carrier: &Carrier) -> Result<Skin> {
        let mapping = self.entry.mapping.unwrap_or_default();
        let mut skin = Skin::new(gpu, &self.surface, carrier, mapping)?;
        match (&self.entry.field, self.entry.colour) {
            (Some(name), _) => {
                let preset = self.entry.transfer.as_deref().unwrap_or("viridis");
                skin.set_colour(&SkinColour::Field {
                    name: name.clone(),
                    transfer: TransferFunction::preset(preset)?,
                })?;
            }
            (None, Some(colour)) => skin.set_colour(&SkinColour::Plain(colour))?,
            (None, None) => {}
        }
        skin.set_opacity(self.entry.opacity.unwrap_or(1.0))?;
        skin.set_normal_map(self.normal_map.as_ref())?;
        skin.set_height_map(self.height_map.as_ref().map(|(map, depth)| (map, *depth)))?;
        if self.shown.contains(&false) {
            skin.show_triangles(&self.shown)?;
        }
        Ok(skin)
    }

    /// What a user should know of the skin, a sentence each.
    pub fn notes(&self, skin: &Skin) -> Vec<String> {
        let name = self.entry.file.file_name().unwrap_or_default();
        let name = name.to_string_lossy();
        let notes = skin.report().notes().into_iter();
        notes.map(|note| format!("skin {name}: {note}")).collect()
    }

    /// Opens the skin where `blade` parts the edges of its triangles as they are now.
    pub fn open(&mut self, skin: &Skin, blade: &Blade) -> Result<usize> {
        let vertices = skin.vertices()?;
        let mut opened = 0;
        for (triangle, shown) in self.surface.triangles.iter().zip(&mut self.shown) {
            let [a, b, c] = triangle.map(|v| vertices[v as usize]);
            let parted = |p: DVec3, q: DVec3| blade.parts(p, q);
            if *shown && (parted(a, b) || parted(b, c) || parted(c, a)) {
                *shown = false;
                opened += 1;
            }
        }
        Ok(opened)
    }
}

/// What carries the skins of a body: its boundary, with the normals that its mover makes, or
/// those of the faces around a node.
pub(super) fn carrier(gpu: &Gpu, mesh: &TetMesh, actor: &mut Actor) -> Result<Carrier> {
    let body = match actor {
        Actor::Moving(motion) => match &mut motion.body {
            Mover::Grid(body) => Some(body),
            Mover::Tets(..) => None,
        },
        Actor::Posed(_) => None,
    };
    let Some(body) = body else {
        let nodes = actor.nodes();
        return Carrier::of_mesh(gpu, mesh, nodes.array(), nodes.frame());
    };
    let rest_normals = body.rest_normals()?;
    let topology = Topology::new(mesh);
    let faces = topology.boundary.iter();
    let triangles: Vec<[u32; 3]> = faces.map(|f| topology.boundary_nodes(mesh, *f)).collect();
    let nodes = body.nodes();
    Carrier::new(
        nodes.array(),
        nodes.frame(),
        body.normals(),
        &mesh.nodes,
        &rest_normals,
        &triangles,
    )
}
