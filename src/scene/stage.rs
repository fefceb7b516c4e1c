//! A scene made real: the mesh on the GPU, the body that moves, the raycaster that draws it.

use super::annotated::Surroundings;
use super::bodies;
use super::checkpoint::Journal;
use super::cutter::Cutter;
use super::drawing::CachedFrame;
use super::drawn_tool::DrawnTool;
use super::picture::{DisplayMode, SIZE};
use super::scan::Scans;
use super::shown::{self, Shown};
use super::skin::carrier;
use super::xray::RadiographFilm;
use super::{Motion, ScalarField, Scene, ToolEntry};
use crate::gpu::Gpu;
use crate::io::PvdSeries;
use crate::mesh::{Blade, Field, Location, ScalarType, TetMesh, Topology};
use crate::physics::grid::GridShape;
use crate::physics::{Nodes, SolverKind, ToolPose};
use crate::render::{Background, BitDepth, Camera, Inside, Raycaster, Surface};
use crate::skin::{Composer, Skin};
use crate::{Error, Result};
use glam::DVec3;

/// Steps before a picture where a scene names a solver but no number of steps.
pub const STEPS: u32 = 50;

/// A scene ready to be moved and drawn.
pub struct Stage {
    pub(super) gpu: Gpu,
    pub(super) drive: Drive,
    pub(super) raycaster: Raycaster,
    pub(super) surface: Surface,
    pub(super) camera: Camera,
    pub(super) size: [u32; 2],
    pub(super) mode: DisplayMode,
    pub(super) scalars: ScalarField,
    /// Where that is computed for each picture.
    pub(super) shown: Option<Shown>,
    pub(super) scene: Scene,
    pub(super) skins: Vec<Skin>,
    /// The tools that are drawn.
    pub(super) tools: Vec<DrawnTool>,
    pub(super) composer: Composer,
    /// What is drawn onto its pictures.
    pub(super) surroundings: Surroundings,
    /// What X-rays are developed on.
    pub(super) film: RadiographFilm,
    /// How many times larger each way than they are shown pictures are drawn.
    pub(super) samples: u32,
    pub(super) cutters: Vec<Cutter>,
    /// What checkpoints need, where they are kept.
    pub(super) journal: Option<Journal>,
    pub(super) background: Background,
    pub(super) bits: BitDepth,
    pub(super) steps: u32,
    /// The last picture, as long as nothing has changed since.
    pub(super) cached: Option<CachedFrame>,
    /// Pictures drawn, and those for which the last one stood.
    pub(super) pictures: [u64; 2],
    pub(super) depth: Option<wgpu::TextureView>,
    pub(super) notes: Vec<String>,
}

/// What moves the nodes.
pub(super) enum Drive {
    /// Nothing, or the caller, pose by pose.
    Posed(Box<Posed>),
    /// A simulator.
    Simulated(Box<Motion>),
}

/// A mesh that nothing moves but the caller.
pub(super) struct Posed {
    mesh: TetMesh,
    topology: Topology,
    nodes: Nodes,
}

impl Drive {
    /// `mesh`, which nothing moves but the caller.
    fn posed(gpu: &Gpu, mesh: TetMesh) -> Result<Drive> {
        Ok(Drive::Posed(Box::new(Posed {
            topology: Topology::new(&mesh),
            nodes: Nodes::new(gpu, &mesh)?,
            mesh,
        })))
    }

    pub fn nodes(&self) -> &Nodes {
        match self {
            Drive::Posed(posed) => &posed.nodes,
            Drive::Simulated(motion) => motion.simulator.nodes(),
        }
    }

    /// The mesh at rest.
    pub fn mesh(&self) -> &TetMesh {
        match self {
            Drive::Posed(posed) => &posed.mesh,
            Drive::Simulated(motion) => motion.simulator.mesh(),
        }
    }

    /// The neighbours in that mesh.
    pub fn topology(&self) -> &Topology {
        match self {
            Drive::Posed(posed) => &posed.topology,
            Drive::Simulated(motion) => motion.simulator.topology(),
        }
    }
}

