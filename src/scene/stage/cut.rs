//! Cuts of a stage's body.

use super::{NodeSource, Stage};
use crate::mesh::Blade;
use crate::scene::picture::DisplayMode;
use crate::scene::skin::carrier;
use crate::skin::{Skin, SkinColouring};
use crate::{Error, Result};

/// Default colour of the walls of cuts, under a skin.
const WALL: [f32; 3] = [0.55, 0.12, 0.12];

impl Stage {
    /// Cuts the body in its current configuration along `blade` (file units): its springs or
    /// tetrahedra, and its skins. Returns whether anything was cut.
    ///
    /// # Errors
    /// [`Error::Input`] for a static body; otherwise as
    /// [`Simulator::cut`](crate::physics::Simulator::cut).
    pub fn cut(&mut self, blade: &Blade) -> Result<bool> {
        if self.motion().is_none() {
            return Err(Error::Input(
                "a static body cannot be cut; set [solver] name".into(),
            ));
        }
        self.cached = None;
        self.draw_own_mesh()?;
        let pose = match self.journal {
            Some(_) => self.current_exact_positions()?,
            None => None,
        };
        let NodeSource::Simulated(motion) = &mut self.drive else {
            return Ok(false);
        };
        // A failed step reported here must not be reported again.
        let change = motion.simulator.cut(blade);
        let change = change.inspect_err(|_| motion.requested = None)?;
        let simulator = &mut motion.simulator;
        for pin in &mut motion.pins {
            pin.apply_cut(&change.mesh);
        }
        for scheduled_motion in &mut motion.time_dependent_loads.scheduled_motions {
            scheduled_motion.apply_cut(&change.mesh.duplicated_nodes);
        }
        if !change.mesh.is_empty() {
            self.looks.scalars.apply_cut(&change.mesh);
            let (mesh, topology) = (simulator.mesh(), simulator.topology());
            let (positions, scalars) = (simulator.nodes().array(), self.looks.scalars.scalars());
            let geometry = self.looks.raycaster.geometry_mut();
            geometry.apply_cut(mesh, topology, &change.mesh, positions, scalars)?;
            if !change.mesh.removed.is_empty() {
                let transfer = self.scene.transfer(&self.looks.scalars)?;
                let looks = self.scene.region_looks(mesh, topology, &transfer)?;
                self.looks.raycaster.set_regions(looks.as_ref())?;
            }
            self.looks.raycaster.follow_scans(mesh)?;
            self.looks
                .surface
                .follow(self.looks.raycaster.geometry(), &self.looks.scalars.values)?;
        }
        let hit = !change.is_empty();
        if hit && let (Some(journal), Some(pose)) = (&mut self.journal, pose) {
            journal.note(blade, pose);
        }
        if hit && !self.looks.skins.is_empty() {
            let carrier = carrier(&self.gpu, &mut self.drive)?;
            let skins = self.scene.skin.iter().filter(|skin| !skin.hidden);
            let tools = self.scene.carried.iter().filter(|tool| !tool.hidden);
            self.looks.skins.truncate(skins.count() + tools.count());
            let mut walls = Vec::new();
            for skin in &mut self.looks.skins {
                walls = skin.apply_cut(&carrier, blade)?.walls;
            }
            if self.looks.mode == DisplayMode::Skin && !walls.is_empty() {
                let mut walls = Skin::body_surface(&self.gpu, &carrier, Some(&walls))?;
                let colour = self.scene.skin.iter().find_map(|skin| skin.cut_colour);
                let colour = colour.unwrap_or(WALL);
                walls.set_colour(&SkinColouring::Plain(colour))?;
                walls.set_sections(self.looks.raycaster.inside())?;
                self.looks.skins.push(walls);
            }
        }
        Ok(hit)
    }
}
