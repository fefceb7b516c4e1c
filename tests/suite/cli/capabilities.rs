//! Which engine supports which entry of a scene, tried out, as a page of the reference.

use super::book::check_page;
use crate::support::gpu;
use palpate::scene::{Scene, Stage};
use std::path::Path;

/// Name of a column, and what it changes in a scene.
const COLUMNS: [(&str, &str, &str); 6] = [
    ("CPU, order 1", "engine = \"cpu\"", ""),
    ("CPU, order 2", "engine = \"cpu\"", "order = 2"),
    ("GPU", "engine = \"gpu\"", ""),
    (RAPIER, "engine = \"rapier\"", ""),
    ("`[grid]`", "engine = \"cpu\"", ""),
    ("`[cage]`", "engine = \"cpu\"", ""),
];
const RAPIER: &str = "rapier";

/// A row: its name, the solver, keys of `[material]`, and tables.
type Row = (&'static str, &'static str, &'static str, &'static str);

const PIN: &str = "[[pin]]\naxis = \"z\"\nbelow = 0.01\n";
const IMPLICIT: &str = "implicit";

const ROWS: &[Row] = &[
    ("gravity, `[[pin]]`", IMPLICIT, "", PIN),
    ("`[solver] name = \"bdf2\"`", "bdf2", "", PIN),
    ("`midpoint`", "midpoint", "", PIN),
    ("`symplectic`", "symplectic", "", PIN),
    ("`verlet`", "verlet", "", PIN),
    ("`velocity-verlet`", "velocity-verlet", "", PIN),
    (
        "`[material] model = \"corotated\"`",
        IMPLICIT,
        "model = \"corotated\"",
        PIN,
    ),
    (
        "`model = \"springs\"`",
        IMPLICIT,
        "model = \"springs\"",
        PIN,
    ),
    (
        "`volume = \"averaged\"`",
        IMPLICIT,
        "volume = \"averaged\"",
        PIN,
    ),
    (
        "`[[force]]`",
        IMPLICIT,
        "",
        "[[force]]\non = { axis = \"z\", above = 0.99 }\ntotal = [0.0, 0, 0.1]\n",
    ),
    (
        "`[[mass]]`",
        IMPLICIT,
        "",
        "[[mass]]\non = { axis = \"z\", above = 0.99 }\nkg = 0.01\n",
    ),
    (
        "`[floor]`",
        IMPLICIT,
        "",
        "[floor]\npoint = [0.0, 0, -0.01]\n",
    ),
    (
        "`[[pressure]]`",
        IMPLICIT,
        "",
        "[[pressure]]\nnormal = [0.0, 0, 1]\npressure = 10.0\n",
    ),
    (
        "`[[move]]`",
        IMPLICIT,
        "",
        "[[move]]\non = { axis = \"z\", above = 0.99 }\npath = [[0.0, 0, 0, 0], [1.0, 0, 0, 0.01]]\n",
    ),
    (
        "`[[muscle]]`",
        IMPLICIT,
        "",
        "[[muscle]]\nfibre = [0.0, 0, 1]\ntension = 100.0\nactivation = 1.0\n",
    ),
    (
        "`[[grab]]`",
        IMPLICIT,
        "",
        "[[grab]]\nat = [0.05, 0.05, 0.1]\nradius = 0.04\npath = [[0.0, 0, 0, 0], [1.0, 0, 0, 0.01]]\n",
    ),
    (
        "`[[grab]]` by springs",
        IMPLICIT,
        "",
        "[[grab]]\nat = [0.05, 0.05, 0.1]\nradius = 0.04\npath = [[0.0, 0, 0, 0], [1.0, 0, 0, 0.01]]\nspring_stiffness = 10.0\n",
    ),
    (
        "`[[cut]]`",
        IMPLICIT,
        "",
        "[[cut]]\nedge = [[-0.1, 0.05, 0.2], [0.2, 0.05, 0.2]]\npath = [[0.0, 0, 0, 0], [0.004, 0, 0, -0.15]]\n",
    ),
    (
        "`[[tool]]`, prescribed",
        IMPLICIT,
        "",
        "[[tool]]\nsphere = { radius = 0.04 }\nat = [0.05, 0.05, 0.15]\n",
    ),
    (
        "`[[tool]]` with a mass or a spring",
        IMPLICIT,
        "",
        "[[tool]]\nsphere = { radius = 0.04 }\nat = [0.05, 0.05, 0.15]\nmass = 0.1\n",
    ),
    ("`[contact]`", IMPLICIT, "", "[contact]\n"),
    (
        "reactions",
        IMPLICIT,
        "",
        "[output]\nreactions = \"forces.csv\"\n",
    ),
];

