//! Flags shared by all commands that render; they override the values of a scene.

use super::flag_values::{Pair, Six, Triple, axes, pair, six, size, triple, unit};
use super::path_flags::{LightFlag, PathFlags};
use super::refinement::AccuracyFlags;
use super::volume_flag::{self, VolumeFlag};
use clap::Args;
use palpate::annotate::Axes;
use palpate::mesh::AnatomicalFrame;
use palpate::physics::{EngineChoice, MaterialModel};
use palpate::render::Isosurface;
use palpate::scene::{IsosurfaceEntry, MaterialEntry, PlaneEntry, ScanEntry, Scene, Unit};
use std::path::{Path, PathBuf};

/// Flags of `render` and `simulate`; each overrides a value of the scene file.
#[derive(Args, Clone, Debug, Default)]
pub struct SceneFlags {
    /// Select the rendered field [default: the regions, the first scalar, or the depth below the
    /// surface]. For a simulated body also displacement, von_mises, stress_1, stress_2, stress_3,
    /// strain, J, energy_density
    #[arg(long, help_heading = "Picture")]
    pub field: Option<String>,
    /// Render a volume embedded in the body instead of its fields, at the volume's own resolution
    /// (.nrrd, .nii.gz, .mha, a folder of DICOM slices …). Its header gives its position in RAS mm,
    /// in which the body is at rest. Repeatable; --transfer and --range apply to the first
    #[arg(long, value_name = "VOLUME", help_heading = "Picture")]
    pub scan: Vec<PathBuf>,
    /// Set the rest state of a deformed mesh, for --scan and planes given at rest: a mesh file of the
    /// same connectivity [default: computed from the mesh's field displacement, if it has one]
    #[arg(long, value_name = "MESH", help_heading = "Picture")]
    pub rest: Option<PathBuf>,
    /// Set the range of the field, LOW,HIGH; values outside are clamped
    #[arg(long, help_heading = "Picture", value_parser = pair, allow_hyphen_values = true)]
    pub range: Option<Pair>,
    /// Set the transfer function: a JSON file or a preset (`palpate presets` lists them)
    #[arg(long, help_heading = "Picture")]
    pub transfer: Option<String>,
    /// Set the picture size in pixels, WIDTHxHEIGHT [default: 1024x768]
    #[arg(long, help_heading = "Picture", value_parser = size)]
    pub size: Option<[u32; 2]>,
    /// Select the rendering mode: composite, thickness (length inside the mesh; EXR), mip, minip or
    /// mean (maximum, minimum or mean scalar along each ray, in grey), xray (attenuation computed
    /// from CT numbers: ∫ μ dl in an EXR, the film in a PNG), or surface
    #[arg(long, help_heading = "Picture")]
    pub mode: Option<String>,
    /// Set the photon energy of mode xray, 20 to 150 keV [default: 60]
    #[arg(long, value_name = "KEV", help_heading = "Picture")]
    pub energy: Option<f64>,
    /// Select the ray traversal of tets: vertices or planes
    #[arg(long, value_name = "TRAVERSAL", help_heading = "Picture")]
    pub walk: Option<String>,
    /// Set the background of a PNG or film: gradient, black, white or transparent [default: gradient]
    #[arg(long, help_heading = "Picture")]
    pub background: Option<String>,
    /// Set the boundaries of regions: smooth, or tets (along their faces) [default: smooth]
    #[arg(long, help_heading = "Picture")]
    pub boundaries: Option<String>,
    /// Set the light of the volume: head, none, a direction x,y,z towards it, or path for light that
    /// travels, with multiple scattering and soft shadows [default: head]
    #[arg(
        long,
        value_name = "LIGHT",
        help_heading = "Picture",
        allow_hyphen_values = true
    )]
    pub light: Option<LightFlag>,
    #[command(flatten)]
    pub paths: PathFlags,
    /// Set the strength of shadows within the body, 0 to 1; with the head light, of ambient occlusion
    /// [default: none; 0.7 without a number]
    #[arg(
        long,
        value_name = "STRENGTH",
        help_heading = "Picture",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "0.7"
    )]
    pub shadows: Option<f64>,
    /// Clip the side of a plane to which its normal points: a point and the normal,
    /// x,y,z,nx,ny,nz, in the mesh's unit; repeatable
    #[arg(long, value_name = "PLANE", help_heading = "Inside", value_parser = six, allow_hyphen_values = true)]
    pub clip: Vec<Six>,
    /// Clip as --clip, with a plane in the rest configuration, which deforms with the body
    #[arg(long, value_name = "PLANE", help_heading = "Inside", value_parser = six, allow_hyphen_values = true)]
    pub clip_rest: Vec<Six>,
    /// Clip everything outside a box: two corners, x,y,z,x,y,z
    #[arg(long, value_name = "BOX", help_heading = "Inside", value_parser = six, allow_hyphen_values = true)]
    pub clip_box: Vec<Six>,
    /// Clip as --clip-box, with a box in the rest configuration
    #[arg(long, value_name = "BOX", help_heading = "Inside", value_parser = six, allow_hyphen_values = true)]
    pub clip_box_rest: Vec<Six>,
    /// Render the field on a plane x,y,z,nx,ny,nz
    #[arg(long, value_name = "PLANE", help_heading = "Inside", value_parser = six, allow_hyphen_values = true)]
    pub slice: Vec<Six>,
    /// Render as --slice, with a plane in the rest configuration
    #[arg(long, value_name = "PLANE", help_heading = "Inside", value_parser = six, allow_hyphen_values = true)]
    pub slice_rest: Vec<Six>,
    /// Render an isosurface: VALUE[,COLOUR[,OPACITY]], such as 0.5,tomato,0.6; repeatable
    #[arg(
        long,
        value_name = "ISO",
        help_heading = "Inside",
        allow_hyphen_values = true
    )]
    pub iso: Vec<Isosurface>,
    /// Render slices and isosurfaces only, without the volume
    #[arg(long, help_heading = "Inside")]
    pub no_volume: bool,
    /// Hide regions, by name or label, separated by commas
    #[arg(
        long,
        value_name = "REGIONS",
        help_heading = "Inside",
        value_delimiter = ','
    )]
    pub hide: Vec<String>,
    /// Set the largest root mean square error of the picture, in 1/255; selects the cheapest settings
    /// that were measured to satisfy it [default: 0.5]
    #[arg(long, value_name = "TOLERANCE", help_heading = "Picture")]
    pub quality: Option<f64>,
    /// Set the largest number of surface layers that a ray may enter; more is an error
    #[arg(long, help_heading = "Picture")]
    pub layers: Option<u32>,
    /// Set the bits per channel of a PNG: 8 or 16 [default: 8]
    #[arg(long, help_heading = "Picture")]
    pub bits: Option<u32>,
    /// Set the samples per pixel (supersampling), a square number from 1 to 64; 4 doubles the
    /// resolution per axis and averages [default: 4 with skins or a lit boundary, 1 otherwise]
    #[arg(long, value_name = "N", help_heading = "Picture")]
    pub samples: Option<u32>,
    /// Draw a colour bar of the field, or a list of the regions, at the right; a strip next to it
    /// has the opacity of a tenth of the mesh's extent. In PNGs and films only, like all overlays
    #[arg(long, help_heading = "Around the picture")]
    pub legend: bool,
    /// Draw a scale bar of a round length, in metres if the unit is known, otherwise in the mesh's
    /// unit; exact with --orthographic, otherwise valid at the distance of the point looked at
    #[arg(long, help_heading = "Around the picture")]
    pub scale_bar: bool,
    /// Draw the axes x, y and z (xyz), or the letters R L A P S I at the picture's edges (anatomical),
    /// for a mesh in RAS coordinates, such as those made from scans
    #[arg(
        long,
        value_name = "AXES",
        num_args = 0..=1,
        default_missing_value = "xyz",
        value_parser = axes,
        help_heading = "Around the picture"
    )]
    pub axes: Option<Axes>,
    /// Draw a line of text at the top of the picture
    #[arg(long, value_name = "TEXT", help_heading = "Around the picture")]
    pub title: Option<String>,
    /// Draw the simulated time
    #[arg(long, help_heading = "Around the picture")]
    pub time: bool,

    /// Set the camera position x,y,z, in the mesh's unit [default: the whole motion is framed]
    #[arg(long, help_heading = "Camera", value_parser = triple, allow_hyphen_values = true)]
    pub eye: Option<Triple>,
    /// Set the point that the camera looks at, x,y,z
    #[arg(long, help_heading = "Camera", value_parser = triple, allow_hyphen_values = true)]
    pub look_at: Option<Triple>,
    /// Set the up direction of the picture, x,y,z
    #[arg(long, help_heading = "Camera", value_parser = triple, allow_hyphen_values = true)]
    pub up: Option<Triple>,
    /// Set the vertical field of view, in degrees
    #[arg(long, help_heading = "Camera", conflicts_with = "orthographic")]
    pub fov: Option<f64>,
    /// Frame the body around the centre of its bounds instead of filling the picture
    #[arg(long, help_heading = "Camera")]
    pub frame_all: bool,
    /// Use an orthographic camera with a view of this height, in the mesh's unit
    #[arg(long, help_heading = "Camera")]
    pub orthographic: Option<f64>,

    /// Write computed fields with the meshes, per tet: names as for --field, separated by commas;
    /// von_mises@nodes for nodal averages
    #[arg(
        long,
        value_name = "FIELDS",
        help_heading = "Physics",
        value_delimiter = ','
    )]
    pub write_fields: Vec<String>,
    /// Select the time integrator: explicit, symplectic, verlet, velocity-verlet or implicit; for
    /// finite elements also bdf2 and midpoint, of second order at large steps [default: none, a
    /// static mesh]
    #[arg(long, help_heading = "Physics")]
    pub solver: Option<String>,
    /// Select the engine of the time steps: gpu, cpu, rapier (in builds that include it), or auto,
    /// which uses a GPU if there is one
    #[arg(long, value_name = "ENGINE", help_heading = "Physics")]
    pub engine: Option<EngineChoice>,
    /// Set the time step in s [default: 0.01 for implicit solvers, or longer if the load is chosen
    /// automatically; otherwise a fraction of the largest stable step]
    #[arg(long, help_heading = "Physics")]
    pub dt: Option<f64>,
    /// Set the number of steps before the picture, or between frames [default: 50 for a picture]
    #[arg(long, help_heading = "Physics")]
    pub steps: Option<u32>,
    /// Select the material model: springs, neo-hookean or corotated [default: neo-hookean; springs for
    /// grids, and if a stiffness or damping of springs is set]
    #[arg(long, value_name = "MODEL", help_heading = "Physics")]
    pub material: Option<MaterialModel>,
    /// Set one stiffness κ for all springs, in N/m
    #[arg(long, help_heading = "Physics", conflicts_with = "young")]
    pub stiffness: Option<f64>,
    /// Set Young's modulus, in Pa
    #[arg(long, help_heading = "Physics")]
    pub young: Option<f64>,
    /// Set Poisson's ratio of neo-hookean and corotated [default: 0.4]; springs have 1/4
    #[arg(long, help_heading = "Physics")]
    pub poisson: Option<f64>,
    /// Select the volumetric formulation of neo-hookean and corotated: per-tet (the default) or
    /// averaged, which avoids locking as Poisson's ratio approaches 1/2; or, by its number from 0, one
    /// of several volumes in the file of --scan, or else in the input
    #[arg(long, value_name = "VOLUME", help_heading = "Physics")]
    pub volume: Vec<VolumeFlag>,
    /// Set the density, in kg/m³
    #[arg(long, help_heading = "Physics")]
    pub density: Option<f64>,
    /// Set the damping κ_d of each spring, in N·s/m
    #[arg(long, help_heading = "Physics")]
    pub damping: Option<f64>,
    /// Set the damping ratio of neo-hookean and corotated at the frequency --damping-hz; 1 is critical
    /// damping
    #[arg(
        long,
        value_name = "ZETA",
        help_heading = "Physics",
        requires = "damping_hz",
        conflicts_with = "damping"
    )]
    pub damping_ratio: Option<f64>,
    /// Set the reference frequency of --damping-ratio, in Hz
    #[arg(
        long,
        value_name = "HZ",
        help_heading = "Physics",
        requires = "damping_ratio"
    )]
    pub damping_hz: Option<f64>,
    /// Set the length unit of the mesh file: m, cm, mm, um, in, or metres as a number
    #[arg(long, help_heading = "Physics", value_parser = unit)]
    pub unit: Option<Unit>,
    /// Set the frame of reference of a mesh or surface file that does not state its own: ras or lps
    #[arg(long, help_heading = "Mesh")]
    pub frame: Option<AnatomicalFrame>,
    /// Set the approximate number of tets of the scene's generator
    #[arg(long, help_heading = "Mesh")]
    pub tets: Option<usize>,
    /// Set gravity x,y,z, in m/s² [default: without supports and loads, chosen from the body's
    /// stiffness; otherwise 9.81 downwards]
    #[arg(long, help_heading = "Physics", value_parser = triple, allow_hyphen_values = true)]
    pub gravity: Option<Triple>,
    /// Continue after steps that invert tets of a body without inverted ones, instead of failing
    /// [default: only if the load is chosen automatically]
    #[arg(long, help_heading = "Physics")]
    pub allow_inversion: bool,
    #[command(flatten)]
    pub accuracy: AccuracyFlags,
}

