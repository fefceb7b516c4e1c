//! Regions: groups of nodes selected by position or by label.

use super::keywords::{check_fraction, fraction};
#[cfg(feature = "cli")]
use super::schema;
use crate::mesh::{Location, TetMesh};
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;
use std::fmt;

/// A group of nodes: those that satisfy all conditions given. Lengths are in the mesh's units.
///
/// ```toml
/// [[pin]]
/// axis = "z"              # by fractions of the bounds …
/// below = 0.05            # the lowest 5 %
///
/// [[pin]]
/// z_below = -0.6          # … or by a coordinate in the mesh's unit
/// x_above = 1.2
/// ```
#[derive(Clone, Debug, Default, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Region {
    /// Name of a pin of these nodes in reaction files; default `pin1`, `pin2` …
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["wall"])))]
    pub name: Option<String>,
    /// Inside the axis-aligned box between these corners.
    #[serde(rename = "box")]
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]]])))]
    pub inside: Option<[[f64; 3]; 2]>,
    /// Inside the sphere [x, y, z, radius].
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [[0.0, 0.0, 0.5, 0.1]])))]
    pub sphere: Option<[f64; 4]>,
    /// Axis of `below` and `above`: `x`, `y` or `z`.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["z"])))]
    pub axis: Option<Axis>,
    /// Below this fraction of the bounds along `axis`, from 0 to 1.
    #[serde(default, deserialize_with = "fraction")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::fraction", extend("minimum" = 0.0, "maximum" = 1.0, "examples" = [0.05])))]
    pub below: Option<f64>,
    /// Above this fraction of the bounds along `axis`, from 0 to 1.
    #[serde(default, deserialize_with = "fraction")]
    #[cfg_attr(feature = "cli", schemars(default, schema_with = "schema::fraction", extend("minimum" = 0.0, "maximum" = 1.0, "examples" = [0.05])))]
    pub above: Option<f64>,
    /// Largest x.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [-0.6])))]
    pub x_below: Option<f64>,
    /// Smallest x.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [-0.6])))]
    pub x_above: Option<f64>,
    /// Largest y.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [-0.6])))]
    pub y_below: Option<f64>,
    /// Smallest y.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [-0.6])))]
    pub y_above: Option<f64>,
    /// Largest z.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [-0.6])))]
    pub z_below: Option<f64>,
    /// Smallest z.
    #[cfg_attr(feature = "cli", schemars(extend("x-unit" = "mesh unit", "examples" = [-0.6])))]
    pub z_above: Option<f64>,
    /// Label or name of a region: nodes of its tetrahedra.
    #[cfg_attr(feature = "cli", schemars(extend("examples" = ["femur", 3])))]
    pub label: Option<LabelOrName>,
    /// These corners of elements, whatever else is given; not in files.
    #[serde(skip)]
    pub listed: Option<Vec<u32>>,
}

/// A region of a mesh: its value in the cell field `label`, or its name in the mesh.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(
    untagged,
    expecting = "a region must be given by its label (an integer) or its name"
)]
#[allow(missing_docs)]
pub(crate) enum LabelOrName {
    Label(i64),
    Name(String),
}

impl LabelOrName {
    /// Returns the label; a name is looked up among the regions of the mesh.
    ///
    /// # Errors
    /// [`Error::Input`] listing the names of the regions.
    pub fn label(&self, mesh: &TetMesh) -> Result<i64> {
        let name = match self {
            LabelOrName::Label(label) => return Ok(*label),
            LabelOrName::Name(name) => name,
        };
        mesh.region_label(name)
    }
}

/// A coordinate axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "cli", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

impl Region {
    /// Returns the nodes of `mesh` in this region, in order: of quadratic tets the corners in it and the
    /// middles of edges between them, so that it has the same faces as with linear tets; without any
    /// corner in it, the middles.
    ///
    /// # Errors
    /// [`Error::Input`] if the region is invalid or contains no node.
    pub fn nodes(&self, mesh: &TetMesh) -> Result<Vec<u32>> {
        if let Some(listed) = &self.listed {
            return Ok(mesh.nodes_between(listed.clone()));
        }
        self.check()?;
        let bounds = mesh.bounds();
        let labelled = match &self.label {
            Some(label) => Some(labelled_nodes(mesh, label.label(mesh)?)?),
            None => None,
        };
        let nodes: Vec<u32> = (0..mesh.nodes.len())
            .filter(|i| self.holds(mesh.nodes[*i], bounds))
            .filter(|i| labelled.as_ref().is_none_or(|l| l[*i]))
            .map(|i| i as u32)
            .collect();
        if nodes.is_empty() {
            return Err(Error::Input(format!(
                "the region {self} contains no node of the mesh (bounds {} to {})",
                bounds.0, bounds.1
            )));
        }
        Ok(mesh.nodes_between(nodes))
    }

