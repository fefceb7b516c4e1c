//! How terms come into the passes that they are composed with: each binds what its file in
//! `shaders/terms` declares there.

use super::Body;
use crate::Result;
use crate::gpu::{Array, Gpu, Pass, PassBuilder};

/// The programs that terms are composed into.
#[derive(Clone, Copy)]
pub(super) enum Part<'a> {
    /// `physics/forces`.
    Forces,
    /// `physics/implicit_euler_begin`.
    System {
        /// What the matter keeps of the matrix, written here or before.
        matrix: &'a Array,
        /// Those at the beginning of the step.
        velocities: &'a Array,
    },
    /// `physics/implicit_euler_direction`.
    Product {
        /// What the matter keeps of the matrix.
        matrix: &'a Array,
        /// The preconditioner, and the blocks that terms add to nodes.
        blocks: &'a Array,
    },
}

/// A term as the GPU has it.
pub(super) trait GpuTerm {
    /// The name of its file in `shaders/terms`.
    fn name(&self) -> &'static str;

    /// Binds what that file declares in a program, in its order.
    fn bind<'a>(&'a self, pass: PassBuilder<'a>, part: Part<'a>) -> PassBuilder<'a>;

    /// What has to be done before forces are gathered at a state.
    ///
    /// # Errors
    /// What the device refuses.
    fn before_forces(
        &self,
        _gpu: &Gpu,
        _positions: &Array,
        _velocities: &Array,
        _status: &wgpu::Buffer,
    ) -> Result<Option<Pass>> {
        Ok(None)
    }

    /// Texels that it keeps of the matrix of an implicit step, for [`Part::System`].
    fn matrix_texels(&self) -> usize;

    /// Texels of its lists: what a visit of every node costs.
    fn texels(&self) -> u32;
}

impl Body {
    /// The term that resists deformation.
    pub(super) fn matter(&self) -> &dyn GpuTerm {
        match &self.elements {
            Some(elements) => elements,
            None => &self.springs,
        }
    }

    /// The shader `name`, composed with all terms but tools.
    pub(super) fn composed(&self, name: &str) -> String {
        self.named(name, self.matter().name())
    }

    /// The shader `name`, composed with all terms, and with tools where these count.
    pub(super) fn pressed(&self, name: &str, tools: bool) -> String {
        match tools && self.contact.is_some() {
            true => self.composed(name) + " contact",
            false => self.composed(name),
        }
    }

    /// The shader `name`, composed with `first` and the terms that act on each node by itself.
    pub(super) fn named(&self, name: &str, first: &str) -> String {
        let terms = self.terms().iter().map(|t| t.name());
        let words = [name, first].into_iter().chain(terms);
        words.collect::<Vec<_>>().join(" ")
    }

    /// Binds what all terms declare, in the order of [`Body::pressed`].
    pub(super) fn bind_pressed<'a>(
        &'a self,
        pass: PassBuilder<'a>,
        part: Part<'a>,
        tools: bool,
    ) -> PassBuilder<'a> {
        let pass = self.bind_terms(pass, part);
        match self.contact.as_ref().filter(|_| tools) {
            Some(contact) => contact.bind(pass),
            None => pass,
        }
    }

    /// Binds what all terms declare, in the order of [`Body::composed`].
    pub(super) fn bind_terms<'a>(
        &'a self,
        pass: PassBuilder<'a>,
        part: Part<'a>,
    ) -> PassBuilder<'a> {
        let pass = self.matter().bind(pass, part);
        match (&self.node_terms, part) {
            (None, _) => pass,
            (Some(_), Part::Product { blocks, .. }) => pass.read(blocks),
            (Some(numbers), _) => pass.read(numbers),
        }
    }
}
