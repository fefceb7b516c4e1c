//! One skin on bodies of several resolutions, switched while running.

use super::base::SkinBase;
use super::binding::{BindingReport, bind, vertex_texels};
use super::draw::Skin;
use crate::gpu::{Array, Texel};
use crate::skin::basis::VertexBinding;
use crate::{Error, Result};

/// What a skin has for each body that can carry it.
pub(super) struct Level {
    carrier: SkinBase,
    bound: Vec<VertexBinding>,
    records: Array,
    binding: BindingReport,
}

impl Skin {
    /// Binds the skin to another body of the same place and unit as well, at rest and by the same
    /// mapping. Returns its level, to be switched to; the body it was made with is level 0.
    ///
    /// # Errors
    /// As [`Skin::new`]; [`Error::Input`] for a bare surface, which is one body's own.
    pub fn add_level(&mut self, carrier: &SkinBase) -> Result<usize> {
        if self.is_body_surface {
            return Err(Error::Input(
                "the bare surface of a body has one level: the body itself".into(),
            ));
        }
        let (bound, binding) = bind(
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

    /// Lets the body of `level` carry it from now on. Positions and velocities are carried from
    /// one body to the other by [`Transfer`](crate::mesh::Transfer); what a cut has changed holds
    /// for its own level alone.
    ///
    /// # Errors
    /// [`Error::Input`] for a level that there is not.
    pub fn set_level(&mut self, level: usize) -> Result<()> {
        if level == self.level {
            return Ok(());
        }
        let count = self.levels.len();
        let Some(next) = self.levels.get_mut(level).and_then(Option::take) else {
            return Err(Error::Input(format!(
                "the skin has no level {level}; there are {count}, counted from 0"
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
        // Planes in the frame of the new body.
        let inside = self.inside.clone();
        self.set_sections(&inside)
    }

    /// The level that carries it now.
    pub fn level(&self) -> usize {
        self.level
    }
}