/// Whether a scene is accepted and takes two steps.
fn works(row: &Row, column: &(&str, &str, &str)) -> bool {
    let (_, solver, material, tables) = *row;
    let (name, engine, order) = *column;
    let (mut solver, mut extra) = (solver, "");
    match name {
        // It has one scheme.
        "`[grid]`" if solver == IMPLICIT => (solver, extra) = ("verlet", "[grid]\nnodes = 200\n"),
        "`[grid]`" => extra = "[grid]\nnodes = 200\n",
        "`[cage]`" => extra = "[cage]\nnodes = 60\n",
        _ => {}
    }
    // A grid fills a file, here a cube of the same size with a duct.
    let mesh = match name {
        "`[grid]`" => concat!("file = \"", env!("CARGO_MANIFEST_DIR"), "/data/duct.vtu\""),
        _ => "generate = \"box\"\ntets = 48",
    };
    let pin = if tables.contains("[[pin]]") { "" } else { PIN };
    let text = format!(
        "[mesh]\n{mesh}\n[material]\nyoung = 2e4\n{material}\n{order}\n[solver]\nname = \"{solver}\"\n{engine}\ndt = 0.002\nsteps = 2\ngravity = [0.0, 0, -1]\n[picture]\nsize = [16, 12]\n{pin}{extra}{tables}"
    );
    let scene = Scene::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let mut stage = match Stage::new(&gpu(), &scene) {
        Ok(stage) => stage,
        Err(_) => return false,
    };
    let needs_reactions = text.contains("[output]");
    if needs_reactions && stage.reactions().is_err() {
        return false;
    }
    stage.run(stage.steps(), &mut |_| {}).is_ok()
}

#[test]
fn capabilities_are_those_that_work() {
    let name = "capabilities.md";
    let stored = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("docs/reference")
        .join(name);
    let stored = std::fs::read_to_string(stored).unwrap_or_default();
    // Builds without rapier keep its column.
    let known = |row: &str, column: usize| -> Option<bool> {
        let line = stored
            .lines()
            .find(|line| line.starts_with(&format!("| {row} |")))?;
        line.split(" | ")
            .nth(column + 1)
            .map(|cell| cell.starts_with("yes"))
    };
    let mut table = String::from("| |");
    for (name, ..) in COLUMNS {
        table += &format!(" {name} |");
    }
    table += "\n|";
    table += &" --- |".repeat(COLUMNS.len() + 1);
    let (mut yes, mut no) = (0, 0);
    for row in ROWS {
        table += &format!("\n| {} |", row.0);
        for (i, column) in COLUMNS.iter().enumerate() {
            let works = match column.0 {
                RAPIER if cfg!(not(feature = "rapier")) => known(row.0, i).unwrap_or(false),
                _ => works(row, column),
            };
            table += if works { " yes |" } else { " – |" };
            *(if works { &mut yes } else { &mut no }) += 1;
        }
    }
    assert!(yes > 40 && no > 20, "{yes} yes, {no} no");
    check_page(name, &format!("{HEAD}\n{table}\n{TAIL}"));
}

const HEAD: &str = "\
# Capabilities

<!-- Written by `cargo test --test suite cli::capabilities`, with PALPATE_WRITE set; change the source instead. -->

What each engine and kind of body supports. Each cell is tried by a test: a scene of that entry is
accepted and takes two steps, or is refused with an error. `--engine auto` selects the CPU where only
that supports a scene.
";

const TAIL: &str = "
- `[grid]` bodies consist of springs and step by `verlet`; `[cage]` bodies here are lattices of tets.
- Rigid regions need finite elements, stepped by `implicit`, or on the CPU also by `bdf2` or `midpoint`: CPU, GPU (without tools) and rapier.
- `[[joint]]` needs the engine `rapier`.
- Checkpoints (`--resume`): all but rapier.
- Gradients, and errors of numbers at rest: finite elements on the CPU.
- Rendering, skins and scans are the same for every engine.
- [Features by order](../explanation/quadratic-tets.md#features-by-order) says how quadratic tets behave in each.
- A combination that does not work gives an error that names what to change.
";
