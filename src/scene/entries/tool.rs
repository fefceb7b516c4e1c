//! Entries of contact: tools, and self-contact of the body.

use crate::mesh::TriMesh;
#[cfg(feature = "identify")]
use crate::{Error, Result, scene::Scene};
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// Self-contact of the body: between its pieces and within its folds. Requires finite elements on
/// the CPU engine, stepped by `implicit` or `bdf2`.
///
/// ```toml
/// [contact]
/// friction = 0.3          # default 0
/// gap = 0.2               # barrier distance, in the mesh's unit
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct ContactEntry {
    /// Coulomb friction coefficient μ; default 0.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0.0, "minimum" = 0.0, "examples" = [0.3])))]
    pub friction: Option<f64>,
    /// Distance at which the contact barrier becomes active; default: 1/20 of the mean edge length
    /// of the boundary.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [0.2])))]
    pub gap: Option<f64>,
}

/// A tool: a rigid shape in contact with the body, without penetration. Its motion is prescribed by
/// a path, or it is a dynamic rigid body (any shape but a plane; uses `[contact]`). It is drawn
/// with the body. Requires finite elements on the CPU engine, stepped by `implicit` or `bdf2`.
///
/// ```toml
/// [[tool]]
/// name = "finger"         # in reaction files; default `tool1`, `tool2` …
/// sphere = { radius = 8.0 }       # in the mesh's unit; or one of these:
/// # capsule = { radius = 5.0, length = 30.0 }   # `length` without the caps
/// # box = { size = [20.0, 10, 4] }
/// # plane = {}                    # a half-space
/// # surface = "probe.stl"         # any closed surface, in its own coordinates
/// at = [0.0, 0, 60]       # its centre, or the origin of the surface's coordinates
/// orientation = [0.0, 0, 1] # axis of a capsule, third edge of a box, normal of a plane
/// path = [[0.0, 0, 0, 0], [0.5, 0, 0, -10]]     # time (s) and displacement
/// # file = "path.csv"     # or a table with the columns time_s,x,y,z
/// rotation = [[0.0, 0], [0.5, 30]]    # time (s) and angle (degrees) …
/// axis = [0.0, 1, 0]      # … about this axis through its centre
/// friction = 0.3
/// # spring_stiffness = 500.0    # N/m: couples the tool to a hand that follows `path` …
/// # max_force = 2.0       # … with this largest force, N
/// # mass = 0.05           # kg, of a dynamic tool, with or without a spring
/// colour = [0.7, 0.75, 0.8]
/// # opacity = 0.5
/// # hidden = true         # in contact, but not drawn
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct ToolEntry {
    /// Name in reaction files.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["finger"])))]
    pub name: Option<String>,
    /// A sphere.
    pub sphere: Option<SphereEntry>,
    /// A capsule: a cylinder with hemispherical ends.
    pub capsule: Option<CapsuleEntry>,
    /// A box.
    #[serde(rename = "box")]
    pub cuboid: Option<BoxEntry>,
    /// A half-space below a plane.
    pub plane: Option<PlaneShapeEntry>,
    /// A closed surface, relative to the scene file; its edges are rounded by 1/64 of its extent.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["probe.stl"])))]
    pub surface: Option<PathBuf>,
    /// Initial position of its centre.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 60.0]])))]
    pub at: [f64; 3],
    /// Direction of the third axis of its shape; default +z.
    #[cfg_attr(feature = "cli", schemars(extend("default" = [0.0, 0.0, 1.0], "examples" = [[0.0, 1.0, 0.0]])))]
    pub orientation: Option<[f64; 3]>,
    /// Times and displacements from `at`, interpolated linearly.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then mesh unit", "examples" = [[[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 4.0]]])))]
    pub path: Option<Vec<[f64; 4]>>,
    /// CSV file with the path, relative to the scene file: a header `time_s,x,y,z` and numbers.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then mesh unit", "examples" = ["jaw.csv"])))]
    pub file: Option<PathBuf>,
    /// Times and angles in degrees, interpolated linearly.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "s, then degrees", "examples" = [[[0.0, 0.0], [0.5, 30.0]]])))]
    pub rotation: Option<Vec<[f64; 2]>>,
    /// Rotation axis, through its centre.
    #[cfg_attr(feature = "cli", schemars(extend("default" = [0.0, 0.0, 1.0], "examples" = [[0.0, 1.0, 0.0]])))]
    pub axis: Option<[f64; 3]>,
    /// Coulomb friction coefficient μ; default 0.
    #[cfg_attr(feature = "cli", schemars(extend("default" = 0.0, "minimum" = 0.0, "examples" = [0.3])))]
    pub friction: Option<f64>,
    /// Spring stiffness, N/m: makes the tool a dynamic rigid body whose centre of mass is coupled
    /// by a spring to the position on its path.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N/m", "exclusiveMinimum" = 0.0, "examples" = [500.0])))]
    pub spring_stiffness: Option<f64>,
    /// Largest force of the spring, N.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "N", "exclusiveMinimum" = 0.0, "examples" = [2.0])))]
    pub max_force: Option<f64>,
    /// Mass, kg: makes the tool a dynamic rigid body, free or on a spring. Default for a tool on a
    /// spring: the mass of its volume of water.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "kg", "exclusiveMinimum" = 0.0, "examples" = [0.05])))]
    pub mass: Option<f64>,
    /// Distance at which the contact barrier becomes active, close to the gap kept during contact;
    /// default: a small fraction of its size and of the mesh's edge length.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [0.02])))]
    pub gap: Option<f64>,
    /// Colour: red, green, blue, from 0 to 1; default grey.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = [[0.7, 0.75, 0.8]])))]
    pub colour: Option<[f32; 3]>,
    /// Opacity, from 0 (invisible) to 1 (opaque).
    #[cfg_attr(feature = "cli", schemars(extend("default" = 1.0, "minimum" = 0.0, "maximum" = 1.0, "examples" = [0.5])))]
    pub opacity: Option<f32>,
    /// Whether it is not drawn.
    #[serde(default)]
    pub hidden: bool,
    /// What is drawn in place of its shape.
    #[serde(skip)]
    pub drawn: Option<Arc<ToolSurface>>,
}

