//! A stage: the GPU resources, simulation and renderers of a scene.

use super::active_blade::ActiveBlade;
use super::annotations::AnnotationContext;
use super::appearance::SceneAppearance;
use super::bodies;
use super::checkpoint::CutHistory;
use super::computed_field::{self, ComputedField};
use super::drawing::CachedFrame;
use super::picture::DisplayMode;
use super::tool_skin::ToolSkin;
use super::xray::RadiographFilm;
use super::{Motion, ScalarField, Scene, ToolEntry};
use crate::gpu::Gpu;
use crate::io::PvdSeries;
use crate::mesh::{Blade, Field, Location, ScalarType, TetMesh, Topology};
use crate::physics::grid::GridShape;
use crate::physics::{NodePositions, SolverKind, ToolId, ToolPose};
use crate::render::{
    Background, BitDepth, Camera, Mode, Raycaster, ResolvedTransfer, Sections, Surface,
    TransferFunction,
};
use crate::skin::{Compositor, Skin};
use crate::{Error, Result};
use glam::DVec3;

/// Default number of steps before a picture, if the scene has a solver.
pub const STEPS: u32 = 50;

/// A scene ready to be simulated and rendered.
pub struct Stage {
    pub(super) gpu: Gpu,
    pub(super) drive: NodeSource,
    pub(super) raycaster: Raycaster,
    pub(super) surface: Surface,
    pub(super) camera: Camera,
    pub(super) size: [u32; 2],
    pub(super) mode: DisplayMode,
    pub(super) scalars: ScalarField,
    /// The displayed field, if it is recomputed for each picture.
    pub(super) computed_field: Option<ComputedField>,
    pub(super) scene: Scene,
    pub(super) skins: Vec<Skin>,
    /// The displayed tools.
    pub(super) tools: Vec<ToolSkin>,
    pub(super) composer: Compositor,
    /// Data of the annotations.
    pub(super) surroundings: AnnotationContext,
    /// Film of X-ray pictures.
    pub(super) film: RadiographFilm,
    /// Supersampling factor per axis.
    pub(super) samples: u32,
    pub(super) cutters: Vec<ActiveBlade>,
    /// History for checkpoints, if they are kept.
    pub(super) journal: Option<CutHistory>,
    pub(super) background: Background,
    /// Background colour of recorded pictures.
    pub(super) backdrop: [f32; 4],
    pub(super) bits: BitDepth,
    pub(super) steps: u32,
    /// The last picture, while it is up to date.
    pub(super) cached: Option<CachedFrame>,
    /// Number of pictures rendered, and number taken from the cache.
    pub(super) pictures: [u64; 2],
    pub(super) depth: Option<wgpu::TextureView>,
    pub(super) notes: Vec<String>,
}

/// Source of the node positions.
pub(super) enum NodeSource {
    /// Static, or set by the caller pose by pose.
    Posed(Box<StaticMesh>),
    /// A simulator.
    Simulated(Box<Motion>),
}

/// A mesh that is moved by the caller only.
pub(super) struct StaticMesh {
    mesh: TetMesh,
    topology: Topology,
    nodes: NodePositions,
}

impl StaticMesh {
    /// Sets the node positions and fields.
    pub(super) fn show(&mut self, nodes: &[DVec3], fields: &[Field]) -> Result<()> {
        let before = std::mem::take(&mut self.mesh.fields);
        let taken = fields
            .iter()
            .try_for_each(|f| self.mesh.set_field(f.clone()));
        let put = taken.and_then(|()| self.nodes.set_positions(nodes));
        if put.is_err() {
            self.mesh.fields = before;
        }
        put
    }
}

impl NodeSource {
    /// Creates a source for `mesh`, which only the caller moves.
    fn posed(gpu: &Gpu, mesh: TetMesh) -> Result<NodeSource> {
        Ok(NodeSource::Posed(Box::new(StaticMesh {
            topology: Topology::new(&mesh),
            nodes: NodePositions::new(gpu, &mesh)?,
            mesh,
        })))
    }

    pub fn nodes(&self) -> &NodePositions {
        match self {
            NodeSource::Posed(posed) => &posed.nodes,
            NodeSource::Simulated(motion) => motion.simulator.nodes(),
        }
    }

    /// Returns the mesh at rest.
    pub fn mesh(&self) -> &TetMesh {
        match self {
            NodeSource::Posed(posed) => &posed.mesh,
            NodeSource::Simulated(motion) => motion.simulator.mesh(),
        }
    }

    /// Returns the topology of the mesh.
    pub fn topology(&self) -> &Topology {
        match self {
            NodeSource::Posed(posed) => &posed.topology,
            NodeSource::Simulated(motion) => motion.simulator.topology(),
        }
    }
}

