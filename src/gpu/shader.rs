//! WGSL composition: `#import lib/tet` on a line of its own pulls in `shaders/lib/tet.wgsl`, once.
//!
//! A program may be composed with terms: names after its own, as in `physics/forces floor`. A line
//! after `#each` then stands once for each of them, with `TERM` and `INDEX` replaced by its name
//! and its place in the list; one after `#any` stands once if there are any.

use super::device::lock;
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex};
use wgpu::naga;

/// Every file under `shaders/`, embedded by `build.rs`: (name without extension, source).
const SHADERS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// Names of all shaders that can be prepared as a pass: everything outside `lib/` and `terms/`.
pub fn shader_names() -> impl Iterator<Item = &'static str> {
    SHADERS
        .iter()
        .map(|(name, _)| *name)
        .filter(|name| !name.starts_with("lib/") && !name.starts_with("terms/"))
}

/// The source of shader `name`, which the names of terms may follow, with its imports pasted in,
/// each once, where first asked for.
///
/// # Errors
/// [`Error::Gpu`] when the shader or one of its imports does not exist.
pub fn compose(name: &str) -> Result<String> {
    let mut words = name.split_whitespace();
    let program = words.next().unwrap_or_default();
    let mut composer = Composer {
        terms: words.collect(),
        pasted: Vec::new(),
        out: String::new(),
    };
    composer.paste(program, "the program")?;
    Ok(composer.out)
}

struct Composer<'a> {
    terms: Vec<&'a str>,
    pasted: Vec<String>,
    out: String,
}

impl Composer<'_> {
    fn paste(&mut self, name: &str, importer: &str) -> Result<()> {
        if self.pasted.iter().any(|p| p == name) {
            return Ok(());
        }
        self.pasted.push(name.to_owned());
        let Some((_, source)) = SHADERS.iter().find(|(n, _)| *n == name) else {
            return Err(Error::Gpu(format!(
                "there is no shaders/{name}.wgsl, which {importer} asks for"
            )));
        };
        for line in source.lines() {
            if let Some(line) = line.trim_start().strip_prefix("#each ") {
                for k in 0..self.terms.len() {
                    let line = line.replace("TERM", self.terms[k]);
                    self.line(&line.replace("INDEX", &format!("{k}u")), name)?;
                }
            } else if let Some(line) = line.trim_start().strip_prefix("#any ") {
                if !self.terms.is_empty() {
                    self.line(line, name)?;
                }
            } else {
                self.line(line, name)?;
            }
        }
        Ok(())
    }

    fn line(&mut self, line: &str, name: &str) -> Result<()> {
        if let Some(import) = line.trim().strip_prefix("#import ") {
            return self.paste(import.trim(), name);
        }
        self.out.push_str(line);
        self.out.push('\n');
        Ok(())
    }
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
