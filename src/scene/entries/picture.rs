//! Entries of the camera, the lighting, X-rays and the picture.

use crate::annotate::Axes;
use crate::render::Light;
use crate::scene::keywords;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Lighting of the volume.
///
/// ```toml
/// [light]
/// from = "head"           # at the eye; or "none", or a direction [1.0, 0, 2] to the light
/// shadows = 0.7           # shadow strength, 0 to 1; default: none
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightEntry {
    /// Light source; default: at the eye.
    #[serde(default, deserialize_with = "keywords::light")]
    pub from: Option<Light>,
    /// Shadow strength, from 0 to 1.
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
#[serde(deny_unknown_fields)]
pub struct XrayEntry {
    /// Energy of the source, 20 to 150 keV; default 60.
    pub energy: Option<f64>,
    /// Scalar of water; default 0, or 1024 if no value is negative and some are at least 1000.
    pub water: Option<f64>,
    /// Scalar of air; default: 1000 below water.
    pub air: Option<f64>,
    /// ∫ μ dl shown as white in a PNG; default: the largest value of the first picture.
    pub white_level: Option<f64>,
}

/// The camera, in the units of the mesh file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Position of the camera.
    pub eye: Option<[f64; 3]>,
    /// Point that the camera looks at.
    pub look_at: Option<[f64; 3]>,
    /// Up direction.
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, in degrees.
    pub fov: Option<f64>,
    /// Height of the view of an orthographic camera, instead of `fov`.
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
#[serde(deny_unknown_fields)]
pub struct PictureEntry {
    /// The displayed field. Default: the regions, one colour each, unless `transfer` is set;
    /// otherwise the first scalar field at the nodes, or the depth below the surface.
    /// For a simulated body also `displacement`, `von_mises`, `stress_1` to `stress_3`, `strain`,
    /// `J` or `energy_density`, computed in the current configuration: see
    /// [`BodyField`](crate::physics::BodyField).
    pub field: Option<String>,
    /// Smallest and largest value of the field; values outside are clamped. Default: the range of
    /// the field, or for a computed field the range over the run so far.
    pub range: Option<[f64; 2]>,
    /// Name of a preset, a JSON file relative to the scene file, or inline JSON.
    #[serde(default, deserialize_with = "keywords::transfer")]
    pub transfer: Option<String>,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// `composite`, `thickness`, `mip`, `minip` or `mean` (maximum, minimum or mean scalar along
    /// each ray, in grey), `xray` (∫ μ dl of CT numbers, as film in a PNG), `surface`, or `skin`:
    /// only the skins, without the volume.
    #[serde(default, deserialize_with = "keywords::mode")]
    pub mode: Option<String>,
    /// Whether the volume is drawn in addition to slices and isosurfaces; default true.
    pub volume: Option<bool>,
    /// Ray traversal: `vertices` or `planes`.
    #[serde(default, deserialize_with = "keywords::traversal")]
    pub traversal: Option<String>,
    /// Background of a PNG or film: `gradient` (default), `black`, `white` or `transparent`.
    #[serde(default, deserialize_with = "keywords::background")]
    pub background: Option<String>,
    /// Largest number of surface layers that a ray may enter.
    pub layers: Option<u32>,
    /// Largest error of pixel values (range 0 to 1), which determines the size of the
    /// pre-integration table; default 0.001.
    pub accuracy: Option<f64>,
    /// Boundaries between regions in modes `composite` and `surface`: `smooth` (default; interpolated
    /// within the tets, from the label volume that the mesh was made from where there is one), or
    /// `tets`, along their faces. Bodies of more than 150,000 tets, in pieces or that are cut have the
    /// latter.
    #[serde(default, deserialize_with = "keywords::boundaries")]
    pub boundaries: Option<String>,
    /// Bits per channel of a PNG: 8 or 16.
    pub bits: Option<u32>,
    /// Largest root mean square error of the pixel values, in 1/255: selects the cheapest settings
    /// that were measured to satisfy it. Default 0.5.
    pub quality: Option<f64>,
    /// Samples per pixel (supersampling): a square number from 1 to 64. The picture is rendered
    /// with that many times as many pixels (4: twice per axis) and each pixel is the mean of its
    /// samples, in colours premultiplied by opacity, as in compositing. Default: 4 with skins or a
    /// lit boundary, and 1 otherwise; a translucent skin over a volume is faster with 1.
    pub samples: Option<u32>,
    /// Regions, by name or label, that are not drawn.
    #[serde(default)]
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
    pub axes: Option<Axes>,
    /// A line of text at the top.
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
#[serde(deny_unknown_fields)]
pub struct RegionAppearanceEntry {
    /// Name of a preset, a JSON file relative to the scene file, or inline JSON.
    #[serde(default, deserialize_with = "keywords::transfer")]
    pub transfer: Option<String>,
    /// Colour name, or #RRGGBB, for all values of the field.
    #[serde(default, deserialize_with = "keywords::colour")]
    pub colour: Option<String>,
    /// Opacity over the mean chord length of the region, from 0 to 1, independent of the field;
    /// default 0.9 if a colour but no transfer function is given.
    pub opacity: Option<f64>,
    /// Whether it is not drawn.
    #[serde(default)]
    pub hidden: bool,
}
