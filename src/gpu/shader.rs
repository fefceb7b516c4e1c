//! WGSL composition: `#import lib/tet` on a line of its own pulls in `shaders/lib/tet.wgsl`, once.

use super::device::lock;
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex};
use wgpu::naga;

/// Every file under `shaders/`, embedded by `build.rs`: (name without extension, source).
const SHADERS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// Names of all shaders that can be prepared as a pass: everything outside `lib/`.
pub fn shader_names() -> impl Iterator<Item = &'static str> {
    SHADERS
        .iter()
        .map(|(name, _)| *name)
        .filter(|name| !name.starts_with("lib/"))
}

/// The source of shader `name` with its imports pasted in, each once, where first asked for.
///
/// # Errors
/// [`Error::Gpu`] when the shader or one of its imports does not exist.
pub fn compose(name: &str) -> Result<String> {
    let mut composed = String::new();
    paste(name, "the program", &mut Vec::new(), &mut composed)?;
    Ok(composed)
}

fn paste(name: &str, importer: &str, pasted: &mut Vec<String>, out: &mut String) -> Result<()> {
    if pasted.iter().any(|p| p == name) {
        return Ok(());
    }
    pasted.push(name.to_owned());
    let Some((_, source)) = SHADERS.iter().find(|(n, _)| *n == name) else {
        return Err(Error::Gpu(format!(
            "there is no shaders/{name}.wgsl, which {importer} asks for"
        )));
    };
    for line in source.lines() {
        match line.trim().strip_prefix("#import ") {
            Some(import) => paste(import.trim(), name, pasted, out)?,
            None => {
                out.push_str(line);
                out.push('\n');
            }
        }
    }
    Ok(())
}

/// The composed shader `name` as naga sees it.
///
/// # Errors
/// [`Error::Gpu`] with the place in the composed source when it does not parse.
pub fn parse(name: &str) -> Result<naga::Module> {
    let source = compose(name)?;
    naga::front::wgsl::parse_str(&source).map_err(|e| {
        Error::Gpu(format!(
            "shaders/{name}.wgsl: {}",
            e.emit_to_string(&source)
        ))
    })
}

/// Shaders parsed so far: a pass prepared anew need not parse its shader again.
static PARSED: LazyLock<Mutex<HashMap<String, Arc<naga::Module>>>> = LazyLock::new(Mutex::default);

/// [`parse`], once for each name.
pub(super) fn parsed(name: &str) -> Result<Arc<naga::Module>> {
    if let Some(known) = lock(&PARSED).get(name) {
        return Ok(known.clone());
    }
    let module = Arc::new(parse(name)?);
    lock(&PARSED).insert(name.to_owned(), module.clone());
    Ok(module)
}
