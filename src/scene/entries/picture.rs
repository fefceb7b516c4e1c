//! Entries of the camera, the lighting, X-rays and the picture.

use crate::annotate::Axes;
use crate::render::Light;
use crate::scene::keywords;
#[cfg(feature = "cli")]
use crate::scene::schema;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Lighting of the volume.
///
/// ```toml
/// [light]
/// from = "head"           # at the eye; or "none", or a direction [1.0, 0, 2] to the light
/// shadows = 0.7           # shadow strength, 0 to 1; default: none
/// ```
///
/// Light that travels, in mode `composite`:
///
/// ```toml
/// [light]
/// model = "path"          # paths of light with multiple scattering and soft shadows
/// samples = 64            # per pixel
/// noise = 0.01            # end earlier, when the noise is 1 %
/// seed = 0                # the same seed gives the same picture on one driver
/// environment = "studio"  # or "white", or a file .hdr or .exr; with a direction in `from`: a sun
/// exposure = 1.0          # factor on the light
/// extinction = 4.0        # factor on the extinction: tissue looks more solid
/// denoise = true          # filter the last noise
/// roughness = 0.4         # of surfaces, 0.1 to 1
/// anisotropy = 0.0        # mean cosine of scattering in soft tissue, -0.95 to 0.95
/// aperture = 0.0          # radius of the lens, in the mesh's unit; 0: all is in focus
/// focus = 120.0           # distance in focus; default: of the point looked at
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LightEntry {
    /// How light is computed: `local`, from the gradient at each place (default), or `path`.
    #[serde(default, deserialize_with = "keywords::light_model")]
    #[cfg_attr(feature = "cli", schemars(extend("default" = "local", "enum" = ["local", "path"], "examples" = ["path"])))]
    pub model: Option<String>,
    /// Samples per pixel of light paths; default 64.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 64, "minimum" = 1, "maximum" = 1048576, "examples" = [256])))]
    pub samples: Option<u32>,
    /// Noise of light paths at which they end, as a fraction of the light.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 0.00001, "maximum" = 1.0, "examples" = [0.01])))]
    pub noise: Option<f64>,
    /// Seed of the random numbers of light paths; default 0.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0, "examples" = [1])))]
    pub seed: Option<u32>,
    /// Surroundings that light the body by paths: `studio` (default), `white`, or a file .hdr or
    /// .exr, relative to the scene.
    #[cfg_attr(feature = "cli", schemars(extend("default" = "studio", "examples" = ["white", "hall.hdr"])))]
    pub environment: Option<String>,
    /// Factor on the light of paths; default 1.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 1.0, "minimum" = 0.001, "maximum" = 1000.0, "examples" = [1.5])))]
    pub exposure: Option<f64>,
    /// Factor on the extinction for light paths: above 1, tissue looks more solid; default 1.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 1.0, "minimum" = 0.001, "maximum" = 10000.0, "examples" = [8.0])))]
    pub extinction: Option<f64>,
    /// Whether the last noise of light paths is filtered; default false.
    #[cfg_attr(feature = "cli", schemars(extend("default" = false, "examples" = [true])))]
    pub denoise: Option<bool>,
    /// Roughness of surfaces for light paths, 0.1 to 1; default 0.4.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0.4, "minimum" = 0.1, "maximum" = 1.0, "examples" = [0.2])))]
    pub roughness: Option<f64>,
    /// Mean cosine of the scattering angle in soft tissue for light paths, −0.95 to 0.95; default 0.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0.0, "minimum" = -0.95, "maximum" = 0.95, "examples" = [0.5])))]
    pub anisotropy: Option<f64>,
    /// Radius of the lens for light paths, in the mesh's unit; default 0, all in focus.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "default" = 0.0, "minimum" = 0.0, "examples" = [2.0])))]
    pub aperture: Option<f64>,
    /// Distance from the eye in focus, in the mesh's unit; default that of the point looked at.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [120.0])))]
    pub focus: Option<f64>,
    /// Light source; default: at the eye.
    #[serde(default, deserialize_with = "keywords::light")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::light", extend("default" = "head", "examples" = ["none", [1.0, 0.0, 2.0]])))]
    pub from: Option<Light>,
    /// Shadow strength, from 0 to 1.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 0.0, "maximum" = 1.0, "examples" = [0.7])))]
    pub shadows: Option<f64>,
}

