//! A scene made real: the mesh on the GPU, the body that moves, the raycaster that draws it.

use super::checkpoint::Journal;
use super::picture::{SIZE, Shown};
use super::skin::carrier;
use super::touch::Knife;
use super::{Motion, Scene, Seen};
use crate::gpu::{Gpu, Recorder};
use crate::io::PvdSeries;
use crate::mesh::{Blade, Field, Location, ScalarType, TetMesh, Topology};
use crate::physics::grid::GridShape;
use crate::physics::{Nodes, SolverKind};
use crate::render::{
    Background, BitDepth, Camera, Image, Mode, Pick, Raycaster, Surface, SurfaceTarget, Target,
};
use crate::skin::{Composer, Skin};
use crate::{Error, Result};
use glam::{DVec2, DVec3};

/// Steps before a picture where a scene names a solver but no number of steps.
pub const STEPS: u32 = 50;

/// A scene ready to be moved and drawn.
pub struct Stage {
    pub(super) gpu: Gpu,
    pub(super) mesh: TetMesh,
    pub(super) actor: Actor,
    pub(super) raycaster: Raycaster,
    pub(super) surface: Surface,
    pub(super) camera: Camera,
    pub(super) size: [u32; 2],
    pub(super) shown: Shown,
    pub(super) topology: Topology,
    pub(super) seen: Seen,
    pub(super) scene: Scene,
    pub(super) skins: Vec<Skin>,
    pub(super) composer: Composer,
    pub(super) knives: Vec<Knife>,
    /// What checkpoints need, where they are kept.
    pub(super) journal: Option<Journal>,
    pub(super) background: Background,
    pub(super) bits: BitDepth,
    pub(super) steps: u32,
    pub(super) drawn_version: u64,
    /// The last picture, as long as nothing has changed since.
    pub(super) still: Option<Still>,
    /// Pictures drawn, and those for which the last one stood.
    pub(super) pictures: [u64; 2],
    pub(super) depth: Option<wgpu::TextureView>,
    pub(super) notes: Vec<String>,
}

/// A picture and what it shows.
pub(super) struct Still {
    version: u64,
    camera: Camera,
    image: Image,
}

/// Who moves the nodes.
pub(super) enum Actor {
    /// Nobody, or the caller, pose by pose.
    Posed(Box<Nodes>),
    /// A solver.
    Moving(Box<Motion>),
}

impl Actor {
    pub(super) fn nodes(&self) -> &Nodes {
        match self {
            Actor::Posed(nodes) => nodes,
            Actor::Moving(motion) => motion.drawn_nodes(),
        }
    }
}

impl Stage {
    /// Loads the mesh of `scene` and prepares everything on `gpu`.
    ///
    /// # Errors
    /// [`Error::Input`] for what makes no sense in the scene, what reading the mesh gives, or
    /// [`Error::Gpu`] when it does not fit the device.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Stage> {
        let Some(grid) = &scene.grid else {
            return Stage::with_mesh(gpu, scene, scene.mesh.load()?);
        };
        let (shape, mesh, notes) = scene.carve(grid)?;
        let mut stage = Stage::assemble(gpu, scene, mesh, Some(shape))?;
        stage.notes.splice(0..0, notes);
        Ok(stage)
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
        let mut notes = mesh.repairs.warnings.clone();
        let topology = Topology::new(&mesh);
        let seen = scene.seen(&mesh, &topology)?;
        notes.extend(seen.note.clone());
        let solver = scene.solver.name.as_deref().map(str::parse::<SolverKind>);
        let actor = match solver.transpose()? {
            None => {
                if !(scene.grab.is_empty() && scene.cut.is_empty()) {
                    notes.push(
                        "nothing moves, so grabs and cuts are passed over: name a solver".into(),
                    );
                }
                Actor::Posed(Box::new(Nodes::new(gpu, &mesh)?))
            }
            Some(kind) => {
                let (motion, said) = Motion::new(gpu, scene, kind, &mesh, shape)?;
                notes.extend(said);
                Actor::Moving(Box::new(motion))
            }
        };
        let (raycaster, surface) = scene.painters(gpu, &mesh, &topology, &seen, actor.nodes())?;
        let size = scene.picture.size.unwrap_or(SIZE);
        let reach = match &actor {
            Actor::Moving(motion) => motion.reach.as_ref(),
            Actor::Posed(_) => None,
        };
        let points = reach.unwrap_or(&mesh.nodes);
        let mut stage = Stage {
            gpu: gpu.clone(),
            camera: scene.camera(&mesh, points, size)?,
            size,
            shown: scene.shown()?,
            background: scene.background()?,
            bits: scene.bits()?,
            steps: scene.solver.steps.unwrap_or(STEPS),
            drawn_version: actor.nodes().version(),
            still: None,
            pictures: [0; 2],
            depth: None,
            composer: Composer::new(gpu, scene.compose_options())?,
            knives: scene.cut.iter().map(Knife::new).collect::<Result<_>>()?,
            journal: None,
            skins: Vec::new(),
            scene: scene.clone(),
            topology,
            seen,
            mesh,
            actor,
            raycaster,
            surface,
            notes,
        };
        if !scene.skin.is_empty() {
            let carrier = carrier(gpu, &stage.mesh, &mut stage.actor)?;
            for entry in &scene.skin {
                let (skin, notes) = entry.put_on(gpu, &carrier)?;
                stage.skins.push(skin);
                stage.notes.extend(notes);
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
        &self.mesh
    }

    /// The scalar that is seen.
    pub fn seen(&self) -> &Seen {
        &self.seen
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
            let positions = self.positions()?;
            // Grids have nodes of no tet, which are never seen and may be anywhere.
            let mut seen = vec![false; positions.len()];
            for v in self.mesh.tets.iter().flatten() {
                seen[*v as usize] = true;
            }
            let seen = positions.iter().zip(&seen).filter(|(_, seen)| **seen);
            let mut points: Vec<DVec3> = seen.map(|(x, _)| *x).collect();
            points.extend_from_slice(also);
            self.camera = self.scene.camera(&self.mesh, &points, self.size)?;
        }
        Ok(())
    }