impl SceneFlags {
    /// Builds the scene of `input` (a scene file or a mesh file) and these flags.
    pub fn scene(&self, input: &Path) -> palpate::Result<Scene> {
        let mut scene = match super::warp::is_scene(input) {
            true => Scene::read(input)?,
            false => Scene::of_mesh(input),
        };
        self.override_camera(&mut scene);
        self.override_picture(&mut scene);
        self.add_sections(&mut scene);
        self.override_solver(&mut scene);
        let of_bodies = scene.body.iter_mut();
        let of_bodies = of_bodies.filter_map(|body| body.material.as_mut());
        for material in of_bodies.chain([&mut scene.material]) {
            self.override_material(material);
        }
        self.override_mesh(&mut scene);
        self.accuracy.within.apply_to(&mut scene)?;
        Ok(scene)
    }

    fn override_camera(&self, scene: &mut Scene) {
        let camera = &mut scene.camera;
        override_with(self.eye.map(|t| t.0), &mut camera.eye);
        override_with(self.look_at.map(|t| t.0), &mut camera.look_at);
        override_with(self.up.map(|t| t.0), &mut camera.up);
        if self.fov.is_some() {
            camera.orthographic = None;
        }
        if self.orthographic.is_some() {
            camera.fov = None;
        }
        override_with(self.fov, &mut camera.fov);
        override_with(self.orthographic, &mut camera.orthographic);
        override_with(self.frame_all.then_some(true), &mut camera.frame_all);
    }

