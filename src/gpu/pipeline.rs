//! Descriptions of the pipelines that a device has created, to compile them with other drivers.

use super::Gpu;
use super::device::lock;

/// A pipeline that was created on a device: the composed shader and all that its compilation
/// depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct PipelineDescription {
    /// The composed shader, as for [`Shaders::compose`](super::Shaders::compose): a program and its terms.
    pub shader: String,
    /// Values of its override constants; others keep their defaults.
    pub constants: Vec<(String, f64)>,
    /// Formats of the colour attachments; empty for compute passes.
    pub targets: Vec<wgpu::TextureFormat>,
    /// Format of the depth attachment, if there is one.
    pub depth: Option<wgpu::TextureFormat>,
}

impl PipelineDescription {
    pub(super) fn new(shader: &str, constants: &[(&str, f64)]) -> PipelineDescription {
        let mut constants: Vec<_> = constants.iter().map(|(n, v)| (n.to_string(), *v)).collect();
        constants.sort_by(|a, b| a.0.cmp(&b.0));
        PipelineDescription {
            shader: shader.to_owned(),
            constants,
            targets: Vec::new(),
            depth: None,
        }
    }
}

impl Gpu {
    /// Returns the pipelines created on this device so far, each once, in order of creation.
    pub fn pipelines_created(&self) -> Vec<PipelineDescription> {
        lock(&self.pipelines().created).clone()
    }

    /// Notes a created pipeline.
    pub(super) fn note_pipeline(&self, made: PipelineDescription) {
        let mut created = lock(&self.pipelines().created);
        if !created.contains(&made) {
            created.push(made);
        }
    }
}
