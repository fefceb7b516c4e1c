//! What a shader loads from textures, which is most of what its passes cost.

use super::shader::parsed;
use crate::Result;
use serde::Serialize;
use wgpu::naga::{Block, Expression, Function, Module, Statement};

/// Texture loads of one invocation of a shader. Of both sides of a branch each is counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct TextureLoads {
    /// Outside of all loops.
    pub once: u32,
    /// In one round of each of its loops.
    pub a_round: u32,
}

/// The texture loads of the shader `name`, which the names of terms may follow.
///
/// # Errors
/// As [`parse`](super::parse).
pub fn texture_loads(name: &str) -> Result<TextureLoads> {
    let module = parsed(name)?;
    let mut loads = TextureLoads::default();
    for entry in &module.entry_points {
        loads.visit(&module, &entry.function, &entry.function.body, false);
    }
    Ok(loads)
}

impl TextureLoads {
    fn visit(&mut self, module: &Module, function: &Function, block: &Block, looped: bool) {
        for statement in block {
            match statement {
                Statement::Emit(range) => {
                    let expressions = range.clone().map(|e| &function.expressions[e]);
                    let loads = expressions.filter(|e| matches!(e, Expression::ImageLoad { .. }));
                    let count = if looped {
                        &mut self.a_round
                    } else {
                        &mut self.once
                    };
                    *count += loads.count() as u32;
                }
                Statement::Block(inner) => self.visit(module, function, inner, looped),
                Statement::If { accept, reject, .. } => {
                    self.visit(module, function, accept, looped);
                    self.visit(module, function, reject, looped);
                }
                Statement::Switch { cases, .. } => {
                    for case in cases {
                        self.visit(module, function, &case.body, looped);
                    }
                }
                Statement::Loop {
                    body, continuing, ..
                } => {
                    self.visit(module, function, body, true);
                    self.visit(module, function, continuing, true);
                }
                Statement::Call { function, .. } => {
                    let called = &module.functions[*function];
                    self.visit(module, called, &called.body, looped);
                }
                _ => {}
            }
        }
    }
}
