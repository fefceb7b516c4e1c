//! Unknowns: numbers of a scene, their bounds, and the scale on which they are adjusted.

use super::stiffness_grid::Variation;
use crate::scene::Scene;
use crate::{Error, Result};

/// Bounds of Young's modulus, Pa; of Poisson's ratio; of density, kg/m³; of the damping ratio; and of the
/// stiffness ratio of a lump.
const YOUNG_BOUNDS: [f64; 2] = [1.0, 1e11];
const POISSON_BOUNDS: [f64; 2] = [0.0, 0.495];
const DENSITY_BOUNDS: [f64; 2] = [1.0, 3e4];
const DAMPING_BOUNDS: [f64; 2] = [1e-4, 2.0];
const CONTRAST_BOUNDS: [f64; 2] = [0.02, 100.0];
/// Bounds of the diameter of a lump relative to the largest extent of the body.
const DIAMETER_BOUNDS: [f64; 2] = [0.01, 0.8];
/// Bounds of a component of gravity, m/s²; of a pressure, Pa; of the factors of a stiffness that varies; of a
/// coefficient of friction; and of the offset of the fingertip, relative to the largest extent.
const GRAVITY_BOUNDS: [f64; 2] = [-30.0, 30.0];
const PRESSURE_BOUNDS: [f64; 2] = [1e-3, 1e9];
const FACTOR_BOUNDS: [f64; 2] = [0.01, 100.0];
const FRICTION_BOUNDS: [f64; 2] = [1e-3, 10.0];
const OFFSET_BOUND: f64 = 0.1;
/// Changes that count as large: of Poisson's ratio, of a component of gravity, m/s², and of a position and an
/// offset relative to the largest extent.
const POISSON_SCALE: f64 = 0.1;
const GRAVITY_SCALE: f64 = 1.0;
const POSITION_SCALE: f64 = 0.1;
const OFFSET_SCALE: f64 = 0.02;
/// Values of a lump at the start: ratio of stiffnesses, and diameter relative to the largest extent.
const FIRST_CONTRAST: f64 = 2.0;
const FIRST_DIAMETER: f64 = 0.12;
/// Distance of a contrast from 1 that is hardly any.
const NO_CONTRAST: f64 = 0.02;

/// What an unknown is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Young's modulus of a tissue, or of what is no tissue.
    Young(Option<String>),
    /// Poisson's ratio of it.
    Poisson(Option<String>),
    /// Density of it.
    Density(Option<String>),
    /// Damping ratio of the body at the frequency of the scene.
    DampingRatio,
    /// A coordinate of the middle of a stiff or soft ball, in file units.
    LumpPosition(usize),
    /// Its diameter, in file units.
    LumpDiameter,
    /// The ratio of its stiffness to that of the tissue around it.
    LumpContrast,
    /// A component of gravity, m/s².
    Gravity(usize),
    /// A pressure of the scene, by its number, Pa.
    Pressure(usize),
    /// The coefficient of friction of a tool of the scene, by its name.
    ToolFriction(String),
    /// A component of how far the fingertip was from the stated places, in file units.
    FingerOffset(usize),
    /// A stiffness that varies, on a grid with cells of so many micrometres; stands for its nodes.
    StiffnessGrid(u64, Variation),
    /// The factor at a node of the grid.
    StiffnessNode(usize),
}

impl Kind {
    /// Whether it is a number of a lump.
    pub fn is_lump(&self) -> bool {
        matches!(
            self,
            Kind::LumpPosition(_) | Kind::LumpDiameter | Kind::LumpContrast
        )
    }

    /// Whether it is a number of a tool.
    pub fn is_of_tools(&self) -> bool {
        matches!(self, Kind::ToolFriction(_))
    }

    /// Whether derivatives by it are differences of predictions.
    pub fn by_differences(&self) -> bool {
        matches!(self, Kind::FingerOffset(_))
    }
}

/// A number of a scene that is identified.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// Its name, such as `material.fat.young`.
    pub name: String,
    pub(super) kind: Kind,
    /// Bounds; `None` for those of its kind.
    pub bounds: Option<[f64; 2]>,
    /// Value at the start; `None` for that of the scene.
    pub first: Option<f64>,
}