    /// Overrides the picture and what it shows, but for sections.
    fn override_picture(&self, scene: &mut Scene) {
        let given = self.clone();
        if given.field.is_some() {
            // The range belongs to the scene's own field.
            scene.picture.range = None;
        }
        override_with(given.field, &mut scene.picture.field);
        if !given.scan.is_empty() {
            let entry = |file: &PathBuf| ScanEntry {
                file: file.clone(),
                number: volume_flag::number(&self.volume),
                ..ScanEntry::default()
            };
            scene.scan = given.scan.iter().map(entry).collect();
        }
        if let Some(first) = scene.scan.first_mut() {
            override_with(given.range.map(|r| r.0), &mut first.range);
            override_with(given.transfer.clone(), &mut first.transfer);
        }
        override_with(given.energy, &mut scene.xray.energy);
        match given.light {
            Some(LightFlag::Path) => scene.light.model = Some("path".into()),
            Some(LightFlag::Local(light)) => {
                scene.light.model = None;
                scene.light.from = Some(light);
            }
            None => {}
        }
        given.paths.apply_to(&mut scene.light);
        override_with(given.shadows, &mut scene.light.shadows);
        let picture = &mut scene.picture;
        override_with(given.range.map(|r| r.0), &mut picture.range);
        override_with(given.transfer, &mut picture.transfer);
        override_with(given.size, &mut picture.size);
        override_with(given.mode, &mut picture.mode);
        override_with(given.walk, &mut picture.traversal);
        override_with(given.background, &mut picture.background);
        override_with(given.boundaries, &mut picture.boundaries);
        picture.hide.extend(given.hide);
        override_with(given.quality, &mut picture.quality);
        override_with(given.layers, &mut picture.layers);
        override_with(given.bits, &mut picture.bits);
        override_with(given.samples, &mut picture.samples);
        override_with(given.legend.then_some(true), &mut picture.legend);
        override_with(given.scale_bar.then_some(true), &mut picture.scale_bar);
        override_with(given.axes, &mut picture.axes);
        override_with(given.title, &mut picture.title);
        override_with(given.time.then_some(true), &mut picture.time);
    }

