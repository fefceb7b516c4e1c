//! WGSL composition: a line `#import lib/tet` includes `shaders/lib/tet.wgsl`, once.
//!
//! A program may be composed with terms: names of files in `shaders/terms` after its own, as in
//! `physics/forces springs floor`.
//!
//! - `#term KIND`, in the file of a term, states its kind: `matter` (gathers over the neighbourhood
//!   of a node), `law` (constitutive model of a tetrahedron), `rigid` (nodes that move as rigid
//!   bodies), `node` (acts on each node independently), `contact` (contact with tools); for ray
//!   traversal `reads` (mesh access), `table` (look-up of the ray integral), `scan` (scan data of
//!   the mesh), or `intervals` (outputs each ray segment separately).
//! - `#for PROGRAM …`, in the file of a term: the following lines, up to the next `#for`, are
//!   included in these programs only; after `#for all` in every program.
//! - `#each KIND LINE`: includes the line once for each term of the kind, with `TERM` and `INDEX`
//!   replaced by its name and its index among those of its kind.
//! - `#any KIND LINE`: includes the line once if there is any term of the kind.
//! - `@binding(next)`: the next binding after all numbered ones, in source order. So a term can
//!   declare its bindings independently of the composition.

use super::device::lock;
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError, RwLock};
use wgpu::naga;

/// All files under `shaders/`, embedded by `build.rs`: (name without extension, source).
const SHADERS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// Kinds of terms, in the order of their names in a composition.
const KINDS: [&str; 9] = [
    "matter",
    "law",
    "rigid",
    "node",
    "contact",
    "reads",
    "table",
    "scan",
    "intervals",
];

/// Marker of a binding that is numbered automatically.
const NEXT_BINDING: &str = "@binding(next)";

/// Shaders added by the application, as [`SHADERS`].
static ADDED: RwLock<Vec<(&str, &str)>> = RwLock::new(Vec::new());

fn source(name: &str) -> Option<&'static str> {
    let own = SHADERS.iter().find(|(n, _)| *n == name);
    own.map(|s| s.1).or_else(|| added(name))
}

fn added(name: &str) -> Option<&'static str> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    added.iter().find(|(n, _)| *n == name).map(|s| s.1)
}

/// The shaders by name: those of the library, and those added by the application. A name may be
/// followed by names of terms, as in `physics/forces springs floor`.
#[derive(Clone, Copy, Debug)]
pub struct Shaders;

impl Shaders {
    /// Adds a custom shader: `room/name` becomes a program for [`Gpu::pass`](super::Gpu::pass),
    /// `terms/name` an energy term that a [`NodeTerm`](crate::physics::NodeTerm) can name, and
    /// `lib/name` a file for `#import`. It may `#import` everything in `shaders/lib`, and is kept until
    /// the process ends. Adding identical source again does nothing.
    ///
    /// # Errors
    /// [`Error::Input`] for a name that is taken or invalid; [`Error::Gpu`] with the position for WGSL
    /// that does not parse.
    pub fn add(name: &str, source: &str) -> Result<()> {
        let mut parts = name.split('/');
        let part = |p: &str| !p.is_empty() && p.chars().all(|c| c.is_alphanumeric() || c == '_');
        if parts.clone().count() != 2 || !parts.all(part) {
            return Err(Error::Input(format!(
                "invalid shader name {name:?}: expected a folder and a name of letters, digits and \
            underscores, for example my_app/leapfrog"
            )));
        }
        if SHADERS.iter().any(|(n, _)| *n == name) || added(name).is_some_and(|s| s != source) {
            return Err(Error::Input(format!(
                "shader {name} already exists with another source; choose another name"
            )));
        }
        if added(name).is_some() {
            return Ok(());
        }
        let mut all = ADDED.write().unwrap_or_else(PoisonError::into_inner);
        all.push((name.to_owned().leak(), source.to_owned().leak()));
        drop(all);
        let alone = !name.starts_with("lib/") && !name.starts_with("terms/");
        if let Err(error) = alone.then(|| Shaders::parse(name)).transpose() {
            let mut all = ADDED.write().unwrap_or_else(PoisonError::into_inner);
            all.retain(|(n, _)| *n != name);
            return Err(error);
        }
        Ok(())
    }