impl Unknown {
    /// Parses the name of an unknown: `material.young`, `material.TISSUE.young`, `material.poisson`,
    /// `material.TISSUE.poisson`, `material.density`, `material.TISSUE.density`, `material.damping_ratio`
    /// (at the scene's `damping_hz`); `lump`, a ball with another stiffness, for the five unknowns `lump.x`,
    /// `lump.y`, `lump.z`, `lump.diameter` and `lump.contrast`; `stiffness:cage:LENGTH`, factors of the stiffness
    /// on a grid with cells of that length (such as `8mm`), smooth, or with `:piecewise` behind it; `gravity.x`
    /// (`y`, `z`); `pressure.N`, the scene's pressure N, counted from 1; `tool.NAME.friction`, the coefficient of
    /// friction of a tool; or `finger.x` (`y`, `z`), how far the
    /// fingertip was from the stated places.
    ///
    /// # Errors
    /// [`Error::Input`] for another name.
    pub fn parse(name: &str) -> Result<Vec<Unknown>> {
        let one = |kind: Kind| {
            vec![Unknown {
                name: name.to_owned(),
                kind,
                bounds: None,
                first: None,
            }]
        };
        let words: Vec<&str> = name.split('.').collect();
        Ok(match words[..] {
            ["material", "young"] => one(Kind::Young(None)),
            ["material", "poisson"] => one(Kind::Poisson(None)),
            ["material", "density"] => one(Kind::Density(None)),
            ["material", "damping_ratio"] => one(Kind::DampingRatio),
            ["material", tissue, "density"] => one(Kind::Density(Some(tissue.to_owned()))),
            ["material", tissue, "young"] => one(Kind::Young(Some(tissue.to_owned()))),
            ["material", tissue, "poisson"] => one(Kind::Poisson(Some(tissue.to_owned()))),
            ["lump"] => {
                let parts = ["x", "y", "z", "diameter", "contrast"];
                let all = parts.map(|part| Unknown::parse(&format!("lump.{part}")));
                all.into_iter().collect::<Result<Vec<_>>>()?.concat()
            }
            ["lump", "x"] => one(Kind::LumpPosition(0)),
            ["lump", "y"] => one(Kind::LumpPosition(1)),
            ["lump", "z"] => one(Kind::LumpPosition(2)),
            ["lump", "diameter"] => one(Kind::LumpDiameter),
            ["lump", "contrast"] => one(Kind::LumpContrast),
            ["gravity", axis] if let Some(k) = axis_of(axis) => one(Kind::Gravity(k)),
            ["finger", axis] if let Some(k) = axis_of(axis) => one(Kind::FingerOffset(k)),
            ["tool", name, "friction"] => one(Kind::ToolFriction(name.to_owned())),
            ["pressure", number] if let Ok(n @ 1..) = number.parse::<usize>() => {
                one(Kind::Pressure(n - 1))
            }
            _ if let Some(grid) = grid_of(name) => one(grid),
            _ => {
                return Err(Error::Input(format!(
                    "unknown \"{name}\" cannot be identified; expected material.young, material.TISSUE.young, material.poisson, material.TISSUE.poisson, material.density, material.TISSUE.density, material.damping_ratio, lump, stiffness:cage:LENGTH (such as 8mm), gravity.x, pressure.1, tool.NAME.friction or finger.x"
                )));
            }
        })
    }
}

fn axis_of(name: &str) -> Option<usize> {
    ["x", "y", "z"].iter().position(|own| *own == name)
}

