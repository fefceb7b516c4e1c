//! WGSL composition: `#import lib/tet` on a line of its own pulls in `shaders/lib/tet.wgsl`, once.
//!
//! A program may be composed with terms: names of files in `shaders/terms` after its own, as in
//! `physics/forces springs floor`.
//!
//! - `#term KIND`, in the file of a term, says what it is: `matter`, which gathers over what is
//!   around a node, `law`, by which a tet resists, `rigid`, by which nodes move together, `node`,
//!   which acts on each node by itself, `contact`, tools that press; of walks `reads`, how they read
//!   the mesh, `table`, by which they look up what a ray passes, `scan`, what the mesh carries, or `intervals`,
//!   which tells each way through the mesh by itself.
//! - `#for PROGRAM …`, in the file of a term: what follows, up to the next such line, stands in
//!   these programs only; after `#for all` in every one.
//! - `#each KIND LINE`: the line stands once for each term of the kind, with `TERM` and `INDEX`
//!   replaced by its name and its place among those of its kind.
//! - `#any KIND LINE`: the line stands once if there are any.
//! - `@binding(next)`: the binding after all that are numbered, in the order in which they stand.
//!   So a term declares what it reads, whatever it is composed with.

use super::device::lock;
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError, RwLock};
use wgpu::naga;

/// Every file under `shaders/`, embedded by `build.rs`: (name without extension, source).
const SHADERS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// The kinds of terms, in the order in which their names stand.
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

/// What the number of a binding is where it follows from those before.
const NEXT_BINDING: &str = "@binding(next)";

/// Shaders of the program that uses the library, as [`SHADERS`].
static ADDED: RwLock<Vec<(&str, &str)>> = RwLock::new(Vec::new());

fn source(name: &str) -> Option<&'static str> {
    let own = SHADERS.iter().find(|(n, _)| *n == name);
    own.map(|s| s.1).or_else(|| added(name))
}

fn added(name: &str) -> Option<&'static str> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    added.iter().find(|(n, _)| *n == name).map(|s| s.1)
}

/// Adds a shader of one's own: `room/name` is then a program for [`Gpu::pass`](super::Gpu::pass),
/// `terms/name` a term of the energy that one of [`NodeTerm`](crate::physics::NodeTerm) names, and
/// `lib/name` what `#import` pastes. It may `#import` all of the library's `shaders/lib`, and is
/// kept as long as the program runs. Adding the same again does nothing.
///
/// # Errors
/// [`Error::Input`] for a name that is taken or is none; [`Error::Gpu`] with the place for WGSL
/// that does not parse.
pub fn add_shader(name: &str, source: &str) -> Result<()> {
    let mut parts = name.split('/');
    let part = |p: &str| !p.is_empty() && p.chars().all(|c| c.is_alphanumeric() || c == '_');
    if parts.clone().count() != 2 || !parts.all(part) {
        return Err(Error::Input(format!(
            "a shader cannot be called {name:?}; give it a room and a name of letters and digits, as in my_app/leapfrog"
        )));
    }
    if SHADERS.iter().any(|(n, _)| *n == name) || added(name).is_some_and(|s| s != source) {
        return Err(Error::Input(format!(
            "there is a shader {name} already, and another source is given for it; choose another name"
        )));
    }
    if added(name).is_some() {
        return Ok(());
    }
    let mut all = ADDED.write().unwrap_or_else(PoisonError::into_inner);
    all.push((name.to_owned().leak(), source.to_owned().leak()));
    drop(all);
    let alone = !name.starts_with("lib/") && !name.starts_with("terms/");
    if let Err(error) = alone.then(|| parse(name)).transpose() {
        let mut all = ADDED.write().unwrap_or_else(PoisonError::into_inner);
        all.retain(|(n, _)| *n != name);
        return Err(error);
    }
    Ok(())
}

/// Names of all shaders that can be prepared as a pass: everything outside `lib/` and `terms/`,
/// with everything that it cannot do without and can be composed with, with rigid bodies or without,
/// with each of the terms that act on nodes or without, with tools or without, with scans or without,
/// and with ways told by themselves or without.
pub fn shader_names() -> impl Iterator<Item = String> {
    let programs = SHADERS.iter().map(|(name, _)| *name);
    programs
        .filter(|name| !name.starts_with("lib/") && !name.starts_with("terms/"))
        .flat_map(test_compositions)
}

/// The compositions of `program` that are worth a look.
fn test_compositions(program: &str) -> Vec<String> {
    let mut names = vec![program.to_owned()];
    for kind in KINDS {
        if !accepts_kind(program, kind) {
            continue;
        }
        let fitting: Vec<&str> = terms(kind).filter(|t| applies_to(t, program)).collect();
        let alone = match kind {
            "rigid" | "node" | "contact" | "scan" | "intervals" => names.clone(),
            // These a program cannot do without.
            _ => Vec::new(),
        };
        // Ways are told alike whatever the table is, and of scans none are.
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

/// The terms of a kind that there are.
fn terms(kind: &str) -> impl Iterator<Item = &'static str> {
    let names = SHADERS.iter().filter_map(|(n, _)| n.strip_prefix("terms/"));
    names.filter(move |name| kind_of(name) == Some(kind))
}

/// Whether a term has anything to say in `program`.
fn applies_to(term: &str, program: &str) -> bool {
    let source = source(&format!("terms/{term}")).unwrap_or_default();
    let mut parts = source.lines().filter_map(|l| l.strip_prefix("#for "));
    let limited = source.lines().any(|l| l.starts_with("#for "));
    !limited || parts.any(|p| p.split_whitespace().any(|p| p == program))
}

/// The kind of a term.
fn kind_of(term: &str) -> Option<&'static str> {
    let source = source(&format!("terms/{term}"))?;
    source
        .lines()
        .find_map(|l| l.strip_prefix("#term "))
        .map(str::trim)
}

/// The source of shader `name`, which the names of terms may follow, with its imports pasted in,
/// each once, where first asked for.
///
/// # Errors
/// [`Error::Gpu`] when the shader, one of its terms or one of its imports does not exist.
pub fn compose(name: &str) -> Result<String> {
    let mut words = name.split_whitespace();
    let program = words.next().unwrap_or_default();
    let mut terms = Vec::new();
    for term in words {
        let kind = kind_of(term).filter(|kind| KINDS.contains(kind));
        let Some(kind) = kind else {
            return Err(Error::Gpu(format!(
                "there is no shaders/terms/{term}.wgsl that says which kind of term it is, which {program} is composed with"
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
    composer.import_source(program, "the program")?;
    Ok(assign_bindings(&composer.out))
}

/// Numbers the bindings that say `next`.
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
                "there is no shaders/{name}.wgsl, which {importer} asks for"
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

    /// A line once for each term of a kind.
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

/// The kind and the rest of a line that begins with `directive`.
fn split_kind<'a>(line: &'a str, directive: &str) -> Option<(&'a str, &'a str)> {
    line.strip_prefix(directive)?.split_once(' ')
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
