//! Time-dependent cuts of a scene.

use super::CutEntry;
use super::picture::DisplayMode;
use super::skin::carrier;
use super::stage::{NodeSource, Stage};
use super::trajectory::{check, position_at};
use crate::mesh::Blade;
use crate::skin::{Skin, SkinColouring};
use crate::{Error, Result};
use glam::DVec3;

/// Default colour of the walls of cuts, under a skin.
const WALL: [f32; 3] = [0.55, 0.12, 0.12];

/// Number of incremental cuts along a blade's path.
const STEPS_PER_PATH: f64 = 16.0;

/// A moving blade of a scene.
#[derive(Debug)]
pub(super) struct ActiveBlade {
    entry: CutEntry,
    /// Time up to which it has cut, s.
    pub(super) cut: Option<f64>,
}

impl ActiveBlade {
    pub fn new(entry: &CutEntry) -> Result<ActiveBlade> {
        check(&entry.path, 2, "cut")?;
        let cutter = ActiveBlade {
            entry: entry.clone(),
            cut: None,
        };
        // Reject a blade that sweeps no area here rather than during the simulation.
        let [begin, end] = cutter.span();
        Blade::from_sweep(&[cutter.edge(begin), cutter.edge(end)])?;
        Ok(cutter)
    }

    fn span(&self) -> [f64; 2] {
        let times = |p: Option<&[f64; 4]>| p.map_or(0.0, |p| p[0]);
        [
            times(self.entry.path.first()),
            times(self.entry.path.last()),
        ]
    }

    /// Returns the time between two incremental cuts, or up to the first one if it is later; `None`
    /// after its path.
    pub fn cut_interval(&self, time: f64) -> Option<f64> {
        let [begin, end] = self.span();
        (self.cut.is_none_or(|cut| cut < end) && time <= end).then(|| {
            let pace = (end - begin) / STEPS_PER_PATH;
            if time < begin {
                pace.max(begin - time)
            } else {
                pace
            }
        })
    }

    /// Returns the surface swept since the previous call; `None` if it is empty.
    pub fn next_sweep(&mut self, time: f64) -> Option<Blade> {
        let [begin, end] = self.span();
        let from = self.cut.unwrap_or(begin);
        let to = time.min(end);
        if to <= from {
            return None;
        }
        self.cut = Some(to);
        let path = self.entry.path.iter().map(|p| p[0]);
        let between = path.filter(|t| *t > from && *t < to);
        let times: Vec<f64> = [from].into_iter().chain(between).chain([to]).collect();
        let edges: Vec<[DVec3; 2]> = times.iter().map(|t| self.edge(*t)).collect();
        // A blade at rest sweeps nothing.
        Blade::from_sweep(&edges).ok()
    }

    fn edge(&self, time: f64) -> [DVec3; 2] {
        let moved = position_at(&self.entry.path, time);
        self.entry.edge.map(|end| DVec3::from(end) + moved)
    }
}

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
        let pose = match self.journal {
            Some(_) => self.pose_now()?,
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
        for mover in &mut motion.time_dependent_loads.movers {
            mover.apply_cut(&change.mesh.duplicated_nodes);
        }
        if !change.mesh.is_empty() {
            self.scalars.apply_cut(&change.mesh);
            let (mesh, topology) = (simulator.mesh(), simulator.topology());
            let (positions, scalars) = (simulator.nodes().array(), self.scalars.scalars());
            let geometry = self.raycaster.geometry_mut();
            geometry.apply_cut(mesh, topology, &change.mesh, positions, scalars)?;
            if !change.mesh.removed.is_empty() {
                let transfer = self.scene.transfer(&self.scalars)?;
                let looks = self.scene.region_looks(mesh, topology, &transfer)?;
                self.raycaster.set_regions(looks.as_ref())?;
            }
            self.raycaster.follow_scans(mesh)?;
            self.surface
                .follow(self.raycaster.geometry(), &self.scalars.values)?;
        }
        let hit = !change.is_empty();
        if hit && let (Some(journal), Some(pose)) = (&mut self.journal, pose) {
            journal.note(blade, pose);
        }
        if hit && !self.skins.is_empty() {
            let carrier = carrier(&self.gpu, &mut self.drive)?;
            let skins = self.scene.skin.iter().filter(|skin| !skin.hidden);
            let tools = self.scene.carried.iter().filter(|tool| !tool.hidden);
            self.skins.truncate(skins.count() + tools.count());
            let mut walls = Vec::new();
            for skin in &mut self.skins {
                walls = skin.apply_cut(&carrier, blade)?.walls;
            }
            if self.mode == DisplayMode::Skin && !walls.is_empty() {
                let mut walls = Skin::body_surface(&self.gpu, &carrier, Some(&walls))?;
                let colour = self.scene.skin.iter().find_map(|skin| skin.cut_colour);
                let colour = colour.unwrap_or(WALL);
                walls.set_colour(&SkinColouring::Plain(colour))?;
                walls.set_sections(self.raycaster.inside())?;
                self.skins.push(walls);
            }
        }
        Ok(hit)
    }
}