/// Parses `stiffness:cage:8mm` and `stiffness:cage:8mm:piecewise`.
fn grid_of(name: &str) -> Option<Kind> {
    let words: Vec<&str> = name.split(':').collect();
    let (length, variation) = match words[..] {
        ["stiffness", "cage", length] => (length, Variation::Smooth),
        ["stiffness", "cage", length, "smooth"] => (length, Variation::Smooth),
        ["stiffness", "cage", length, "piecewise"] => (length, Variation::Piecewise),
        _ => return None,
    };
    let units = [("mm", 1e3), ("cm", 1e4), ("m", 1e6)];
    let (number, micrometres) = units
        .iter()
        .find_map(|(unit, um)| Some((length.strip_suffix(unit)?, um)))?;
    let length = number.trim().parse::<f64>().ok()? * micrometres;
    (length.is_finite() && length >= 1.0).then_some(Kind::StiffnessGrid(length as u64, variation))
}

/// How θ depends on a value v.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Scale {
    /// θ = ln v.
    Logarithm,
    /// θ = v over a large change.
    Linear(f64),
    /// θ = ± ln(1 + |v − 1|/[`NO_CONTRAST`]). What a small lump changes is proportional to d³(v − 1), with its
    /// diameter d: such lumps are on a line of ln d and θ.
    Contrast,
}

/// An unknown with its bounds and first value in a body, and its scale.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ScaledUnknown {
    pub name: String,
    pub kind: Kind,
    pub bounds: [f64; 2],
    pub first: f64,
    /// Whether the first value was given.
    pub is_given: bool,
    scale: Scale,
}

impl ScaledUnknown {
    /// Completes an unknown of a scene, whose body has the bounds `low` and `high`.
    ///
    /// # Errors
    /// [`Error::Input`] for a tissue that the scene lacks, or bounds without the first value.
    pub fn new(
        unknown: &Unknown,
        scene: &Scene,
        (low, high): ([f64; 3], [f64; 3]),
    ) -> Result<ScaledUnknown> {
        let (bounds, first, scale) = defaults(&unknown.kind, scene, (low, high))?;
        let [least, most] = unknown.bounds.unwrap_or(bounds);
        let first = unknown.first.unwrap_or(first.clamp(least, most));
        let is_linear = matches!(scale, Scale::Linear(_));
        let positive = is_linear || least > 0.0;
        if !(least < most && positive && (least..=most).contains(&first) && most.is_finite()) {
            return Err(Error::Input(format!(
                "{} must start within its bounds, which must be increasing{}; got {first} in {least}..{most}",
                unknown.name,
                if is_linear { "" } else { " and positive" }
            )));
        }
        Ok(ScaledUnknown {
            name: unknown.name.clone(),
            kind: unknown.kind.clone(),
            bounds: [least, most],
            first,
            is_given: unknown.first.is_some(),
            scale,
        })
    }

    /// Returns θ of a value.
    pub fn theta(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Logarithm => value.ln(),
            Scale::Linear(large) => value / large,
            Scale::Contrast => {
                let more = value - 1.0;
                (more.abs() / NO_CONTRAST).ln_1p().copysign(more)
            }
        }
    }

    /// Returns the value of θ, within the bounds.
    pub fn value(&self, theta: f64) -> f64 {
        let value = match self.scale {
            Scale::Logarithm => theta.exp(),
            Scale::Linear(large) => theta * large,
            Scale::Contrast => 1.0 + (NO_CONTRAST * theta.abs().exp_m1()).copysign(theta),
        };
        value.clamp(self.bounds[0], self.bounds[1])
    }

    /// Returns the derivative of the value by θ.
    pub fn slope(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Logarithm => value,
            Scale::Linear(large) => large,
            Scale::Contrast => NO_CONTRAST + (value - 1.0).abs(),
        }
    }

    /// Whether intervals are factors: of the value, or of the distance of a contrast from 1.
    pub fn is_logarithmic(&self) -> bool {
        !matches!(self.scale, Scale::Linear(_))
    }

    /// Returns what intervals are factors of.
    pub fn factor_name(&self) -> String {
        match self.scale {
            Scale::Contrast => format!("|{} − 1|", self.name),
            Scale::Logarithm | Scale::Linear(_) => self.name.clone(),
        }
    }
}

