//! Binds one skin to bodies of several resolutions, to switch between at run time.

use super::base::SkinBase;
use super::binding::{BaseMesh, BindingReport, vertex_texels};
use super::draw::Skin;
use crate::gpu::{Array, Texel};
use crate::skin::basis::VertexBinding;
use crate::{Error, Result};

/// Binding of a skin to one of its bodies.
pub(super) struct Level {
    carrier: SkinBase,
    bound: Vec<VertexBinding>,
    records: Array,
    binding: BindingReport,
}

impl Skin {
    /// Binds the skin to one more body with the same coordinates and unit, at rest and with the
    /// same mapping. Returns its level for [`Skin::set_level`]; the initial body is level 0.
    ///
    /// # Errors
    /// As [`Skin::new`]; [`Error::Input`] for a body surface, which has only one body.
    pub fn add_level(&mut self, carrier: &SkinBase) -> Result<usize> {
        if self.is_body_surface {
            return Err(Error::Input(
                "the surface of a body has a single level, the body itself; bind a separate surface to add levels".into(),
            ));
        }
        let (bound, binding) = BaseMesh::bind(
            &carrier.rest_mesh(),
            &self.vertices,
            &carrier.frame,
            self.mapping,
        )?;
        let texels = vertex_texels(&bound, &self.vertices);
        let level = Level {
            carrier: carrier.clone(),
            records: self.gpu.array_of("skin vertices", Texel::U32x4, &texels)?,
            bound,
            binding,
        };
        self.levels.push(Some(level));
        Ok(self.levels.len() - 1)
    }

    /// Switches to the body of `level`. Transfer positions and velocities between the bodies with
    /// [`BarycentricMap`](crate::mesh::BarycentricMap); the changes by a cut apply only to the
    /// level at which it was made.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown level.
    pub fn set_level(&mut self, level: usize) -> Result<()> {
        if level == self.level {
            return Ok(());
        }
        let count = self.levels.len();
        let Some(next) = self.levels.get_mut(level).and_then(Option::take) else {
            return Err(Error::Input(format!(
                "level {level} is out of range: the skin has {count} levels, counted from 0"
            )));
        };
        let kept = Level {
            carrier: std::mem::replace(&mut self.carrier, next.carrier),
            bound: std::mem::replace(&mut self.bound, next.bound),
            records: std::mem::replace(&mut self.records, next.records),
            binding: std::mem::replace(&mut self.report.binding, next.binding),
        };
        self.levels[self.level] = Some(kept);
        self.level = level;
        self.uncut_triangles = None;
        self.cull = None;
        // The clip planes depend on the frame of the new body.
        let inside = self.inside.clone();
        self.set_sections(&inside)
    }

    /// Returns the active level.
    pub fn level(&self) -> usize {
        self.level
    }
}