    /// Returns the names of all shaders that can be prepared as a pass: everything outside `lib/` and
    /// `terms/`, composed with each required term, and with and without each optional kind: rigid
    /// bodies, node terms, tools, scans and ray segments.
    pub fn names() -> impl Iterator<Item = String> {
        let programs = SHADERS.iter().map(|(name, _)| *name);
        programs
            .filter(|name| !name.starts_with("lib/") && !name.starts_with("terms/"))
            .flat_map(test_compositions)
    }
}

/// Returns the compositions of `program` to test.
fn test_compositions(program: &str) -> Vec<String> {
    let mut names = vec![program.to_owned()];
    for kind in KINDS {
        if !accepts_kind(program, kind) {
            continue;
        }
        let fitting: Vec<&str> = terms(kind).filter(|t| applies_to(t, program)).collect();
        let alone = match kind {
            "rigid" | "node" | "contact" | "scan" | "intervals" => names.clone(),
            // Kinds required by a program.
            _ => Vec::new(),
        };
        // Segment output does not depend on the table, and does not support scans: one combination
        // suffices.
        let table = terms("table").next();
        let alike = |name: &str| {
            let mut terms = name.split(' ');
            kind != "intervals"
                || (terms.clone().any(|t| Some(t) == table) && terms.all(|t| t != "scan"))
        };
        let with = names.iter().filter(|name| alike(name)).flat_map(|name| {
            let terms = fitting.iter();
            terms.map(move |term| format!("{name} {term}"))
        });
        names = alone.into_iter().chain(with).collect();
    }
    names
}

/// Whether a program has lines for terms of a kind.
fn accepts_kind(program: &str, kind: &str) -> bool {
    let lines = source(program).unwrap_or_default().lines();
    let each = format!("#each {kind} ");
    let any = format!("#any {kind} ");
    lines
        .map(str::trim_start)
        .any(|l| l.starts_with(&each) || l.starts_with(&any))
}

/// Returns the built-in terms of a kind.
fn terms(kind: &str) -> impl Iterator<Item = &'static str> {
    let names = SHADERS.iter().filter_map(|(n, _)| n.strip_prefix("terms/"));
    names.filter(move |name| kind_of(name) == Some(kind))
}

/// Whether a term contributes lines to `program`.
fn applies_to(term: &str, program: &str) -> bool {
    let source = source(&format!("terms/{term}")).unwrap_or_default();
    let mut parts = source.lines().filter_map(|l| l.strip_prefix("#for "));
    let limited = source.lines().any(|l| l.starts_with("#for "));
    !limited || parts.any(|p| p.split_whitespace().any(|p| p == program))
}

/// Returns the kind of a term.
fn kind_of(term: &str) -> Option<&'static str> {
    let source = source(&format!("terms/{term}"))?;
    source
        .lines()
        .find_map(|l| l.strip_prefix("#term "))
        .map(str::trim)
}

impl Shaders {
    /// Returns the source of shader `name`, optionally followed by names of terms, with its imports
    /// included, each once, at the first `#import`.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the shader, one of its terms or one of its imports does not exist.
    pub fn compose(name: &str) -> Result<String> {
        let mut words = name.split_whitespace();
        let program = words.next().unwrap_or_default();
        let mut terms = Vec::new();
        for term in words {
            let kind = kind_of(term).filter(|kind| KINDS.contains(kind));
            let Some(kind) = kind else {
                return Err(Error::Gpu(format!(
                    "cannot compose {program} with term {term}: shaders/terms/{term}.wgsl does not \
                exist or has no `#term` line with a known kind"
                )));
            };
            terms.push((kind, term));
        }
        let mut composer = Composer {
            program,
            terms,
            pasted: Vec::new(),
            out: String::new(),
        };
        composer.import_source(program, "the composed program")?;
        Ok(assign_bindings(&composer.out))
    }
}

