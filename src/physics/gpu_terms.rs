//! How terms come into the passes that they are composed with: each binds what its file in
//! `shaders/terms` declares there.

use super::Body;
use crate::gpu::{Array, PassBuilder};

/// The programs that terms are composed into.
#[derive(Clone, Copy)]
pub(super) enum Part<'a> {
    /// `physics/forces`.
    Forces,
    /// `physics/implicit_euler_begin`: what the matter keeps of the matrix is written here.
    System(&'a Array),
    /// `physics/implicit_euler_direction`: read here, and the blocks that terms add to nodes.
    Product(&'a Array, &'a Array),
}

/// A term as the GPU has it.
pub(super) trait GpuTerm {
    /// The name of its file in `shaders/terms`.
    fn name(&self) -> &'static str;

    /// Binds what that file declares in a program, in its order.
    fn bind<'a>(&'a self, pass: PassBuilder<'a>, part: Part<'a>) -> PassBuilder<'a>;

    /// Texels that it keeps of the matrix of an implicit step, for [`Part::System`].
    fn matrix_texels(&self) -> usize;

    /// Texels of its lists: what a visit of every node costs.
    fn texels(&self) -> u32;
}

impl Body {
    /// The term that resists deformation.
    pub(super) fn matter(&self) -> &dyn GpuTerm {
        &self.springs
    }

    /// The shader `name`, composed with the terms.
    pub(super) fn composed(&self, name: &str) -> String {
        let terms = self.terms().iter().map(|t| t.name());
        [name, self.matter().name()]
            .into_iter()
            .chain(terms)
            .collect::<Vec<_>>()
            .join(" ")
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
            (Some(_), Part::Product(_, blocks)) => pass.read(blocks),
            (Some(numbers), _) => pass.read(numbers),
        }
    }
}