    fn check(&self) -> Result<()> {
        let along = self.below.is_some() || self.above.is_some();
        if along != self.axis.is_some() {
            return Err(Error::Input(
                "a region along an axis must have `axis` and `below` or `above`".into(),
            ));
        }
        for share in [self.below, self.above].into_iter().flatten() {
            check_fraction(share)?;
        }
        let placed = self.places().iter().any(|(_, at)| at.is_some());
        if !along
            && !placed
            && self.inside.is_none()
            && self.sphere.is_none()
            && self.label.is_none()
        {
            return Err(Error::Input(
                "a region must have one of box, sphere, axis with below or above, x_below to z_above, label"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Returns its coordinate limits in the mesh's unit, by name: below and above for each axis.
    fn places(&self) -> [(&'static str, Option<f64>); 6] {
        [
            ("x_below", self.x_below),
            ("x_above", self.x_above),
            ("y_below", self.y_below),
            ("y_above", self.y_above),
            ("z_below", self.z_below),
            ("z_above", self.z_above),
        ]
    }

    /// Whether point `p` satisfies all conditions on its position.
    fn holds(&self, p: DVec3, (low, high): (DVec3, DVec3)) -> bool {
        let in_box = self.inside.is_none_or(|[a, b]| {
            let (a, b) = (DVec3::from(a), DVec3::from(b));
            p.cmpge(a.min(b)).all() && p.cmple(a.max(b)).all()
        });
        let in_sphere = self
            .sphere
            .is_none_or(|[x, y, z, r]| p.distance(DVec3::new(x, y, z)) <= r);
        let in_slab = self.axis.is_none_or(|axis| {
            let axis = axis as usize;
            let at = |f: f64| low[axis] + f * (high[axis] - low[axis]);
            self.below.is_none_or(|f| p[axis] <= at(f))
                && self.above.is_none_or(|f| p[axis] >= at(f))
        });
        let in_place = self.places().iter().enumerate().all(|(k, (_, at))| {
            at.is_none_or(|at| match k % 2 {
                0 => p[k / 2] <= at,
                _ => p[k / 2] >= at,
            })
        });
        in_box && in_sphere && in_slab && in_place
    }
}

/// Formats the region as in a scene file.
impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |numbers: &[f64]| {
            let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
            format!("[{}]", numbers.join(", "))
        };
        let axis = self
            .axis
            .map(|axis| ["\"x\"", "\"y\"", "\"z\""][axis as usize]);
        let label = self.label.as_ref().map(|label| match label {
            LabelOrName::Label(label) => label.to_string(),
            LabelOrName::Name(name) => format!("\"{name}\""),
        });
        let number = |x: Option<f64>| x.map(|x| x.to_string());
        let mut keys = vec![
            (
                "box",
                self.inside
                    .map(|b| format!("[{}, {}]", list(&b[0]), list(&b[1]))),
            ),
            ("sphere", self.sphere.map(|s| list(&s))),
            ("axis", axis.map(str::to_owned)),
            ("below", number(self.below)),
            ("above", number(self.above)),
        ];
        keys.extend(self.places().map(|(name, at)| (name, number(at))));
        keys.push(("label", label));
        let keys: Vec<String> = keys
            .into_iter()
            .filter_map(|(name, value)| Some(format!("{name} = {}", value?)))
            .collect();
        write!(f, "{{ {} }}", keys.join(", "))
    }
}

/// Returns the label of each tetrahedron.
pub(super) fn labels(mesh: &TetMesh) -> Result<&[f64]> {
    let field = mesh.field("label", Location::Cell);
    let field = field.or_else(|| mesh.region_field()).ok_or_else(|| {
        Error::Input(
            "a region by label requires a cell field of integer region labels, such as `label`; the mesh has none".into(),
        )
    })?;
    Ok(&field.values)
}

fn labelled_nodes(mesh: &TetMesh, label: i64) -> Result<Vec<bool>> {
    let mut chosen = vec![false; mesh.nodes.len()];
    for (tet, value) in mesh.tets.iter().zip(labels(mesh)?) {
        if *value == label as f64 {
            for v in tet {
                chosen[*v as usize] = true;
            }
        }
    }
    Ok(chosen)
}