impl Stage {
    /// Loads the mesh of `scene` and prepares everything on `gpu`.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for what makes no sense in the scene, what reading the mesh gives, or
    /// [`Error::Gpu`](crate::Error::Gpu) when it does not fit the device.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Stage> {
        if !scene.body.is_empty() {
            return Stage::with_bodies(gpu, scene);
        }
        let Some(grid) = &scene.grid else {
            return Stage::with_mesh(gpu, scene, scene.mesh.load()?);
        };
        let (shape, mesh, notes) = scene.carve(grid)?;
        let mut stage = Stage::assemble(gpu, scene, mesh, Some(shape))?;
        stage.notes.splice(0..0, notes);
        Ok(stage)
    }

    /// The stage of a scene of several bodies.
    fn with_bodies(gpu: &Gpu, scene: &Scene) -> Result<Stage> {
        let sources = scene.body_sources()?;
        if !bodies::any_moves(&sources) {
            let (mesh, said) = bodies::posed(sources)?;
            let drive = Drive::posed(gpu, mesh)?;
            return Stage::with_drive(gpu, scene, drive, said);
        }
        let (setup, said) = bodies::setup(gpu, scene, sources)?;
        let motion = Motion::of_setup(scene, setup)?;
        Stage::with_drive(gpu, scene, Drive::Simulated(Box::new(motion)), said)
    }

    /// As [`Stage::new`], with a mesh that is there already.
    ///
    /// # Errors
    /// As [`Stage::new`].
    pub fn with_mesh(gpu: &Gpu, scene: &Scene, mesh: TetMesh) -> Result<Stage> {
        Stage::assemble(gpu, scene, mesh, None)
    }

    fn assemble(
        gpu: &Gpu,
        scene: &Scene,
        mesh: TetMesh,
        shape: Option<GridShape>,
    ) -> Result<Stage> {
        let solver = scene.solver.name.as_deref().map(str::parse::<SolverKind>);
        if solver.is_some() && scene.mesh.rest.is_some() {
            return Err(Error::Input(
                "[mesh] rest (--rest) is where a deformed mesh rests that nothing moves; a solver moves the mesh from where its file has it".into(),
            ));
        }
        let carried = scene.tool.iter().any(ToolEntry::is_carried) && solver.is_some();
        let (held, mut mesh) = match carried {
            true => scene.with_carried_tools(mesh)?,
            false => (scene.clone(), mesh),
        };
        let scene = &held;
        let Some(kind) = solver.transpose()? else {
            let Some((now, note)) = scene.at_rest(&mut mesh)? else {
                return Stage::with_drive(gpu, scene, Drive::posed(gpu, mesh)?, Vec::new());
            };
            let drive = Drive::posed(gpu, mesh)?;
            let mut stage = Stage::with_drive(gpu, scene, drive, note.into_iter().collect())?;
            stage.pose(&now)?;
            stage.frame(&[])?;
            return Ok(stage);
        };
        let (motion, said) = Motion::new(gpu, scene, kind, mesh, shape)?;
        Stage::with_drive(gpu, scene, Drive::Simulated(Box::new(motion)), said)
    }

    /// The stage of a body, or several, that `drive` moves; `said` is what was assumed of it.
    fn with_drive(gpu: &Gpu, scene: &Scene, drive: Drive, said: Vec<String>) -> Result<Stage> {
        let (mesh, topology) = (drive.mesh(), drive.topology());
        let mut notes = mesh.repairs.warnings.clone();
        let asked = !(scene.grab.is_empty() && scene.cut.is_empty() && scene.tool.is_empty())
            || scene.floor.is_some();
        if matches!(drive, Drive::Posed(_)) && asked {
            let still =
                "nothing moves, so grabs, cuts, floors and tools are passed over: name a solver";
            notes.push(still.into());
        }
        shown::check_asked(scene, &drive)?;
        let (scans, shown, scalars) = match scene.scans(mesh)? {
            Some(Scans {
                scans,
                seen,
                notes: said,
            }) => {
                notes.extend(said);
                (scans, None, seen)
            }
            None => match Shown::new(scene, &drive)? {
                Some((shown, scalars)) => (Vec::new(), Some(shown), scalars),
                None => (Vec::new(), None, scene.scalar_field(mesh, topology)?),
            },
        };
        notes.extend(scalars.note.clone());
        notes.extend(said);
        let nodes = drive.nodes();
        let seen = (&scalars, scans.as_slice());
        let painters = scene.painters(gpu, mesh, topology, seen, nodes, &mut notes)?;
        let (raycaster, surface) = painters;
        let size = scene.picture.size.unwrap_or(SIZE);
        let reach = match &drive {
            Drive::Simulated(motion) => motion.reach.as_ref(),
            Drive::Posed(_) => None,
        };
        let points = reach.unwrap_or(&mesh.nodes);
        let (surroundings, said) = Surroundings::new(scene, (mesh, topology), &scalars)?;
        notes.extend(said);
        let mut stage = Stage {
            gpu: gpu.clone(),
            surroundings,
            film: RadiographFilm::new(&scene.xray)?,
            samples: scene.samples_each_way()?,
            camera: scene.camera(mesh, points, size)?,
            size,
            mode: scene.display_mode()?,
            background: scene.background()?,
            bits: scene.bits()?,
            steps: scene.solver.steps.unwrap_or(STEPS),
            cached: None,
            pictures: [0; 2],
            depth: None,
            composer: Composer::new(gpu, scene.compose_options()?)?,
            cutters: scene.cut.iter().map(Cutter::new).collect::<Result<_>>()?,
            journal: None,
            skins: Vec::new(),
            tools: Vec::new(),
            scene: scene.clone(),
            scalars,
            shown,
            drive,
            raycaster,
            surface,
            notes,
        };
        if let Drive::Simulated(motion) = &stage.drive {
            let body = (stage.drive.mesh(), stage.drive.nodes().frame());
            stage.tools = DrawnTool::all(gpu, scene, body, motion)?;
        }
        if !(scene.skin.is_empty() && scene.carried.is_empty()) {
            let carrier = carrier(gpu, &mut stage.drive)?;
            for entry in &scene.skin {
                let (mut skin, notes) = entry.put_on(gpu, &carrier)?;
                skin.set_inside(stage.raycaster.inside())?;
                stage.skins.push(skin);
                stage.notes.extend(notes);
            }
            for entry in scene.carried.iter().filter(|tool| !tool.hidden) {
                stage.skins.push(entry.carried_skin(gpu, &carrier)?);
            }
        }
        Ok(stage)
    }

    /// The skins, as the body carries them now; after a cut, in mode `skin`, its walls follow them.
    pub fn skins(&self) -> &[Skin] {
        &self.skins
    }

    /// What was assumed or repaired, in words.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The mesh at rest.
    pub fn mesh(&self) -> &TetMesh {
        self.drive.mesh()
    }

    /// The scalar that is seen.
    pub fn scalar_field(&self) -> &ScalarField {
        &self.scalars
    }

    /// The view.
    pub fn camera_mut(&mut self) -> &mut Camera {
        &mut self.camera
    }

    /// Frames the body as it stands now, and all of `also`, unless the scene says anything of the
    /// view.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn frame(&mut self, also: &[DVec3]) -> Result<()> {
        if self.scene.camera.is_unset() {
            let mut points = self.seen()?;
            points.extend_from_slice(also);
            self.camera = self.scene.camera(self.mesh(), &points, self.size)?;
        }
        Ok(())
    }

    /// As [`Stage::frame`], with room for the body while the camera goes round it: see
    /// [`Camera::turned`].
    ///
    /// # Errors
    /// What reading back gives.
    pub fn frame_all_round(&mut self, also: &[DVec3]) -> Result<()> {
        if !self.scene.camera.is_unset() {
            return Ok(());
        }
        let mut points = self.seen()?;
        points.extend_from_slice(also);
        if let Drive::Simulated(motion) = &self.drive {
            points.extend(motion.reach.iter().flatten());
        }
        let round = turned_round(&points, self.camera.up);
        let mut camera = self.scene.camera(self.mesh(), &round, self.size)?;
        // Also beside a legend it goes round the body's middle.
        let (low, high) = crate::mesh::bounds(&round);
        let aside = 0.5 * (low + high) - camera.look_at;
        camera.eye += aside;
        camera.look_at += aside;
        self.camera = camera;
        Ok(())
    }

    /// Where the nodes that can be seen are.
    fn seen(&self) -> Result<Vec<DVec3>> {
        let positions = self.positions()?;
        // Grids have nodes of no tet, which are never seen and may be anywhere.
        let mut seen = vec![false; positions.len()];
        for v in self.mesh().tets.iter().flatten() {
            seen[*v as usize] = true;
        }
        let seen = positions.iter().zip(&seen).filter(|(_, seen)| **seen);
        Ok(seen.map(|(x, _)| *x).collect())
    }

    /// Width and height of its pictures, in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Draws pictures of this size from now on.
    pub fn set_size(&mut self, size: [u32; 2]) {
        self.size = size;
        self.cached = None;
    }

    /// The body and its solver, if the scene has one.
    pub fn motion(&self) -> Option<&Motion> {
        match &self.drive {
            Drive::Posed(_) => None,
            Drive::Simulated(motion) => Some(motion),
        }
    }

    /// As [`Stage::motion`], to push and pull the body.
    pub fn motion_mut(&mut self) -> Option<&mut Motion> {
        match &mut self.drive {
            Drive::Posed(_) => None,
            Drive::Simulated(motion) => Some(motion),
        }
    }

    /// What pictures are cut by, and what they show inside.
    pub fn inside(&self) -> &Inside {
        self.raycaster.inside()
    }

    /// Cuts pictures, and shows what is inside, in this way from now on: volume, boundary and skins;
    /// tools by planes in space.
    ///
    /// # Errors
    /// As [`Raycaster::set_inside`].
    pub fn set_inside(&mut self, inside: &Inside) -> Result<()> {
        if inside.needs_rest() && !self.raycaster.inside().needs_rest() {
            let mesh = self.drive.mesh();
            self.raycaster.geometry_mut().remember_rest(mesh)?;
        }
        self.raycaster.set_inside(inside)?;
        if self.mode == DisplayMode::Surface {
            self.surface.set_inside(inside, self.raycaster.geometry())?;
        }
        for skin in &mut self.skins {
            skin.set_inside(inside)?;
        }
        // Tools have no shape at rest.
        let mut in_space = inside.clone();
        in_space.planes.retain(|plane| !plane.at_rest);
        for tool in &mut self.tools {
            tool.skin.set_inside(&in_space)?;
        }
        self.cached = None;
        Ok(())
    }

    /// Has the tool of this number, counted from 0 as the scene has them, go straight to a place
    /// with the next step, in file units: one to which the scene gives no way of its own.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for a tool that is not there, or that has a way of its own.
    pub fn guide_tool(&mut self, number: usize, place: DVec3) -> Result<()> {
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        let tool = motion.actors.tools.get(number).filter(|t| !t.moves());
        let id = tool.ok_or_else(|| no_tool(number))?.id;
        let turn = motion.simulator.loads().tool(id)?.turn();
        let pose = ToolPose::new(place, turn);
        motion.simulator.loads_mut().guide_tool(id, pose)
    }

    /// The force of the body on the tool of this number, N.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for a tool that is not there; otherwise as [`Simulator::tool_forces`].
    ///
    /// [`Simulator::tool_forces`]: crate::physics::Simulator::tool_forces
    pub fn tool_force(&mut self, number: usize) -> Result<DVec3> {
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        let forces = motion.simulator.tool_forces()?;
        let force = forces.get(number).map(|on| on.force);
        force
            .ok_or_else(|| Error::Input(format!("the scene has no tool {number} (counted from 0)")))
    }

    /// Steps before a picture, as the scene has it; 0 where nothing moves.
    pub fn steps(&self) -> u32 {
        self.motion().map_or(0, |_| self.steps)
    }

    /// Simulated time, in seconds.
    pub fn time(&self) -> f64 {
        self.motion().map_or(0.0, Motion::time)
    }

    /// Runs `steps` steps of the solver, telling `progress` how many are done.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) when the simulation failed; the last good state stays and can be drawn.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        while done < steps {
            let Drive::Simulated(motion) = &mut self.drive else {
                return Ok(());
            };
            let time = motion.time();
            let pace = self.cutters.iter().filter_map(|k| k.pace(time));
            let some = match pace.min_by(f64::total_cmp) {
                None => steps - done,
                Some(pace) => ((pace / motion.dt).ceil() as u32).clamp(1, steps - done),
            };
            motion.run(some, &mut |n| progress(done + n))?;
            done += some;
            let time = motion.time();
            let blades: Vec<Blade> = self
                .cutters
                .iter_mut()
                .filter_map(|k| k.swept(time))
                .collect();
            for blade in &blades {
                self.cut(blade)?;
            }
        }
        Ok(())
    }

    /// Puts the nodes where the caller wants them, in file units.
    ///
    /// # Errors
    /// As [`Nodes::set_positions`].
    pub fn pose(&mut self, positions: &[DVec3]) -> Result<()> {
        match &mut self.drive {
            Drive::Posed(posed) => posed.nodes.set_positions(positions),
            Drive::Simulated(motion) => motion.simulator.set_positions(positions),
        }
    }

    /// The mesh where it is now, with its fields, `displacement` and `velocity` (both in file
    /// units) at the nodes, and those that `[output] fields` asks for.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn deformed_mesh(&self) -> Result<TetMesh> {
        let positions = self.positions()?;
        let mut mesh = self.mesh().clone();
        for field in self.motion_fields(&positions)? {
            mesh.set_field(field)?;
        }
        mesh.nodes = positions;
        Ok(mesh)
    }

    /// Adds the present state to a series, with its fields, `displacement` and `velocity`, and those
    /// that `[output] fields` asks for.
    ///
    /// # Errors
    /// What reading back or writing gives.
    pub fn push(&self, series: &mut PvdSeries) -> Result<()> {
        let positions = self.positions()?;
        let fields = self.motion_fields(&positions)?;
        series.push_deformed(self.time(), self.mesh(), &positions, &fields)
    }

    /// Where the nodes of the mesh are, in file units, read back.
    fn positions(&self) -> Result<Vec<DVec3>> {
        match &self.drive {
            Drive::Posed(posed) => posed.nodes.positions(),
            Drive::Simulated(motion) => motion.positions(),
        }
    }

    fn motion_fields(&self, positions: &[DVec3]) -> Result<Vec<Field>> {
        let displacements = positions
            .iter()
            .zip(&self.mesh().nodes)
            .map(|(x, rest)| *x - *rest);
        let mut fields = vec![vector_field("displacement", displacements)];
        if let Some(motion) = self.motion() {
            let velocities = motion.simulator.velocities()?;
            fields.push(vector_field("velocity", velocities.into_iter()));
            fields.extend(shown::asked(&self.scene, motion)?);
        }
        Ok(fields)
    }
}

