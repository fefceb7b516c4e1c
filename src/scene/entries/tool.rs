//! Contact: tools, and of a body with itself.

use serde::Deserialize;
use std::path::PathBuf;

/// Contact of the body with itself: of its pieces with each other, and of its folds. A body of finite
/// elements on the processor's engine, stepped by `implicit` or `bdf2`.
///
/// ```toml
/// [contact]
/// friction = 0.3          # 0 where nothing is said
/// gap = 0.2               # in the mesh's unit: from there on parts push each other
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactEntry {
    /// μ of Coulomb friction; 0 where nothing is said.
    pub friction: Option<f64>,
    /// The gap from which on parts push each other; a 20th of the boundary's mean edge where nothing
    /// is said.
    pub gap: Option<f64>,
}

/// A tool: a rigid shape that presses on the body, which nothing of it passes through. It goes along
/// a path, or is a rigid body that moves as forces have it (anything but a plane, with
/// `[contact]`), and is drawn with the body. A body of finite elements on the processor's engine, stepped
/// by `implicit` or `bdf2`.
///
/// ```toml
/// [[tool]]
/// name = "finger"         # in files of reactions; `tool1` and so on where nothing is said
/// sphere = { radius = 8.0 }       # in the mesh's unit; or one of these:
/// # capsule = { radius = 5.0, length = 30.0 }   # `length` without the caps
/// # box = { size = [20.0, 10, 4] }
/// # plane = {}                    # all on one side of it
/// # surface = "probe.stl"         # any closed surface, in its own coordinates
/// at = [0.0, 0, 60]       # its middle, or the origin of the surface's coordinates
/// along = [0.0, 0, 1]     # the axis of a capsule, the third edge of a box, the normal of a plane
/// path = [[0.0, 0, 0, 0], [0.5, 0, 0, -10]]     # time in s, and how far it has moved
/// # file = "path.csv"     # or a table with the columns time_s,x,y,z
/// turn = [[0.0, 0], [0.5, 30]]    # time in s, and degrees …
/// axis = [0.0, 1, 0]      # … about this axis through its middle
/// friction = 0.3
/// # spring = 500.0        # N/m: `path` is where a hand goes that holds it by this spring …
/// # limit = 2.0           # … and lets it be pushed back by more than this force, N
/// # mass = 0.05           # kg, of a tool on a spring; or without one of a free rigid body
/// colour = [0.7, 0.75, 0.8]
/// # opacity = 0.5
/// # hidden = true         # it presses, and is not drawn
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolEntry {
    /// What it is called in files of reactions.
    pub name: Option<String>,
    /// A ball.
    pub sphere: Option<SphereEntry>,
    /// A cylinder with rounded ends.
    pub capsule: Option<CapsuleEntry>,
    /// A box.
    #[serde(rename = "box")]
    pub cuboid: Option<BoxEntry>,
    /// A plane: all below it.
    pub plane: Option<PlaneShapeEntry>,
    /// A closed surface, beside the scene file: edges are rounded by a 64th of its extent.
    pub surface: Option<PathBuf>,
    /// Where its middle is at first.
    pub at: [f64; 3],
    /// Where the third axis of its shape points; +z where nothing is said.
    pub along: Option<[f64; 3]>,
    /// Times and displacements from `at`, linear between them.
    pub path: Option<Vec<[f64; 4]>>,
    /// A CSV file of the same, beside the scene file: a header `time_s,x,y,z` and numbers.
    pub file: Option<PathBuf>,
    /// Times and angles in degrees, linear between them.
    pub turn: Option<Vec<[f64; 2]>>,
    /// What it turns about, through its middle.
    pub axis: Option<[f64; 3]>,
    /// μ of Coulomb friction; 0 where nothing is said.
    pub friction: Option<f64>,
    /// N/m: it is a rigid body, held at its centre of mass by a spring to where its path goes.
    pub spring: Option<f64>,
    /// The largest force of that spring, N.
    pub limit: Option<f64>,
    /// kg: it is a rigid body, free or on a spring; that of as much water on a spring where nothing
    /// is said.
    pub mass: Option<f64>,
    /// The gap from which on it pushes, which it keeps nearly where it presses: a small part of its
    /// size and of the mesh's edges where nothing is said.
    pub gap: Option<f64>,
    /// Red, green, blue, from 0 to 1; grey where nothing is said.
    pub colour: Option<[f32; 3]>,
    /// From 0, invisible, to 1, opaque.
    pub opacity: Option<f32>,
    /// Whether it is left out of pictures.
    #[serde(default)]
    pub hidden: bool,
}

/// A ball.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereEntry {
    /// Its radius.
    pub radius: f64,
}

/// A cylinder with rounded ends.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CapsuleEntry {
    /// Its radius.
    pub radius: f64,
    /// Of the cylinder, without the ends.
    pub length: f64,
}

/// A box.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxEntry {
    /// Its edges.
    pub size: [f64; 3],
}

/// A plane.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneShapeEntry {}