    fn override_solver(&self, scene: &mut Scene) {
        for body in &mut scene.body {
            body.solver = body.solver.take().filter(|_| self.solver.is_none());
            body.engine = body.engine.filter(|_| self.engine.is_none());
        }
        override_with(self.solver.clone(), &mut scene.solver.name);
        override_with(self.engine, &mut scene.solver.engine);
        override_with(self.dt, &mut scene.solver.dt);
        override_with(self.steps, &mut scene.solver.steps);
        override_with(self.gravity.map(|t| t.0), &mut scene.solver.gravity);
        let inversion = self.allow_inversion.then_some(true);
        override_with(inversion, &mut scene.solver.allow_inversion);
        if !self.write_fields.is_empty() {
            scene.output.fields = self.write_fields.clone();
        }
    }

    fn override_material(&self, material: &mut MaterialEntry) {
        if self.young.is_some() {
            material.stiffness = None;
        }
        override_with(self.stiffness, &mut material.stiffness);
        override_with(self.material, &mut material.model);
        override_with(self.young, &mut material.young);
        override_with(self.poisson, &mut material.poisson);
        override_with(volume_flag::formulation(&self.volume), &mut material.volume);
        override_with(self.accuracy.order, &mut material.order);
        override_with(self.density, &mut material.density);
        if self.damping.is_some() {
            (material.damping_ratio, material.damping_hz) = (None, None);
        }
        if self.damping_ratio.is_some() {
            material.damping = None;
        }
        override_with(self.damping, &mut material.damping);
        override_with(self.damping_ratio, &mut material.damping_ratio);
        override_with(self.damping_hz, &mut material.damping_hz);
    }

