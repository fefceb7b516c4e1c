//! Render state of a scene's body.

use super::annotations::AnnotationContext;
use super::computed_field::{self, ComputedField};
use super::drawn_mesh::DrawnMesh;
use super::picture::{DEFAULT_SIZE, DisplayMode};
use super::scan::SceneScans;
use super::skin::carrier;
use super::stage::NodeSource;
use super::tool_skin::ToolSkin;
use super::xray::RadiographFilm;
use super::{ScalarField, Scene};
use crate::Result;
use crate::gpu::Gpu;
use crate::render::{Background, BitDepth, Camera, PathOptions, Raycaster, Surface};
use crate::skin::{Compositor, Skin};

/// The part of a [`Stage`](super::Stage) that depends on the appearance of the body, not on its
/// motion.
pub(super) struct SceneAppearance {
    /// Data of the annotations.
    pub surroundings: AnnotationContext,
    /// Film of X-ray pictures.
    pub film: RadiographFilm,
    /// Supersampling factor per axis.
    pub samples: u32,
    pub camera: Camera,
    pub size: [u32; 2],
    pub mode: DisplayMode,
    pub background: Background,
    pub bits: BitDepth,
    pub composer: Compositor,
    pub skins: Vec<Skin>,
    /// The displayed tools.
    pub tools: Vec<ToolSkin>,
    pub scalars: ScalarField,
    /// The displayed field, if it is recomputed for each picture.
    pub computed_field: Option<ComputedField>,
    /// The mesh that is drawn in place of the body's own, if regions have smooth boundaries.
    pub drawn: Option<DrawnMesh>,
    pub raycaster: Raycaster,
    /// Options of light paths, if the picture is drawn by them.
    pub paths: Option<PathOptions>,
    pub surface: Surface,
    /// Automatic choices, as messages.
    pub notes: Vec<String>,
}

impl SceneAppearance {
    /// Creates the render state that `scene` gives the body of `drive` in its current
    /// configuration.
    pub fn new(gpu: &Gpu, scene: &Scene, drive: &mut NodeSource) -> Result<SceneAppearance> {
        let drawn = scene.drawn_mesh(gpu, drive)?;
        let (mesh, topology) = match &drawn {
            Some(drawn) => (&drawn.mesh, &drawn.topology),
            None => (drive.mesh(), drive.topology()),
        };
        let mut notes = Vec::new();
        computed_field::check_output_fields(scene, drive)?;
        let (scans, computed_field, mut scalars) = match scene.scans(mesh)? {
            Some(SceneScans {
                scans,
                seen,
                notes: more_notes,
            }) => {
                notes.extend(more_notes);
                (scans, None, seen)
            }
            None => match ComputedField::new(scene, drive)? {
                Some((field, scalars)) => (Vec::new(), Some(field), scalars),
                None => (Vec::new(), None, scene.scalar_field(mesh, topology)?),
            },
        };
        notes.extend(scalars.note.clone());
        DrawnMesh::label_nodes(drawn.as_ref(), &mut scalars);
        let nodes = drawn.as_ref().map_or(drive.nodes(), DrawnMesh::nodes);
        let seen = (&scalars, scans.as_slice());
        let painters = scene.build_renderers(gpu, mesh, topology, seen, nodes, &mut notes)?;
        let (raycaster, surface) = painters;
        let size = scene.picture.size.unwrap_or(DEFAULT_SIZE);
        let reach = match &*drive {
            NodeSource::Simulated(motion) => motion.motion_envelope.as_ref(),
            NodeSource::Posed(_) => None,
        };
        let points = reach.unwrap_or(&drive.mesh().nodes);
        let (surroundings, more_notes) = AnnotationContext::new(scene, (mesh, topology), &scalars)?;
        notes.extend(more_notes);
        let camera = scene.camera(drive.mesh(), points, size)?;
        let tools = match &*drive {
            NodeSource::Simulated(motion) => {
                ToolSkin::build_all(gpu, scene, (drive.mesh(), drive.nodes().frame()), motion)?
            }
            NodeSource::Posed(_) => Vec::new(),
        };
        let mut skins = Vec::new();
        if !(scene.skin.is_empty() && scene.carried.is_empty()) {
            let frame = drive.mesh().frame;
            let carrier = carrier(gpu, drive)?;
            for entry in scene.skin.iter().filter(|skin| !skin.hidden) {
                let (mut skin, more_notes) = entry.attach(gpu, &carrier, frame)?;
                skin.set_sections(raycaster.inside())?;
                skins.push(skin);
                notes.extend(more_notes);
            }
            for entry in scene.carried.iter().filter(|tool| !tool.hidden) {
                skins.push(entry.dynamic_tool_skin(gpu, &carrier)?);
            }
        }
        Ok(SceneAppearance {
            surroundings,
            film: RadiographFilm::new(&scene.xray)?,
            samples: scene.samples_each_way()?,
            camera,
            size,
            mode: scene.display_mode()?,
            background: scene.background()?,
            bits: scene.bits()?,
            composer: Compositor::new(gpu, scene.compose_options()?)?,
            skins,
            tools,
            scalars,
            computed_field,
            drawn,
            raycaster,
            paths: scene.light.paths()?.filter(|_| scene.is_composite()),
            surface,
            notes,
        })
    }
}