/// Returns the bounds of a kind, its first value and its scale, in a body with the bounds `low` and `high`.
///
/// # Errors
/// [`Error::Input`] for a tissue, a pressure or gravity that the scene lacks.
fn defaults(
    kind: &Kind,
    scene: &Scene,
    (low, high): ([f64; 3], [f64; 3]),
) -> Result<([f64; 2], f64, Scale)> {
    let extent = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let defaults = match kind {
        Kind::Young(tissue) => (
            YOUNG_BOUNDS,
            scene.material.young_of(tissue.as_deref())?,
            Scale::Logarithm,
        ),
        Kind::Poisson(tissue) => (
            POISSON_BOUNDS,
            scene.material.poisson_of_tissue(tissue.as_deref())?,
            Scale::Linear(POISSON_SCALE),
        ),
        Kind::Density(tissue) => (
            DENSITY_BOUNDS,
            scene.material.density_of(tissue.as_deref())?,
            Scale::Logarithm,
        ),
        Kind::DampingRatio => (
            DAMPING_BOUNDS,
            scene.material.damping_ratio_at()?,
            Scale::Logarithm,
        ),
        Kind::LumpPosition(k) => (
            [low[*k], high[*k]],
            0.5 * (low[*k] + high[*k]),
            Scale::Linear(POSITION_SCALE * extent),
        ),
        Kind::LumpDiameter => (
            DIAMETER_BOUNDS.map(|x| x * extent),
            FIRST_DIAMETER * extent,
            Scale::Logarithm,
        ),
        Kind::LumpContrast => (CONTRAST_BOUNDS, FIRST_CONTRAST, Scale::Contrast),
        Kind::Gravity(k) => {
            let gravity = scene.solver.gravity.ok_or_else(|| {
                Error::Input(
                    "gravity is no entry of the scene; set its first value ([solver] gravity)"
                        .into(),
                )
            })?;
            (GRAVITY_BOUNDS, gravity[*k], Scale::Linear(GRAVITY_SCALE))
        }
        Kind::Pressure(n) => (
            PRESSURE_BOUNDS,
            scene.steady_pressure(*n)?,
            Scale::Logarithm,
        ),
        Kind::ToolFriction(name) => (
            FRICTION_BOUNDS,
            scene.tool_friction(name)?,
            Scale::Logarithm,
        ),
        Kind::FingerOffset(_) => {
            let most = OFFSET_BOUND * extent;
            ([-most, most], 0.0, Scale::Linear(OFFSET_SCALE * extent))
        }
        Kind::StiffnessGrid(..) | Kind::StiffnessNode(_) => (FACTOR_BOUNDS, 1.0, Scale::Logarithm),
    };
    Ok(defaults)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed() {
        let names = |name: &str| -> Vec<String> {
            let all = Unknown::parse(name).unwrap();
            all.into_iter().map(|unknown| unknown.name).collect()
        };
        assert_eq!(names("material.fat.young"), ["material.fat.young"]);
        assert_eq!(names("lump").len(), 5);
        let kind = |name: &str| Unknown::parse(name).unwrap()[0].kind.clone();
        let (smooth, piecewise) = (Variation::Smooth, Variation::Piecewise);
        assert_eq!(
            kind("stiffness:cage:8mm"),
            Kind::StiffnessGrid(8_000, smooth)
        );
        assert_eq!(
            kind("stiffness:cage:1.5cm:piecewise"),
            Kind::StiffnessGrid(15_000, piecewise)
        );
        assert_eq!(kind("pressure.2"), Kind::Pressure(1));
        assert_eq!(kind("gravity.z"), Kind::Gravity(2));
        let of_tool = Kind::ToolFriction("ground".into());
        assert_eq!(kind("tool.ground.friction"), of_tool);
        for wrong in [
            "",
            "young",
            "material.fat.damping_ratio",
            "lump.depth",
            "stiffness:cage:8",
            "stiffness:cage:-1mm",
            "stiffness:cage:8mm:odd",
            "pressure.0",
            "gravity.w",
            "tool.friction",
        ] {
            let why = Unknown::parse(wrong).unwrap_err().to_string();
            assert!(why.contains("expected material.young"), "{why}");
        }
    }
}
