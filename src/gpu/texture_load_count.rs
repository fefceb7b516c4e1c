//! Static count of the texture loads of a shader, which dominate the cost of its passes.

use super::shader::{Shaders, parsed};
use crate::Result;
use wgpu::naga::{Block, Expression, Function, Module, Statement};

impl Shaders {
    /// Counts the texture loads of one invocation of the shader `name`, optionally followed by names of
    /// terms: outside of all loops, per iteration of the outermost loops, of the loops nested in these,
    /// and so on. Counts both sides of a branch.
    ///
    /// # Errors
    /// As [`Shaders::parse`].
    pub fn texture_loads(name: &str) -> Result<Vec<u32>> {
        let module = parsed(name)?;
        let mut loads = vec![0];
        for entry in &module.entry_points {
            visit(
                &module,
                &entry.function,
                &entry.function.body,
                0,
                &mut loads,
            );
        }
        Ok(loads)
    }
}

fn visit(module: &Module, function: &Function, block: &Block, depth: usize, loads: &mut Vec<u32>) {
    for statement in block {
        match statement {
            Statement::Emit(range) => {
                let expressions = range.clone().map(|e| &function.expressions[e]);
                let found = expressions.filter(|e| matches!(e, Expression::ImageLoad { .. }));
                loads[depth] += found.count() as u32;
            }
            Statement::Block(inner) => visit(module, function, inner, depth, loads),
            Statement::If { accept, reject, .. } => {
                visit(module, function, accept, depth, loads);
                visit(module, function, reject, depth, loads);
            }
            Statement::Switch { cases, .. } => {
                for case in cases {
                    visit(module, function, &case.body, depth, loads);
                }
            }
            Statement::Loop {
                body, continuing, ..
            } => {
                if loads.len() == depth + 1 {
                    loads.push(0);
                }
                visit(module, function, body, depth + 1, loads);
                visit(module, function, continuing, depth + 1, loads);
            }
            Statement::Call { function, .. } => {
                let called = &module.functions[*function];
                visit(module, called, &called.body, depth, loads);
            }
            _ => {}
        }
    }
}