/// Settings of X-ray pictures (mode `xray`).
///
/// ```toml
/// [xray]
/// energy = 60             # keV, 20 to 150
/// water = 0               # scalars of water and air: Hounsfield units by default
/// air = -1000             # if there are negative values
/// white_level = 6         # ∫ μ dl shown as white on the film
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct XrayEntry {
    /// Energy of the source, 20 to 150 keV; default 60.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "keV", "default" = 60.0, "minimum" = 20.0, "maximum" = 150.0, "examples" = [80.0])))]
    pub energy: Option<f64>,
    /// Scalar of water; default 0, or 1024 if no value is negative and some are at least 1000.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "of the scan", "examples" = [1000.0])))]
    pub water: Option<f64>,
    /// Scalar of air; default: 1000 below water.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "of the scan", "examples" = [0.0])))]
    pub air: Option<f64>,
    /// ∫ μ dl shown as white in a PNG; default: the largest value of the first picture.
    #[cfg_attr(feature = "cli", schemars(extend("exclusiveMinimum" = 0.0, "examples" = [6.0])))]
    pub white_level: Option<f64>,
}

/// The camera, in the units of the mesh file.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Position of the camera.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.5, -1.0, 0.3]])))]
    pub eye: Option<[f64; 3]>,
    /// Point that the camera looks at.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.5, -1.0, 0.3]])))]
    pub look_at: Option<[f64; 3]>,
    /// Up direction.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[0.0, 0.0, 1.0]])))]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, in degrees.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "degrees", "exclusiveMinimum" = 0.0, "exclusiveMaximum" = 180.0, "examples" = [30.0])))]
    pub fov: Option<f64>,
    /// Height of the view of an orthographic camera, instead of `fov`.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [0.4])))]
    pub orthographic: Option<f64>,
    /// Whether a default view is centred at the body's bounds with wider margins, instead of filling
    /// the picture; default false.
    pub frame_all: Option<bool>,
}

impl CameraEntry {
    /// Whether no key of the camera is set.
    pub fn is_unset(&self) -> bool {
        let places = [self.eye, self.look_at, self.up];
        places.iter().all(Option::is_none) && self.fov.is_none() && self.orthographic.is_none()
    }
}