impl Stage {
    /// Loads the mesh of `scene` and prepares everything on `gpu`.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an invalid scene, an error of reading the mesh, or
    /// [`Error::Gpu`](crate::Error::Gpu) if it exceeds the limits of the device.
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

    /// Creates the stage of a scene of several bodies.
    fn with_bodies(gpu: &Gpu, scene: &Scene) -> Result<Stage> {
        let sources = scene.body_sources()?;
        if !bodies::any_dynamic(&sources) {
            let (mesh, setup_notes) = bodies::merge_static(sources)?;
            let drive = NodeSource::posed(gpu, mesh)?;
            return Stage::with_drive(gpu, scene, drive, setup_notes);
        }
        let (setup, setup_notes) = bodies::setup(gpu, scene, sources)?;
        let motion = Motion::of_setup(scene, setup)?;
        Stage::with_drive(
            gpu,
            scene,
            NodeSource::Simulated(Box::new(motion)),
            setup_notes,
        )
    }

    /// As [`Stage::new`], with a mesh that is loaded already.
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
                "[mesh] rest (--rest) requires a static body: a solver starts from the positions in the mesh file; remove one of them".into(),
            ));
        }
        let carried = scene.tool.iter().any(ToolEntry::is_dynamic) && solver.is_some();
        let (held, mut mesh) = match carried {
            true => scene.with_dynamic_tools(mesh)?,
            false => (scene.clone(), mesh),
        };
        let scene = &held;
        let Some(kind) = solver.transpose()? else {
            let Some((now, note)) = scene.move_to_rest(&mut mesh)? else {
                return Stage::with_drive(gpu, scene, NodeSource::posed(gpu, mesh)?, Vec::new());
            };
            let drive = NodeSource::posed(gpu, mesh)?;
            let mut stage = Stage::with_drive(gpu, scene, drive, note.into_iter().collect())?;
            stage.set_positions(&now)?;
            stage.fit_view(&[])?;
            return Ok(stage);
        };
        let (motion, setup_notes) = Motion::new(gpu, scene, kind, mesh, shape)?;
        Stage::with_drive(
            gpu,
            scene,
            NodeSource::Simulated(Box::new(motion)),
            setup_notes,
        )
    }

    /// Creates the stage of one or several bodies moved by `drive`; `setup_notes` are the notes so far.
    fn with_drive(
        gpu: &Gpu,
        scene: &Scene,
        mut drive: NodeSource,
        setup_notes: Vec<String>,
    ) -> Result<Stage> {
        let cutters = scene
            .cut
            .iter()
            .map(ActiveBlade::new)
            .collect::<Result<_>>()?;
        let mut notes = scene.notes.clone();
        notes.extend(drive.mesh().repairs.warnings.iter().cloned());
        let asked = !(scene.grab.is_empty() && scene.cut.is_empty() && scene.tool.is_empty())
            || scene.floor.is_some();
        if matches!(drive, NodeSource::Posed(_)) && asked {
            let still = "the body is static, so grabs, cuts, floors and tools are ignored; set [solver] name";
            notes.push(still.into());
        }
        let looks = SceneAppearance::new(gpu, scene, &mut drive)?;
        notes.extend(setup_notes);
        notes.extend(looks.notes);
        Ok(Stage {
            gpu: gpu.clone(),
            surroundings: looks.surroundings,
            film: looks.film,
            samples: looks.samples,
            camera: looks.camera,
            size: looks.size,
            mode: looks.mode,
            background: looks.background,
            backdrop: [0.0, 0.0, 0.0, 1.0],
            bits: looks.bits,
            steps: scene.solver.steps.unwrap_or(STEPS),
            cached: None,
            pictures: [0; 2],
            depth: None,
            composer: looks.composer,
            cutters,
            journal: None,
            skins: looks.skins,
            tools: looks.tools,
            scene: scene.clone(),
            scalars: looks.scalars,
            computed_field: looks.shown,
            drive,
            raycaster: looks.raycaster,
            surface: looks.surface,
            notes,
        })
    }

    /// Applies the appearance in `scene` to the body in its current configuration: picture, light,
    /// X-rays, planes, isosurfaces, scans, skins and output. The motion, the camera and the picture
    /// size are kept. Returns notes of the automatic choices.
    ///
    /// # Errors
    /// As [`Stage::new`]; the stage is then unchanged.
    pub fn set_appearance(&mut self, scene: &Scene) -> Result<Vec<String>> {
        let scene = Scene {
            picture: scene.picture.clone(),
            light: scene.light.clone(),
            xray: scene.xray.clone(),
            plane: scene.plane.clone(),
            isosurface: scene.isosurface.clone(),
            scan: scene.scan.clone(),
            skin: scene.skin.clone(),
            output: scene.output.clone(),
            camera: scene.camera.clone(),
            ..self.scene.clone()
        };
        let looks = SceneAppearance::new(&self.gpu, &scene, &mut self.drive)?;
        self.surroundings = looks.surroundings;
        self.film = looks.film;
        self.samples = looks.samples;
        self.mode = looks.mode;
        self.background = looks.background;
        self.bits = looks.bits;
        self.composer = looks.composer;
        self.skins = looks.skins;
        self.tools = looks.tools;
        self.scalars = looks.scalars;
        self.computed_field = looks.shown;
        self.raycaster = looks.raycaster;
        self.surface = looks.surface;
        self.scene = scene;
        self.cached = None;
        Ok(looks.notes)
    }

    /// As [`Stage::set_appearance`], but for planes and isosurfaces only, if the picture shows the
    /// volume: fast enough to drag them.
    ///
    /// # Errors
    /// As [`Stage::set_appearance`].
    pub fn set_planes(&mut self, scene: &Scene) -> Result<Vec<String>> {
        // In other modes the lighting depends on the sections.
        if self.mode != DisplayMode::Inside(Mode::Composite) {
            return self.set_appearance(scene);
        }
        let scene = Scene {
            plane: scene.plane.clone(),
            isosurface: scene.isosurface.clone(),
            ..self.scene.clone()
        };
        let mut notes = Vec::new();
        let inside = scene.inside(self.mode, &mut notes)?;
        // Tools are not clipped by the planes of a scene.
        self.set_body_inside(&inside)?;
        self.scene = scene;
        Ok(notes)
    }

    /// Returns the skins in their current configuration; after a cut, in mode `skin`, the cut walls
    /// follow them.
    pub fn skins(&self) -> &[Skin] {
        &self.skins
    }

    /// Returns the notes of automatic choices and repairs.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the mesh at rest.
    pub fn mesh(&self) -> &TetMesh {
        self.drive.mesh()
    }

    /// Returns the displayed scalar field.
    pub fn scalar_field(&self) -> &ScalarField {
        &self.scalars
    }

    /// Returns the camera.
    pub fn camera_mut(&mut self) -> &mut Camera {
        &mut self.camera
    }

    /// Frames the body in its current configuration and the points `also`, unless the scene sets
    /// the camera.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn fit_view(&mut self, also: &[DVec3]) -> Result<()> {
        if self.scene.camera.is_unset() {
            let mut points = self.seen()?;
            points.extend_from_slice(also);
            self.camera = self.scene.camera(self.mesh(), &points, self.size)?;
        }
        Ok(())
    }

    /// As [`Stage::fit_view`], with margin for an orbiting camera: see [`Camera::orbited`].
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn fit_orbit(&mut self, also: &[DVec3]) -> Result<()> {
        if !self.scene.camera.is_unset() {
            return Ok(());
        }
        let mut points = self.seen()?;
        points.extend_from_slice(also);
        if let NodeSource::Simulated(motion) = &self.drive {
            points.extend(motion.motion_envelope.iter().flatten());
        }
        let round = turned_round(&points, self.camera.up);
        let mut camera = self.scene.camera(self.mesh(), &round, self.size)?;
        // With a legend, too, the camera orbits the centre of the body.
        let (low, high) = crate::mesh::bounds(&round);
        let aside = 0.5 * (low + high) - camera.look_at;
        camera.eye += aside;
        camera.look_at += aside;
        self.camera = camera;
        Ok(())
    }

    /// Returns the positions of the nodes that can be visible.
    fn seen(&self) -> Result<Vec<DVec3>> {
        let positions = self.positions()?;
        // Grids have nodes without tetrahedra, which are never visible and may be anywhere.
        let mut seen = vec![false; positions.len()];
        for v in self.mesh().tets.iter().flatten() {
            seen[*v as usize] = true;
        }
        let seen = positions.iter().zip(&seen).filter(|(_, seen)| **seen);
        Ok(seen.map(|(x, _)| *x).collect())
    }

    /// Returns the width and height of the pictures, in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Sets the size of the pictures.
    pub fn set_size(&mut self, size: [u32; 2]) {
        self.size = size;
        self.cached = None;
    }

    /// Returns the simulated body, if the scene has a solver.
    pub fn motion(&self) -> Option<&Motion> {
        match &self.drive {
            NodeSource::Posed(_) => None,
            NodeSource::Simulated(motion) => Some(motion),
        }
    }

    /// As [`Stage::motion`], mutable, to apply loads to the body.
    pub fn motion_mut(&mut self) -> Option<&mut Motion> {
        match &mut self.drive {
            NodeSource::Posed(_) => None,
            NodeSource::Simulated(motion) => Some(motion),
        }
    }

    /// Returns the section planes and isosurfaces.
    pub fn inside(&self) -> &Sections {
        self.raycaster.inside()
    }

    /// Returns the transfer function of the displayed field, in absolute values.
    pub fn transfer(&self) -> ResolvedTransfer {
        self.raycaster.transfer()
    }

    /// Sets the transfer function of the volume; the boundary and regions with their own appearance
    /// keep theirs.
    ///
    /// # Errors
    /// As [`Raycaster::set_transfer`].
    pub fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        self.cached = None;
        self.raycaster.set_transfer(transfer)
    }

    /// Sets the background of [`Stage::record`] as RGBA; default black.
    pub fn set_backdrop(&mut self, colour: [f32; 4]) {
        self.backdrop = colour;
    }

    /// Sets the sections of the volume, boundary and skins; tools are clipped by planes in space
    /// only.
    ///
    /// # Errors
    /// As [`Raycaster::set_sections`].
    pub fn set_sections(&mut self, inside: &Sections) -> Result<()> {
        self.set_body_inside(inside)?;
        // Tools have no rest configuration.
        let mut in_space = inside.clone();
        in_space.planes.retain(|plane| !plane.at_rest);
        for tool in &mut self.tools {
            tool.skin.set_sections(&in_space)?;
        }
        Ok(())
    }

    /// Sets the sections of the body and its skins, but not of tools.
    fn set_body_inside(&mut self, inside: &Sections) -> Result<()> {
        if inside.needs_rest_positions() && !self.raycaster.inside().needs_rest_positions() {
            let mesh = self.drive.mesh();
            self.raycaster.geometry_mut().store_rest_positions(mesh)?;
        }
        self.raycaster.set_sections(inside)?;
        if self.mode == DisplayMode::Surface {
            self.surface
                .set_sections(inside, self.raycaster.geometry())?;
        }
        for skin in &mut self.skins {
            skin.set_sections(inside)?;
        }
        self.cached = None;
        Ok(())
    }

    /// Sets the target of a tool, by its index in the scene: the tool moves there straight within
    /// the next step. The place is in file units, and the tool must not have a path in the scene.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an unknown tool, or one with a path.
    pub fn set_tool_target(&mut self, number: usize, place: DVec3) -> Result<()> {
        let (id, pose) = self.led_tool(number, place)?;
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        motion.simulator.loads_mut().set_tool_target(id, pose)
    }

    /// As [`Stage::set_tool_target`], but moves the tool at once, without collision detection.
    ///
    /// # Errors
    /// As [`Stage::set_tool_target`].
    pub fn teleport_tool(&mut self, number: usize, place: DVec3) -> Result<()> {
        let (id, pose) = self.led_tool(number, place)?;
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        motion.simulator.loads_mut().teleport_tool(id, pose)
    }

    /// Returns a tool without a path, and its pose at `place`.
    fn led_tool(&self, number: usize, place: DVec3) -> Result<(ToolId, ToolPose)> {
        let motion = self.motion().ok_or_else(|| no_tool(number))?;
        let tool = motion
            .time_dependent_loads
            .tools
            .get(number)
            .filter(|t| !t.moves());
        let id = tool.ok_or_else(|| no_tool(number))?.id;
        let turn = motion.simulator.loads().tool(id)?.turn();
        Ok((id, ToolPose::new(place, turn)))
    }

    /// Returns the force of the body on the tool of this number, N.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) for an unknown tool; otherwise as
    /// [`Simulator::tool_forces`].
    ///
    /// [`Simulator::tool_forces`]: crate::physics::Simulator::tool_forces
    pub fn tool_force(&mut self, number: usize) -> Result<DVec3> {
        let motion = self.motion_mut().ok_or_else(|| no_tool(number))?;
        let forces = motion.simulator.tool_forces()?;
        let force = forces.get(number).map(|on| on.force);
        force.ok_or_else(|| Error::Input(format!("unknown tool {number} (counted from 0)")))
    }

    /// Returns the scene's number of steps before a picture; 0 for a static body.
    pub fn steps(&self) -> u32 {
        self.motion().map_or(0, |_| self.steps)
    }

    /// Returns the simulated time, s.
    pub fn time(&self) -> f64 {
        self.motion().map_or(0.0, Motion::time)
    }

    /// Runs `steps` steps of the solver and reports the number done to `progress`.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if the simulation failed; the last valid state is
    /// kept and can be drawn.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        while done < steps {
            let Some(some) = self.steps_until_cut(steps - done) else {
                return Ok(());
            };
            if let Some(motion) = self.motion_mut() {
                motion.run(some, &mut |n| progress(done + n))?;
            }
            done += some;
            self.cut_as_swept()?;
        }
        Ok(())
    }

    /// Starts up to `steps` more steps without waiting, for interactive use; call it again once
    /// [`Stage::poll_steps`] returns false.
    ///
    /// # Errors
    /// As [`Stage::run`].
    pub fn request_steps(&mut self, steps: u32) -> Result<()> {
        let some = self.steps_until_cut(steps);
        match (some, self.motion_mut()) {
            (Some(some), Some(motion)) => motion.request_steps(some),
            _ => Ok(()),
        }
    }

    /// Whether steps started by [`Stage::request_steps`] are still being computed; does not wait.
    /// Makes the cuts of the scene once the steps are done.
    ///
    /// # Errors
    /// As [`Stage::run`].
    pub fn poll_steps(&mut self) -> Result<bool> {
        let under_way = match self.motion_mut() {
            Some(motion) => motion.poll_steps()?,
            None => false,
        };
        if !under_way {
            self.cut_as_swept()?;
        }
        Ok(under_way)
    }

    /// Returns the number of steps, at most `steps`, until the next cut of the scene; `None` for a
    /// static body.
    fn steps_until_cut(&self, steps: u32) -> Option<u32> {
        let motion = self.motion()?;
        let time = motion.time();
        let pace = self.cutters.iter().filter_map(|k| k.cut_interval(time));
        Some(match pace.min_by(f64::total_cmp) {
            None => steps,
            Some(pace) => ((pace / motion.dt).ceil() as u32)
                .clamp(1, steps.max(1))
                .min(steps),
        })
    }

    /// Makes the cuts that the scene's blades have swept since the last call.
    fn cut_as_swept(&mut self) -> Result<()> {
        let time = self.time();
        let swept = self.cutters.iter_mut().filter_map(|k| k.next_sweep(time));
        let blades: Vec<Blade> = swept.collect();
        for blade in &blades {
            self.cut(blade)?;
        }
        Ok(())
    }

    /// Sets the node positions, in file units.
    ///
    /// # Errors
    /// As [`NodePositions::set_positions`].
    pub fn set_positions(&mut self, positions: &[DVec3]) -> Result<()> {
        match &mut self.drive {
            NodeSource::Posed(posed) => posed.nodes.set_positions(positions),
            NodeSource::Simulated(motion) => motion.simulator.set_positions(positions),
        }
    }

    /// Returns the mesh in its current configuration with its fields, `displacement` and `velocity`
    /// (both in file units) at the nodes, and the fields of `[output] fields`.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn deformed_mesh(&self) -> Result<TetMesh> {
        let positions = self.positions()?;
        let mut mesh = self.mesh().clone();
        for field in self.motion_fields(&positions)? {
            mesh.set_field(field)?;
        }
        mesh.nodes = positions;
        Ok(mesh)
    }

    /// Writes the current state to a series, with its fields, `displacement` and `velocity`, and
    /// the fields of `[output] fields`.
    ///
    /// # Errors
    /// An error of the read-back or of writing.
    pub fn write_frame(&self, series: &mut PvdSeries) -> Result<()> {
        let positions = self.positions()?;
        let fields = self.motion_fields(&positions)?;
        series.push_deformed(self.time(), self.mesh(), &positions, &fields)
    }

    /// Returns the node positions of the last picture, in file units. For a body on the CPU this
    /// does not wait for a running step; otherwise the positions are read back.
    ///
    /// # Errors
    /// An error of the read-back.
    pub fn drawn_positions(&self) -> Result<Vec<DVec3>> {
        self.drive.nodes().positions()
    }

    /// Reads back the node positions, in file units.
    fn positions(&self) -> Result<Vec<DVec3>> {
        match &self.drive {
            NodeSource::Posed(posed) => posed.nodes.positions(),
            NodeSource::Simulated(motion) => motion.positions(),
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
            fields.extend(computed_field::output_fields(&self.scene, motion)?);
        }
        Ok(fields)
    }
}

fn no_tool(number: usize) -> Error {
    Error::Input(format!(
        "the scene has no tool {number} (counted from 0) that can be moved interactively: it must have no `path`, `file` and `rotation`"
    ))
}

/// Returns points that bound `points` for any rotation about `up` through the centre of their
/// bounds: rings with the radius of the points at each height.
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
    // A polygon around a circle has a larger circumradius.
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
