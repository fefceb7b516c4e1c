//! Planes and isosurfaces, as a scene file has them.

use crate::render::{Isosurface, Plane, PlaneKind};
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;

/// A plane through the volume, or a box around what is kept of it, in the units of the mesh file.
///
/// ```toml
/// [[plane]]
/// clip = [0, 0, 0.1, 0, 0, 1]     # a point, and which way lies what is cut off
/// rest = true                     # given in the body at rest: the cut bends with it
///
/// [[plane]]
/// slice = [0, 0, 0, 1, 0, 0]      # shows the field where it meets the body
/// opacity = 0.7
///
/// [[plane]]
/// box = [-0.1, -0.1, 0, 0.1, 0.1, 0.2]   # two corners: what lies outside is cut off
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneEntry {
    /// A point of a plane and its normal: what lies beyond is cut off.
    pub clip: Option<[f64; 6]>,
    /// A point of a plane and its normal: it shows the field.
    pub slice: Option<[f64; 6]>,
    /// Two corners of a box: what lies outside is cut off.
    #[serde(rename = "box")]
    pub around: Option<[f64; 6]>,
    /// Whether it is given in the body at rest.
    #[serde(default)]
    pub rest: bool,
    /// Of a slice; 1 where nothing is said.
    pub opacity: Option<f64>,
}

impl PlaneEntry {
    /// The planes that are meant.
    pub(in crate::scene) fn planes(&self) -> Result<Vec<Plane>> {
        let halves = |x: [f64; 6]| {
            let [a, b, c, d, e, f] = x;
            [DVec3::new(a, b, c), DVec3::new(d, e, f)]
        };
        if self.opacity.is_some() && self.slice.is_none() {
            return Err(Error::Input(
                "[[plane]] opacity is a slice's; give it with `slice`".into(),
            ));
        }
        let planes = match (self.clip, self.slice, self.around) {
            (Some(clip), None, None) => {
                let [point, normal] = halves(clip);
                vec![Plane::clip(point, normal)]
            }
            (None, Some(slice), None) => {
                let [point, normal] = halves(slice);
                vec![Plane {
                    kind: PlaneKind::Slice(self.opacity.unwrap_or(1.0)),
                    ..Plane::slice(point, normal)
                }]
            }
            (None, None, Some(corners)) => {
                let [a, b] = halves(corners);
                Plane::clip_box(a.min(b), a.max(b)).to_vec()
            }
            _ => {
                return Err(Error::Input(
                    "a [[plane]] is one of `clip`, `slice` and `box`; give one of them".into(),
                ));
            }
        };
        Ok(match self.rest {
            true => planes.into_iter().map(Plane::at_rest).collect(),
            false => planes,
        })
    }
}

/// A surface on which the field has one value.
///
/// ```toml
/// [[isosurface]]
/// value = 0.5
/// colour = "tomato"               # or "#d04030"; that of the field where nothing is said
/// opacity = 0.6
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IsosurfaceEntry {
    /// The value.
    pub value: f64,
    /// A colour's name, or #RRGGBB.
    pub colour: Option<String>,
    /// 1 where nothing is said.
    pub opacity: Option<f64>,
}

impl IsosurfaceEntry {
    /// The isosurface that is meant.
    pub(in crate::scene) fn isosurface(&self) -> Result<Isosurface> {
        let (colour, opacity) = (self.colour.as_deref(), self.opacity.unwrap_or(1.0));
        format!("{},{},{opacity}", self.value, colour.unwrap_or_default()).parse()
    }
}