    /// Draws pictures of this size from now on.
    pub fn set_size(&mut self, size: [u32; 2]) {
        self.size = size;
        self.still = None;
    }

    /// The body and its solver, if the scene has one.
    pub fn motion(&self) -> Option<&Motion> {
        match &self.actor {
            Actor::Posed(_) => None,
            Actor::Moving(motion) => Some(motion),
        }
    }

    /// As [`Stage::motion`], to push and pull the body.
    pub fn motion_mut(&mut self) -> Option<&mut Motion> {
        match &mut self.actor {
            Actor::Posed(_) => None,
            Actor::Moving(motion) => Some(motion),
        }
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
    /// [`Error::Solver`] when the simulation failed; the last good state stays and can be drawn.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        while done < steps {
            let Actor::Moving(motion) = &mut self.actor else {
                return Ok(());
            };
            let time = motion.time();
            let pace = self.knives.iter().filter_map(|k| k.pace(time));
            let some = match pace.min_by(f64::total_cmp) {
                None => steps - done,
                Some(pace) => ((pace / motion.dt).ceil() as u32).clamp(1, steps - done),
            };
            motion.run(some, &mut |n| progress(done + n))?;
            done += some;
            let time = motion.time();
            let blades: Vec<Blade> = self
                .knives
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
        match &mut self.actor {
            Actor::Posed(nodes) => nodes.set_positions(positions),
            Actor::Moving(motion) if motion.caged.is_some() => Err(Error::Input(
                "a mesh that a cage carries stands where its cage has it; leave [cage] out to pose it".into(),
            )),
            Actor::Moving(motion) => motion.body.set_positions(positions),
        }
    }

    /// Brings the mesh to where its cage is, and tells the raycaster if the nodes may have moved
    /// since it last drew.
    pub(super) fn notice_moves(&mut self, work: &mut Recorder) {
        if let Actor::Moving(motion) = &mut self.actor {
            motion.carry(work);
        }
        let version = self.actor.nodes().version();
        if version != self.drawn_version {
            self.drawn_version = version;
            self.raycaster.geometry_mut().moved();
        }
    }

    /// What is seen of the body's boundary at the point `pixel` of the picture, where the body is
    /// now; none where the ray through it misses. Reads 36 bytes back.
    ///
    /// # Errors
    /// As [`Geometry::pick`](crate::render::Geometry::pick).
    pub fn pick(&self, pixel: DVec2) -> Result<Option<Pick>> {
        self.raycaster
            .geometry()
            .pick(&self.camera, pixel, self.size)
    }

    /// The picture, as the scene describes it: the last one, where neither body nor camera has
    /// moved since.
    ///
    /// # Errors
    /// As [`Raycaster::image`].
    pub fn image(&mut self) -> Result<Image> {
        let mut work = self.gpu.record();
        self.notice_moves(&mut work);
        work.submit()?;
        let version = self.drawn_version;
        if let Some(still) = &self.still
            && (still.version, still.camera) == (version, self.camera)
        {
            self.pictures[1] += 1;
            return Ok(still.image.clone());
        }
        let image = self.draw()?;
        self.pictures[0] += 1;
        self.still = Some(Still {
            version,
            camera: self.camera,
            image: image.clone(),
        });
        Ok(image)
    }

