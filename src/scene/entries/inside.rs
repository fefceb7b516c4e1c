//! Entries of section planes and isosurfaces.

use crate::render::{Isosurface, Plane, PlaneKind};
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;

/// A clip or slice plane, or a clip box, in the units of the mesh file.
///
/// ```toml
/// [[plane]]
/// clip = [0, 0, 0.1, 0, 0, 1]     # a point, and the normal towards the clipped side
/// rest = true                     # given at rest: the section deforms with the body
///
/// [[plane]]
/// slice = [0, 0, 0, 1, 0, 0]      # draws the field on the section
/// opacity = 0.7
///
/// [[plane]]
/// box = [-0.1, -0.1, 0, 0.1, 0.1, 0.2]   # two corners: the outside is clipped
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct PlaneEntry {
    /// A point and the normal of a clip plane; the side of the normal is clipped.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 0.1, 0.0, 0.0, 1.0]])))]
    pub clip: Option<[f64; 6]>,
    /// A point and the normal of a slice plane, on which the field is drawn.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 0.1, 0.0, 0.0, 1.0]])))]
    pub slice: Option<[f64; 6]>,
    /// Two corners of a clip box; the outside is clipped.
    #[serde(rename = "box")]
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[-0.1, -0.1, 0.0, 0.1, 0.1, 0.2]])))]
    pub around: Option<[f64; 6]>,
    /// Whether the plane is given in the rest configuration.
    #[serde(default)]
    pub rest: bool,
    /// Opacity of a slice; default 1.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 1.0, "minimum" = 0.0, "maximum" = 1.0, "examples" = [0.6])))]
    pub opacity: Option<f64>,
}

impl PlaneEntry {
    /// Returns the planes of this entry.
    pub(in crate::scene) fn planes(&self) -> Result<Vec<Plane>> {
        let halves = |x: [f64; 6]| {
            let [a, b, c, d, e, f] = x;
            [DVec3::new(a, b, c), DVec3::new(d, e, f)]
        };
        if self.opacity.is_some() && self.slice.is_none() {
            return Err(Error::Input("[[plane]] `opacity` requires `slice`".into()));
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
                    "a [[plane]] must have exactly one of `clip`, `slice` and `box`".into(),
                ));
            }
        };
        Ok(match self.rest {
            true => planes.into_iter().map(Plane::at_rest).collect(),
            false => planes,
        })
    }
}

/// An isosurface of the field.
///
/// ```toml
/// [[isosurface]]
/// value = 0.5
/// colour = "tomato"               # or "#d04030"; default: the field's colour
/// opacity = 0.6
/// ```
#[derive(Clone, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct IsosurfaceEntry {
    /// The isovalue.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "of the field", "examples" = [0.5])))]
    pub value: f64,
    /// Colour name, or #RRGGBB.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["tomato", "#d04030"])))]
    pub colour: Option<String>,
    /// Opacity; default 1.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 1.0, "minimum" = 0.0, "maximum" = 1.0, "examples" = [0.6])))]
    pub opacity: Option<f64>,
}

impl IsosurfaceEntry {
    /// Returns the isosurface of this entry.
    pub(in crate::scene) fn isosurface(&self) -> Result<Isosurface> {
        let (colour, opacity) = (self.colour.as_deref(), self.opacity.unwrap_or(1.0));
        format!("{},{},{opacity}", self.value, colour.unwrap_or_default()).parse()
    }
}
