//! The view, the light and the picture.

use crate::render::Light;
use crate::scene::words;
use serde::Deserialize;

/// The light on the inside.
///
/// ```toml
/// [light]
/// from = "head"           # the eye; or "none", or [1.0, 0, 2]: the direction towards it
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightEntry {
    /// Where it comes from; the eye where nothing is said.
    #[serde(default, deserialize_with = "words::light")]
    pub from: Option<Light>,
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
    #[serde(default, deserialize_with = "words::transfer")]
    pub transfer: Option<String>,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// `composite`, `thickness`, `mip`, `minip` or `mean` (the largest, least or mean scalar on each
    /// ray, grey), `surface`, or `skin`: the skins alone, without the inside.
    #[serde(default, deserialize_with = "words::mode")]
    pub mode: Option<String>,
    /// Whether the volume itself is drawn beside slices and isosurfaces; it is where nothing is
    /// said.
    pub volume: Option<bool>,
    /// `vertices` or `planes`.
    #[serde(default, deserialize_with = "words::walk")]
    pub walk: Option<String>,
    /// What is behind the volume in a PNG: `black`, `white` or `transparent`.
    #[serde(default, deserialize_with = "words::background")]
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
    /// With skins: the picture is drawn so many times larger each way, and averaged; 2 where
    /// nothing is said. A translucent skin over a volume is quicker with 1.
    pub samples: Option<u32>,
}