    fn draw(&mut self) -> Result<Image> {
        match self.shown {
            Shown::Inside(Mode::Composite) if !self.skins.is_empty() => {
                let inside = Some(&mut self.raycaster);
                let skins = &mut self.skins;
                self.composer.image(skins, inside, &self.camera, self.size)
            }
            Shown::Inside(mode) => self.raycaster.image(&self.camera, self.size, mode),
            Shown::Surface => self.surface.image(&self.camera, self.size),
            Shown::Skin => {
                let skins = &mut self.skins;
                self.composer.image(skins, None, &self.camera, self.size)
            }
        }
    }

    /// Records the drawing of the picture into `colour`, whose size replaces the scene's, on
    /// black: for callers with encoders and views of their own. Reads nothing back.
    ///
    /// # Errors
    /// As [`Raycaster::record`].
    pub fn record(&mut self, work: &mut Recorder, colour: &wgpu::TextureView) -> Result<()> {
        self.notice_moves(work);
        let background = Some([0.0, 0.0, 0.0, 1.0]);
        let target = Target {
            colour,
            occluder: None,
            background,
        };
        let (camera, skins) = (&self.camera, &mut self.skins);
        match self.shown {
            Shown::Skin => self.composer.record(work, skins, None, camera, &target),
            Shown::Inside(Mode::Composite) if !skins.is_empty() => {
                let inside = Some(&mut self.raycaster);
                self.composer.record(work, skins, inside, camera, &target)
            }
            Shown::Inside(mode) => self.raycaster.record(work, camera, mode, &target),
            Shown::Surface => {
                let depth = self.depth_for(colour)?;
                let target = SurfaceTarget {
                    colour,
                    depth: &depth,
                    background,
                };
                self.surface.record(work, &self.camera, &target)
            }
        }
    }

    /// A depth attachment of the size of `colour`, kept for the next picture.
    fn depth_for(&mut self, colour: &wgpu::TextureView) -> Result<wgpu::TextureView> {
        let texture = colour.texture();
        if let Some(depth) = &self.depth
            && depth.texture().size() == texture.size()
        {
            return Ok(depth.clone());
        }
        let depth = self.gpu.target(
            "depth",
            [texture.width(), texture.height()],
            wgpu::TextureFormat::Depth32Float,
            wgpu::TextureUsages::RENDER_ATTACHMENT,
        )?;
        self.depth = Some(depth.clone());
        Ok(depth)
    }

    /// Draws the picture and saves it, with the scene's background and bit depth.
    ///
    /// # Errors
    /// As [`Stage::image`] and [`Image::save_as`].
    pub fn save(&mut self, path: impl AsRef<std::path::Path>) -> Result<()> {
        self.image()?.save_as(path, self.background, self.bits)
    }

    /// The extension that suits the pictures of this stage.
    pub fn picture_extension(&self) -> &'static str {
        match self.shown {
            Shown::Inside(Mode::Thickness) => "exr",
            _ => "png",
        }
    }

    /// The mesh where it is now, with its fields, `displacement` and `velocity` (both in file
    /// units) at the nodes.
    ///
    /// # Errors
    /// What reading back gives.
    pub fn deformed_mesh(&self) -> Result<TetMesh> {
        let positions = self.positions()?;
        let mut mesh = self.mesh.clone();
        for field in self.motion_fields(&positions)? {
            mesh.set_field(field)?;
        }
        mesh.nodes = positions;
        Ok(mesh)
    }

    /// Adds the present state to a series, with its fields, `displacement` and `velocity`.
    ///
    /// # Errors
    /// What reading back or writing gives.
    pub fn push(&self, series: &mut PvdSeries) -> Result<()> {
        let positions = self.positions()?;
        let fields = self.motion_fields(&positions)?;
        series.push_deformed(self.time(), &self.mesh, &positions, &fields)
    }

    /// Where the nodes of the mesh are, in file units, read back.
    fn positions(&self) -> Result<Vec<DVec3>> {
        match &self.actor {
            Actor::Posed(nodes) => nodes.positions(),
            Actor::Moving(motion) => motion.positions(),
        }
    }

    fn motion_fields(&self, positions: &[DVec3]) -> Result<Vec<Field>> {
        let displacements = positions
            .iter()
            .zip(&self.mesh.nodes)
            .map(|(x, rest)| *x - *rest);
        let mut fields = vec![vector_field("displacement", displacements)];
        if let Some(motion) = self.motion() {
            let velocities = motion.carried(motion.body.velocities()?)?;
            fields.push(vector_field("velocity", velocities.into_iter()));
        }
        Ok(fields)
    }
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