/// The picture.
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PictureEntry {
    /// The displayed field. Default: the regions, one colour each, unless `transfer` is set;
    /// otherwise the first scalar field at the nodes, or the depth below the surface.
    /// For a simulated body also `displacement`, `von_mises`, `stress_1` to `stress_3`, `strain`,
    /// `J` or `energy_density`, computed in the current configuration: see
    /// [`BodyField`](crate::physics::BodyField).
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["intensity", "von_mises"])))]
    pub field: Option<String>,
    /// Smallest and largest value of the field; values outside are clamped. Default: the range of
    /// the field, or for a computed field the range over the run so far.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "of the field", "examples" = [[0.0, 5000.0]])))]
    pub range: Option<[f64; 2]>,
    /// Name of a preset, a JSON file relative to the scene file, or inline JSON.
    #[serde(default, deserialize_with = "keywords::transfer")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::transfer", extend("examples" = ["muscle", "viridis", "mine.json"])))]
    pub transfer: Option<String>,
    /// Width and height in pixels.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "pixels", "default" = [1024, 768], "examples" = [[1920, 1080]])))]
    pub size: Option<[u32; 2]>,
    /// `composite`, `thickness`, `mip`, `minip` or `mean` (maximum, minimum or mean scalar along
    /// each ray, in grey), `xray` (∫ μ dl of CT numbers, as film in a PNG), `surface`, or `skin`:
    /// only the skins, without the volume.
    #[serde(default, deserialize_with = "keywords::mode")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::mode", extend("default" = "composite", "examples" = ["xray"])))]
    pub mode: Option<String>,
    /// Whether the volume is drawn in addition to slices and isosurfaces; default true.
    #[cfg_attr(feature = "cli", schemars(extend("default" = true, "examples" = [false])))]
    pub volume: Option<bool>,
    /// Ray traversal: `vertices` or `planes`.
    #[serde(default, deserialize_with = "keywords::traversal")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::traversal", extend("examples" = ["planes"])))]
    pub traversal: Option<String>,
    /// Background of a PNG or film: `gradient` (default), `black`, `white` or `transparent`.
    #[serde(default, deserialize_with = "keywords::background")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::background", extend("examples" = ["white"])))]
    pub background: Option<String>,
    /// Largest number of surface layers that a ray may enter.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 1, "maximum" = 255, "examples" = [16])))]
    pub layers: Option<u32>,
    /// Largest error of pixel values (range 0 to 1), which determines the size of the
    /// pre-integration table; default 0.001.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0.001, "exclusiveMinimum" = 0.0, "examples" = [0.0005])))]
    pub accuracy: Option<f64>,
    /// Boundaries between regions in modes `composite` and `surface`: `smooth` (default; interpolated
    /// within the tets, from the label volume that the mesh was made from where there is one, with the
    /// layers that the mesh leaves out at its surface), or `tets`, along their faces. Bodies of more than
    /// 150,000 tets, in pieces or that are cut have the latter.
    #[serde(default, deserialize_with = "keywords::boundaries")]
    pub boundaries: Option<String>,
    /// Bits per channel of a PNG: 8 or 16.
    #[cfg_attr(feature = "cli", schemars(extend("enum" = [8, 16], "examples" = [16])))]
    pub bits: Option<u32>,
    /// Largest root mean square error of the pixel values, in 1/255: selects the cheapest settings
    /// that were measured to satisfy it. Default 0.5.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "1/255", "default" = 0.5, "exclusiveMinimum" = 0.0, "examples" = [0.1])))]
    pub quality: Option<f64>,
    /// Samples per pixel (supersampling): a square number from 1 to 64. The picture is rendered
    /// with that many times as many pixels (4: twice per axis) and each pixel is the mean of its
    /// samples, in colours premultiplied by opacity, as in compositing. Default: 4 with skins or a
    /// lit boundary, and 1 otherwise; a translucent skin over a volume is faster with 1.
    #[cfg_attr(feature = "cli", schemars(extend("enum" = [1, 4, 9, 16, 25, 36, 49, 64], "examples" = [4])))]
    pub samples: Option<u32>,
    /// Regions, by name or label, that are not drawn.
    #[serde(default)]
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [["skin", "fat"]])))]
    pub hide: Vec<String>,
    /// Appearance of regions, by name or label.
    #[serde(default)]
    pub region: BTreeMap<String, RegionAppearanceEntry>,
    /// A colour bar of the field, or a list of the regions, at the right. Like all overlays it is
    /// drawn in PNGs and videos only: an EXR contains only the rendered values.
    pub legend: Option<bool>,
    /// A scale bar of a round length, in metres if the unit is known, otherwise in the mesh's unit.
    /// With a perspective camera it is correct at the distance of the point looked at.
    pub scale_bar: Option<bool>,
    /// `true` for arrows x, y and z, or `"anatomical"` for R L A P S I at the picture's edges, for
    /// a mesh in RAS coordinates, such as those made from scans: see
    /// [`Axes`](crate::annotate::Axes).
    #[serde(default, deserialize_with = "keywords::axes")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::axes", extend("examples" = [true, "anatomical"])))]
    pub axes: Option<Axes>,
    /// A line of text at the top.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["A liver"])))]
    pub title: Option<String>,
    /// Simulated time, at the upper left.
    pub time: Option<bool>,
}

impl PictureEntry {
    /// Returns the transfer functions given as names of JSON files.
    pub(in crate::scene) fn transfer_files(&mut self) -> impl Iterator<Item = &mut String> {
        let of_regions = self.region.values_mut();
        let of_regions = of_regions.filter_map(|look| look.transfer.as_mut());
        let all = self.transfer.as_mut().into_iter().chain(of_regions);
        all.filter(|transfer| transfer.ends_with(".json"))
    }
}

/// Appearance of a region of a labelled body; unset keys are inherited from the picture.
///
/// ```toml
/// [picture.region.bone]
/// transfer = "bone"       # applied over the field's range
///
/// [picture.region.skin]
/// colour = "wheat"        # one colour, independent of the field
/// opacity = 0.2           # over the mean chord length of the region
///
/// [picture.region.3]
/// hidden = true
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RegionAppearanceEntry {
    /// Name of a preset, a JSON file relative to the scene file, or inline JSON.
    #[serde(default, deserialize_with = "keywords::transfer")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::transfer", extend("examples" = ["bone"])))]
    pub transfer: Option<String>,
    /// Colour name, or #RRGGBB, for all values of the field.
    #[serde(default, deserialize_with = "keywords::colour")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::text", extend("examples" = ["wheat", "#d04030"])))]
    pub colour: Option<String>,
    /// Opacity over the mean chord length of the region, from 0 to 1, independent of the field;
    /// default 0.9 if a colour but no transfer function is given.
    #[cfg_attr(feature = "cli", schemars(extend("minimum" = 0.0, "maximum" = 1.0, "examples" = [0.6])))]
    pub opacity: Option<f64>,
    /// Whether it is not drawn.
    #[serde(default)]
    pub hidden: bool,
}