/// Assigns numbers to the bindings marked `next`.
fn assign_bindings(source: &str) -> String {
    let given = source.split("@binding(").skip(1);
    let given = given.filter_map(|rest| rest.split(')').next()?.parse::<u32>().ok());
    let next = given.max().map_or(0, |most| most + 1);
    let mut parts = source.split(NEXT_BINDING);
    let mut out = parts.next().unwrap_or_default().to_owned();
    for (n, part) in (next..).zip(parts) {
        out.push_str(&format!("@binding({n})"));
        out.push_str(part);
    }
    out
}

struct Composer<'a> {
    program: &'a str,
    /// Kind and name.
    terms: Vec<(&'a str, &'a str)>,
    pasted: Vec<String>,
    out: String,
}

impl Composer<'_> {
    fn import_source(&mut self, name: &str, importer: &str) -> Result<()> {
        if self.pasted.iter().any(|p| p == name) {
            return Ok(());
        }
        self.pasted.push(name.to_owned());
        let Some(source) = source(name) else {
            return Err(Error::Gpu(format!(
                "shaders/{name}.wgsl does not exist, but is required by {importer}"
            )));
        };
        let mut here = true;
        for line in source.lines() {
            let bare = line.trim_start();
            if let Some(programs) = bare.strip_prefix("#for ") {
                let mut programs = programs.split_whitespace();
                here = programs.any(|p| p == "all" || p == self.program);
            } else if !here || bare.starts_with("#term ") {
                continue;
            } else if let Some((kind, line)) = split_kind(bare, "#each ") {
                self.each(kind, line, name)?;
            } else if let Some((kind, line)) = split_kind(bare, "#any ") {
                if self.terms.iter().any(|t| t.0 == kind) {
                    self.line(line, name)?;
                }
            } else {
                self.line(line, name)?;
            }
        }
        Ok(())
    }

    /// Emits a line once for each term of a kind.
    fn each(&mut self, kind: &str, line: &str, name: &str) -> Result<()> {
        let terms = self.terms.iter().filter(|t| t.0 == kind);
        let terms: Vec<String> = terms.map(|t| t.1.to_owned()).collect();
        for (k, term) in terms.iter().enumerate() {
            let line = line.replace("TERM", term);
            self.line(&line.replace("INDEX", &format!("{k}u")), name)?;
        }
        Ok(())
    }

    fn line(&mut self, line: &str, name: &str) -> Result<()> {
        if let Some(import) = line.trim().strip_prefix("#import ") {
            return self.import_source(import.trim(), name);
        }
        self.out.push_str(line);
        self.out.push('\n');
        Ok(())
    }
}

/// Splits a line that begins with `directive` into the kind and the rest.
fn split_kind<'a>(line: &'a str, directive: &str) -> Option<(&'a str, &'a str)> {
    line.strip_prefix(directive)?.split_once(' ')
}

impl Shaders {
    /// Parses the composed shader `name` with naga.
    ///
    /// # Errors
    /// [`Error::Gpu`] with the position in the composed source if it does not parse.
    pub fn parse(name: &str) -> Result<naga::Module> {
        let source = Shaders::compose(name)?;
        naga::front::wgsl::parse_str(&source).map_err(|e| {
            Error::Gpu(format!(
                "shaders/{name}.wgsl: {}",
                e.emit_to_string(&source)
            ))
        })
    }
}

/// Cache of parsed shaders, so that each is parsed only once.
static PARSED: LazyLock<Mutex<HashMap<String, Arc<naga::Module>>>> = LazyLock::new(Mutex::default);

/// As [`Shaders::parse`], cached by name.
pub(super) fn parsed(name: &str) -> Result<Arc<naga::Module>> {
    if let Some(known) = lock(&PARSED).get(name) {
        return Ok(known.clone());
    }
    let module = Arc::new(Shaders::parse(name)?);
    lock(&PARSED).insert(name.to_owned(), module.clone());
    Ok(module)
}
