//! How terms come into the passes that they are composed with: each binds what its file in
//! `shaders/terms` declares there.

use crate::Result;
use crate::gpu::{Array, Gpu, Pass, PassBuilder};
use crate::physics::GpuBody;

/// The programs that terms are composed into.
#[derive(Clone, Copy)]
pub(in crate::physics) enum ProgramPart<'a> {
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
pub(in crate::physics) trait GpuTerm {
    /// The name of its file in `shaders/terms`.
    fn name(&self) -> &'static str;

    /// Binds what that file declares in a program, in its order.
    fn bind<'a>(&'a self, pass: PassBuilder<'a>, part: ProgramPart<'a>) -> PassBuilder<'a>;

    /// What has to be done before forces are gathered at a state.
    ///
    /// # Errors
    /// What the device refuses.
    fn prepare_forces(
        &self,
        _gpu: &Gpu,
        _positions: &Array,
        _velocities: &Array,
        _status: &wgpu::Buffer,
    ) -> Result<Option<Pass>> {
        Ok(None)
    }

    /// Texels that it keeps of the matrix of an implicit step, for [`ProgramPart::System`].
    fn matrix_texels(&self) -> usize;

    /// Texels of its lists: what a visit of every node costs.
    fn texels(&self) -> u32;
}

impl GpuBody {
    /// The term that resists deformation.
    pub(in crate::physics) fn material_term(&self) -> &dyn GpuTerm {
        match &self.elements {
            Some(elements) => elements,
            None => &self.springs,
        }
    }

    /// The shader `name`, composed with all terms but tools.
    pub(in crate::physics) fn shader_name(&self, name: &str) -> String {
        self.named(name, self.material_term().name())
    }

    /// The shader `name`, composed with all terms, and with tools where these count.
    pub(in crate::physics) fn shader_name_with_contact(&self, name: &str, tools: bool) -> String {
        match tools && self.contact.is_some() {
            true => self.shader_name(name) + " contact",
            false => self.shader_name(name),
        }
    }

    /// The shader `name`, composed with `first` and the terms that act on each node by itself.
    pub(in crate::physics) fn named(&self, name: &str, first: &str) -> String {
        let terms = self.terms().iter().map(|t| t.name());
        let words = [name, first].into_iter().chain(terms);
        words.collect::<Vec<_>>().join(" ")
    }

    /// Binds what all terms declare, in the order of [`GpuBody::shader_name_with_contact`].
    pub(in crate::physics) fn bind_pressed<'a>(
        &'a self,
        pass: PassBuilder<'a>,
        part: ProgramPart<'a>,
        tools: bool,
    ) -> PassBuilder<'a> {
        let pass = self.bind_terms(pass, part);
        match self.contact.as_ref().filter(|_| tools) {
            Some(contact) => contact.bind(pass),
            None => pass,
        }
    }

    /// Binds what all terms declare, in the order of [`GpuBody::shader_name`].
    pub(in crate::physics) fn bind_terms<'a>(
        &'a self,
        pass: PassBuilder<'a>,
        part: ProgramPart<'a>,
    ) -> PassBuilder<'a> {
        let pass = self.material_term().bind(pass, part);
        match (&self.node_terms, part) {
            (None, _) => pass,
            (Some(_), ProgramPart::Product { blocks, .. }) => pass.read(blocks),
            (Some(numbers), _) => pass.read(numbers),
        }
    }
}
