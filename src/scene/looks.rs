//! What a scene shows of a body, ready to be drawn.

use super::annotated::Surroundings;
use super::drawn_tool::DrawnTool;
use super::picture::{DisplayMode, SIZE};
use super::scan::Scans;
use super::shown::{self, Shown};
use super::skin::carrier;
use super::stage::Drive;
use super::xray::RadiographFilm;
use super::{ScalarField, Scene};
use crate::Result;
use crate::gpu::Gpu;
use crate::render::{Background, BitDepth, Camera, Raycaster, Surface};
use crate::skin::{Composer, Skin};

/// The part of a [`Stage`](super::Stage) that goes by how its body looks, not by how it moves.
pub(super) struct Looks {
    pub surroundings: Surroundings,
    pub film: RadiographFilm,
    pub samples: u32,
    pub camera: Camera,
    pub size: [u32; 2],
    pub mode: DisplayMode,
    pub background: Background,
    pub bits: BitDepth,
    pub composer: Composer,
    pub skins: Vec<Skin>,
    pub tools: Vec<DrawnTool>,
    pub scalars: ScalarField,
    pub shown: Option<Shown>,
    pub raycaster: Raycaster,
    pub surface: Surface,
    /// What was assumed, in words.
    pub notes: Vec<String>,
}

impl Looks {
    /// Those that `scene` gives the body that `drive` moves, where it is.
    pub fn new(gpu: &Gpu, scene: &Scene, drive: &mut Drive) -> Result<Looks> {
        let (mesh, topology) = (drive.mesh(), drive.topology());
        let mut notes = Vec::new();
        shown::check_asked(scene, drive)?;
        let (scans, shown, scalars) = match scene.scans(mesh)? {
            Some(Scans {
                scans,
                seen,
                notes: said,
            }) => {
                notes.extend(said);
                (scans, None, seen)
            }
            None => match Shown::new(scene, drive)? {
                Some((shown, scalars)) => (Vec::new(), Some(shown), scalars),
                None => (Vec::new(), None, scene.scalar_field(mesh, topology)?),
            },
        };
        notes.extend(scalars.note.clone());
        let nodes = drive.nodes();
        let seen = (&scalars, scans.as_slice());
        let painters = scene.painters(gpu, mesh, topology, seen, nodes, &mut notes)?;
        let (raycaster, surface) = painters;
        let size = scene.picture.size.unwrap_or(SIZE);
        let reach = match &*drive {
            Drive::Simulated(motion) => motion.reach.as_ref(),
            Drive::Posed(_) => None,
        };
        let points = reach.unwrap_or(&mesh.nodes);
        let (surroundings, said) = Surroundings::new(scene, (mesh, topology), &scalars)?;
        notes.extend(said);
        let camera = scene.camera(mesh, points, size)?;
        let tools = match &*drive {
            Drive::Simulated(motion) => {
                DrawnTool::all(gpu, scene, (mesh, drive.nodes().frame()), motion)?
            }
            Drive::Posed(_) => Vec::new(),
        };
        let mut skins = Vec::new();
        if !(scene.skin.is_empty() && scene.carried.is_empty()) {
            let carrier = carrier(gpu, drive)?;
            for entry in scene.skin.iter().filter(|skin| !skin.hidden) {
                let (mut skin, said) = entry.put_on(gpu, &carrier)?;
                skin.set_inside(raycaster.inside())?;
                skins.push(skin);
                notes.extend(said);
            }
            for entry in scene.carried.iter().filter(|tool| !tool.hidden) {
                skins.push(entry.carried_skin(gpu, &carrier)?);
            }
        }
        Ok(Looks {
            surroundings,
            film: RadiographFilm::new(&scene.xray)?,
            samples: scene.samples_each_way()?,
            camera,
            size,
            mode: scene.display_mode()?,
            background: scene.background()?,
            bits: scene.bits()?,
            composer: Composer::new(gpu, scene.compose_options()?)?,
            skins,
            tools,
            scalars,
            shown,
            raycaster,
            surface,
            notes,
        })
    }
}