/// A surface that is drawn in place of a tool's shape, in the frame of the tool.
#[derive(Clone, Debug, Default)]
pub(crate) struct ToolSurface {
    pub mesh: TriMesh,
    /// Colour of each vertex.
    pub colours: Vec<[f32; 3]>,
}

/// A sphere.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct SphereEntry {
    /// Its radius.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [8.0])))]
    pub radius: f64,
}

/// A capsule: a cylinder with hemispherical ends.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct CapsuleEntry {
    /// Its radius.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "exclusiveMinimum" = 0.0, "examples" = [8.0])))]
    pub radius: f64,
    /// Length of the cylinder, without the ends.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "minimum" = 0.0, "examples" = [30.0])))]
    pub length: f64,
}

/// A box.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct BoxEntry {
    /// Edge lengths.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[20.0, 10.0, 4.0]])))]
    pub size: [f64; 3],
}

/// A plane.
#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct PlaneShapeEntry {}

#[cfg(feature = "identify")]
impl Scene {
    /// Returns the number of the tool of this name: its own, or `tool1`, `tool2` …
    ///
    /// # Errors
    /// [`Error::Input`] if it does not exist.
    pub(crate) fn tool_number(&self, name: &str) -> Result<usize> {
        let name_of = |(k, tool): (usize, &ToolEntry)| {
            let number = || format!("tool{}", k + 1);
            tool.name.clone().unwrap_or_else(number)
        };
        let names: Vec<String> = self.tool.iter().enumerate().map(name_of).collect();
        let found = names.iter().position(|own| own == name);
        found.ok_or_else(|| {
            Error::Input(format!(
                "the scene has no tool \"{name}\" ([[tool]] name); it has {}",
                match names.is_empty() {
                    true => "none".to_owned(),
                    false => names.join(", "),
                }
            ))
        })
    }

    /// Returns the coefficient of friction of a tool.
    ///
    /// # Errors
    /// [`Error::Input`] if it does not exist, or has no friction.
    pub(crate) fn tool_friction(&self, name: &str) -> Result<f64> {
        let tool = &self.tool[self.tool_number(name)?];
        tool.friction.filter(|own| *own > 0.0).ok_or_else(|| {
            Error::Input(format!(
                "tool \"{name}\" has no friction to begin with; set a first value ([[tool]] friction)"
            ))
        })
    }

    /// Sets the coefficient of friction of a tool, if it exists.
    pub(crate) fn set_tool_friction(&mut self, name: &str, coefficient: f64) {
        if let Ok(number) = self.tool_number(name) {
            self.tool[number].friction = Some(coefficient);
        }
    }
}