    fn override_mesh(&self, scene: &mut Scene) {
        override_with(self.rest.clone(), &mut scene.mesh.rest);
        for mesh in scene.body.iter_mut().map(|body| &mut body.mesh) {
            override_with(self.unit.clone(), &mut mesh.unit);
            override_with(self.frame, &mut mesh.frame);
            override_with(self.tets.filter(|_| mesh.tets.is_some()), &mut mesh.tets);
        }
        if scene.body.is_empty() {
            override_with(self.unit.clone(), &mut scene.mesh.unit);
            override_with(self.frame, &mut scene.mesh.frame);
            override_with(self.tets, &mut scene.mesh.tets);
        }
        let number = volume_flag::number(&self.volume).filter(|_| self.scan.is_empty());
        override_with(number, &mut scene.mesh.volume);
    }

    /// Adds planes and isosurfaces to those of the scene.
    fn add_sections(&self, scene: &mut Scene) {
        let mut add = |given: &[Six], rest: bool, put: fn(&mut PlaneEntry, [f64; 6])| {
            for six in given {
                let mut entry = PlaneEntry {
                    rest,
                    ..PlaneEntry::default()
                };
                put(&mut entry, six.0);
                scene.plane.push(entry);
            }
        };
        let clip: fn(&mut PlaneEntry, [f64; 6]) = |entry, six| entry.clip = Some(six);
        let around: fn(&mut PlaneEntry, [f64; 6]) = |entry, six| entry.around = Some(six);
        let slice: fn(&mut PlaneEntry, [f64; 6]) = |entry, six| entry.slice = Some(six);
        add(&self.clip, false, clip);
        add(&self.clip_rest, true, clip);
        add(&self.clip_box, false, around);
        add(&self.clip_box_rest, true, around);
        add(&self.slice, false, slice);
        add(&self.slice_rest, true, slice);
        scene
            .isosurface
            .extend(self.iso.iter().map(|iso| IsosurfaceEntry {
                value: iso.value,
                colour: iso.colour.map(hex),
                opacity: Some(iso.opacity),
            }));
        if self.no_volume {
            scene.picture.volume = Some(false);
        }
    }
}

/// Formats a colour as `#rrggbb`.
fn hex(colour: [f64; 3]) -> String {
    let [r, g, b] = colour.map(|x| (255.0 * x).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

pub(super) fn override_with<T>(given: Option<T>, place: &mut Option<T>) {
    if given.is_some() {
        *place = given;
    }
}