fn no_tool(number: usize) -> Error {
    Error::Input(format!(
        "the scene has no tool {number} (counted from 0) that can be led by hand: one without `path`, `file` and `turn`"
    ))
}

/// Points that bound `points` turned about `up` through the middle of their bounds, by any angle:
/// rings, each as wide as the points are at its height.
fn turned_round(points: &[DVec3], up: DVec3) -> Vec<DVec3> {
    const RINGS: usize = 48;
    const CORNERS: usize = 24;
    let up = up.normalize_or(DVec3::Z);
    let side = up.any_orthonormal_vector();
    let (low, high) = crate::mesh::bounds(points);
    let middle = 0.5 * (low + high);
    let height = |p: &DVec3| (*p - middle).dot(up);
    let heights = points.iter().map(height);
    let (bottom, top) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
        (a.min(h), b.max(h))
    });
    let slice = (top - bottom).max(f64::MIN_POSITIVE) / RINGS as f64;
    let mut wide = [None::<f64>; RINGS];
    for p in points {
        let h = height(p);
        let radius = (*p - middle - h * up).length();
        let ring = &mut wide[(((h - bottom) / slice) as usize).min(RINGS - 1)];
        *ring = Some(ring.map_or(radius, |r| r.max(radius)));
    }
    // A polygon around a circle is a little wider than that.
    let around = 1.0 / (std::f64::consts::PI / CORNERS as f64).cos();
    let mut round = Vec::new();
    for (i, radius) in wide.iter().enumerate() {
        let Some(radius) = radius else { continue };
        for (end, corner) in (0..2).flat_map(|e| (0..CORNERS).map(move |c| (e, c))) {
            let angle = std::f64::consts::TAU * corner as f64 / CORNERS as f64;
            let out = glam::DQuat::from_axis_angle(up, angle) * side;
            let h = bottom + slice * (i + end) as f64;
            round.push(middle + h * up + around * radius * out);
        }
    }
    round
}

fn vector_field(name: &str, vectors: impl Iterator<Item = DVec3>) -> Field {
    Field {
        name: name.into(),
        location: Location::Node,
        components: 3,
        values: vectors.flat_map(|v| v.to_array()).collect(),
        scalar_type: ScalarType::F32,
    }
}
