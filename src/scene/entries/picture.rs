//! The view, the light and the picture.

use crate::annotate::Axes;
use crate::render::Light;
use crate::scene::keywords;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The light on the inside.
///
/// ```toml
/// [light]
/// from = "head"           # the eye; or "none", or [1.0, 0, 2]: the direction towards it
/// shadows = 0.7           # how dark they are, to 1; none where nothing is said
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightEntry {
    /// Where it comes from; the eye where nothing is said.
    #[serde(default, deserialize_with = "keywords::light")]
    pub from: Option<Light>,
    /// How dark it is where the body keeps the light off.
    pub shadows: Option<f64>,
}

/// X-rays, of pictures in mode `xray`.
///
/// ```toml
/// [xray]
/// energy = 60             # keV, 20 to 150
/// water = 0               # the scalar that is water, and that is air: Hounsfield's units
/// air = -1000             # where nothing is said and there are negative ones
/// white = 6               # ∫ μ dl that is white on the film
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct XrayEntry {
    /// Energy of the source, 20 to 150 keV; 60 where nothing is said.
    pub energy: Option<f64>,
    /// The scalar of water; where nothing is said 0, or 1024 where no value is negative and some
    /// reach 1000.
    pub water: Option<f64>,
    /// The scalar of air; where nothing is said 1000 below water.
    pub air: Option<f64>,
    /// ∫ μ dl that is white in a PNG; the most in the first picture where nothing is said.
    pub white: Option<f64>,
}

/// The view, in the units of the mesh file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Where the camera is.
    pub eye: Option<[f64; 3]>,
    /// What it looks at.
    pub look_at: Option<[f64; 3]>,
    /// Which way is up.
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, in degrees.
    pub fov: Option<f64>,
    /// Height of the view for an orthographic camera, instead of `fov`.
    pub orthographic: Option<f64>,
}

impl CameraEntry {
    /// Whether nothing of the view is said.
    pub fn is_unset(&self) -> bool {
        let places = [self.eye, self.look_at, self.up];
        places.iter().all(Option::is_none) && self.fov.is_none() && self.orthographic.is_none()
    }
}

/// The picture.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureEntry {
    /// The field that is seen. Where nothing is said: the regions, a colour each, unless there is
    /// a `transfer`; or the first scalar at the nodes, or the depth below the surface.
    ///
    /// Of a body that moves also `displacement`, `von_mises`, `stress_1` to `stress_3`, `strain`,
    /// `J` or `energy_density`, computed where it is: see
    /// [`BodyField`](crate::physics::BodyField).
    pub field: Option<String>,
    /// Smallest and largest value of the field, which stand for what is beyond them; those that it
    /// has where nothing is said, and of one that is computed, those that it has had so far.
    pub range: Option<[f64; 2]>,
    /// A preset's name, a JSON file beside the scene file, or the JSON itself.
    #[serde(default, deserialize_with = "keywords::transfer")]
    pub transfer: Option<String>,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// `composite`, `thickness`, `mip`, `minip` or `mean` (the largest, least or mean scalar on each
    /// ray, grey), `xray` (∫ μ dl of CT numbers, on film in a PNG), `surface`, or `skin`: the skins alone, without the inside.
    #[serde(default, deserialize_with = "keywords::mode")]
    pub mode: Option<String>,
    /// Whether the volume itself is drawn beside slices and isosurfaces; it is where nothing is
    /// said.
    pub volume: Option<bool>,
    /// `vertices` or `planes`.
    #[serde(default, deserialize_with = "keywords::walk")]
    pub walk: Option<String>,
    /// What is behind the volume in a PNG: `black`, `white` or `transparent`.
    #[serde(default, deserialize_with = "keywords::background")]
    pub background: Option<String>,
    /// The most surface layers a ray may enter.
    pub layers: Option<u32>,
    /// Error of the picture's values, of 1, that the size of the table is chosen for; 0.001 where
    /// nothing is said.
    pub accuracy: Option<f64>,
    /// Bits a channel of a PNG: 8 or 16.
    pub bits: Option<u32>,
    /// The root mean square error that its values may have, in 1/255: the cheapest settings that
    /// were measured to keep to it are taken. 0.5 where nothing is said.
    pub quality: Option<f64>,
    /// Samples a pixel: a square number from 1 to 64. The picture is drawn so many times as large,
    /// 4 being twice each way, and each pixel is their mean, of colours premultiplied by opacity, as
    /// they are composed. Where nothing is said 4 with skins and of a lit boundary, and 1 otherwise;
    /// a translucent skin over a volume is quicker with 1.
    pub samples: Option<u32>,
    /// Regions, by name or label, that are not drawn at all.
    #[serde(default)]
    pub hide: Vec<String>,
    /// What regions look like, by name or label.
    #[serde(default)]
    pub region: BTreeMap<String, RegionAppearanceEntry>,
    /// A bar of the field's colours, or its regions by name, at the right. Like all that is drawn
    /// onto a picture, on PNGs and films: an EXR has the values alone.
    pub legend: Option<bool>,
    /// A bar of a round length, in the mesh's unit or metres where that is known. Of a perspective
    /// camera it is the length at the distance of what it looks at.
    pub scale_bar: Option<bool>,
    /// `true` for arrows x, y and z, or `"anatomical"` for R L A P S I at the picture's edges, of a
    /// mesh in RAS, as those made of scans are: see [`Axes`](crate::annotate::Axes).
    #[serde(default, deserialize_with = "keywords::axes")]
    pub axes: Option<Axes>,
    /// A line of text at the top.
    pub title: Option<String>,
    /// The simulated time, at the upper left.
    pub time: Option<bool>,
}

impl PictureEntry {
    /// The transfer functions that are the names of JSON files.
    pub(in crate::scene) fn transfer_files(&mut self) -> impl Iterator<Item = &mut String> {
        let of_regions = self.region.values_mut();
        let of_regions = of_regions.filter_map(|look| look.transfer.as_mut());
        let all = self.transfer.as_mut().into_iter().chain(of_regions);
        all.filter(|transfer| transfer.ends_with(".json"))
    }
}

/// What a region of a labelled body looks like; what is not said is as in the rest of the picture.
///
/// ```toml
/// [picture.region.bone]
/// transfer = "bone"       # over the field's range
///
/// [picture.region.skin]
/// colour = "wheat"        # one colour, whatever the field
/// opacity = 0.2           # of a ray's mean way through the region
///
/// [picture.region.3]
/// hidden = true
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionAppearanceEntry {
    /// A preset's name, a JSON file beside the scene file, or the JSON itself.
    #[serde(default, deserialize_with = "keywords::transfer")]
    pub transfer: Option<String>,
    /// A colour's name, or #RRGGBB: for all values of the field.
    #[serde(default, deserialize_with = "keywords::colour")]
    pub colour: Option<String>,
    /// What a ray's mean way through the region hides, from 0 to 1, whatever the field; 0.9 where
    /// a colour is given and no transfer function.
    pub opacity: Option<f64>,
    /// Whether it is not drawn at all.
    #[serde(default)]
    pub hidden: bool,
}
