//! The keys of JSON reports, from the types that are written, as pages of the reference.

use super::book::check_page;
use std::collections::BTreeSet;
use std::fs::read_to_string;
use std::path::Path;

/// A page: its title, what writes the report, and the types in it, each with its file.
type Page = (
    &'static str,
    &'static str,
    &'static str,
    &'static [(&'static str, &'static str)],
);

const PAGES: &[Page] = &[
    (
        "render",
        "Report of `palpate render`",
        "`palpate render … --report FILE` writes it, and `--json` prints it. A body at rest or in slow motion has in addition `errors`.",
        &[
            ("StageReport", "src/scene/stage/report.rs"),
            ("CgReport", "src/scene/stage/report.rs"),
            ("ToolReport", "src/scene/stage/report.rs"),
            ("Energy", "src/physics/model/energy.rs"),
            ("MemberReport", "src/physics/simulator/member.rs"),
            ("CageReport", "src/cage/model.rs"),
            ("RestErrors", "src/accuracy/rest.rs"),
            ("ForceError", "src/accuracy/rest.rs"),
            ("ErrorParts", "src/accuracy/mod.rs"),
        ],
    ),
    (
        "press",
        "Report of `palpate press`",
        "`palpate press` writes it as `press.json`, and `--json` prints it.",
        &[
            ("PressReport", "src/press/curve.rs"),
            ("PressConditions", "src/press/curve.rs"),
            ("Bed", "src/press/curve.rs"),
            ("PressError", "src/press/error.rs"),
            ("ErrorParts", "src/accuracy/mod.rs"),
            ("Round", "src/accuracy/refinement.rs"),
        ],
    ),
    (
        "map",
        "Report of `palpate press --map`",
        "`palpate press --map 10x10` writes it as `map.json`, and `--json` prints it.",
        &[("MapMetadata", "src/cli/press_map.rs")],
    ),
    (
        "info",
        "Report of `palpate info`",
        "`palpate info FILE --json` prints it: of a mesh, a surface or a volume.",
        &[
            ("MeshDescription", "src/mesh/mesh_report.rs"),
            ("FieldDescription", "src/mesh/mesh_report.rs"),
            ("RegionDescription", "src/mesh/mesh_report.rs"),
            ("QualityReport", "src/mesh/quality.rs"),
            ("WorstTet", "src/mesh/quality.rs"),
            ("SurfaceDescription", "src/mesh/surface_report.rs"),
            ("VolumeDescription", "src/volume/describe.rs"),
            ("LabelDescription", "src/volume/describe.rs"),
        ],
    ),
    (
        "mesh",
        "Report of `palpate mesh`",
        "`palpate mesh … --report FILE` writes it, and `--json` prints it.",
        &[
            ("RecipeReport", "src/meshing/recipe.rs"),
            ("RegionSummary", "src/meshing/recipe.rs"),
            ("MeshReport", "src/mesher/mesh_report.rs"),
            ("RegionReport", "src/mesher/mesh_report.rs"),
            ("IslandReport", "src/mesher/small_components.rs"),
            ("NonManifoldReport", "src/mesher/non_manifold.rs"),
            ("OptimiserReport", "src/mesher/optimise/mod.rs"),
        ],
    ),
    (
        "identify",
        "Report of `palpate identify`",
        "`palpate identify` writes it as `identified.json`, and `--json` prints it.",
        &[
            ("Identified", "src/identify/report.rs"),
            ("IdentifiedValue", "src/identify/report.rs"),
            ("StiffnessFactor", "src/identify/report.rs"),
            ("PressAdvice", "src/identify/report.rs"),
            ("ForceCorrection", "src/identify/correction.rs"),
        ],
    ),
    (
        "bench",
        "Report of `palpate bench`",
        "`palpate bench` writes it as `bench.json`.",
        &[
            ("Report", "src/bench/report.rs"),
            ("Machine", "src/bench/machine.rs"),
            ("Row", "src/bench/row.rs"),
        ],
    ),
    (
        "compare",
        "Reports of `palpate compare` and `bake`",
        "`--json` prints them.",
        &[
            ("ImageDifference", "src/render/compare.rs"),
            ("BakeReport", "src/skin/bake.rs"),
        ],
    ),
];

/// A report that a command puts together by itself: command, file, keys and their meanings.
type SmallReport = (
    &'static str,
    &'static str,
    &'static [(&'static str, &'static str)],
);

const SMALL: &[SmallReport] = &[
    (
        "simulate",
        "src/cli/simulate.rs",
        &[
            ("adapter", "the graphics adapter"),
            ("tets", "number of tets"),
            ("nodes", "number of nodes"),
            ("frames", "number of frames, with the first"),
            ("time_s", "simulated time of the last frame, s"),
        ],
    ),
    (
        "render --pick",
        "src/cli/render.rs",
        &[
            ("node", "the nearest node of the face"),
            ("tet", "the tet"),
            ("face", "the face of the tet"),
            ("point", "the point, in the mesh's unit"),
            ("distance", "distance from the eye, in the mesh's unit"),
            ("label", "label of the region, or null"),
            ("region", "name of the region, or null"),
        ],
    ),
    (
        "render --frames-from",
        "src/cli/frames.rs",
        &[("frames", "number of frames")],
    ),
    (
        "convert",
        "src/cli/convert.rs",
        &[
            ("output", "the file"),
            ("nodes", "number of nodes of a mesh"),
            ("tets", "number of tets of a mesh"),
            ("pieces", "number of pieces, or null"),
            ("vertices", "number of vertices of a surface"),
            ("triangles", "number of triangles of a surface"),
            ("notes", "data that the format cannot store"),
        ],
    ),
    (
        "warp",
        "src/cli/warp.rs",
        &[
            ("tets", "number of tets"),
            ("inverted", "number of inverted tets in the bent mesh"),
            ("bent", "voxel counts of the grid in the bent body, or null"),
            (
                "rest",
                "voxel counts of the grid in the body at rest, or null",
            ),
            ("voxels", "number of voxels of the grid"),
            ("uncovered", "voxels outside of all tets"),
            ("overlapping", "voxels inside of more than one tet"),
            ("beyond", "voxels whose place is outside of the scan"),
        ],
    ),
    (
        "study",
        "src/cli/study.rs",
        &[
            ("study", "the study"),
            ("adapter", "the graphics adapter"),
            ("ended_early", "whether it was interrupted"),
            ("files", "files in its folder"),
        ],
    ),
    (
        "tune",
        "src/cli/tune.rs",
        &[
            (
                "met",
                "whether the error is met: of all, and of each choice",
            ),
            ("motion", "choice for the motion, or null without a solver"),
            ("picture", "choice for the picture"),
            ("notes", "notes"),
            ("choice", "the settings, in words"),
            ("cost_ms", "time, ms"),
            ("error", "error of the choice"),
            ("candidates", "number of candidates"),
            ("tried", "number of candidates that were run"),
        ],
    ),
    (
        "demo",
        "src/cli/demo.rs",
        &[
            ("adapter", "the graphics adapter"),
            ("tets", "number of tets of the limb"),
            ("nodes", "number of its nodes"),
            ("frames", "number of frames"),
            ("press", "the report of the press"),
        ],
    ),
    (
        "presets",
        "src/cli/presets.rs",
        &[("presets", "names of the transfer functions")],
    ),
    (
        "adapters",
        "src/cli/adapters.rs",
        &[
            ("adapters", "the list, best first"),
            ("index", "number of the adapter, for `--adapter`"),
            ("adapter", "its name"),
            ("chosen", "whether it is used"),
        ],
    ),
];

/// Keys of a struct with their meanings and types, as serde writes them.
fn keys(source: &str, name: &str) -> Vec<(String, String, String)> {
    let head = format!("struct {name} {{");
    let start = source
        .find(&head)
        .unwrap_or_else(|| panic!("no struct {name}"));
    let mut found = Vec::new();
    let (mut doc, mut attributes) = (String::new(), String::new());
    for line in source[start + head.len()..].lines().skip(1) {
        let line = line.trim();
        if line == "}" {
            return found;
        }
        if let Some(text) = line.strip_prefix("///") {
            doc += text;
        } else if line.starts_with("#[") {
            attributes += line;
        } else if let Some((field, kind)) = line.trim_end_matches(',').split_once(": ") {
            let field = field.rsplit(' ').next().unwrap();
            let renamed = attributes.split("rename = \"").nth(1);
            let key = renamed.map_or(field, |name| name.split('"').next().unwrap());
            if !attributes.contains("skip)") {
                let key = match attributes.contains("flatten") {
                    true => format!("(keys of {kind})"),
                    false => key.to_owned(),
                };
                found.push((key, doc.trim().to_owned(), kind.to_owned()));
            }
            (doc, attributes) = (String::new(), String::new());
        }
    }
    panic!("struct {name} has no end");
}

/// The keys of the object that this source begins with.
fn json_keys(source: &str) -> Vec<&str> {
    let mut depth = 1;
    let closes = |c: char| {
        depth += i32::from("({[".contains(c)) - i32::from(")}]".contains(c));
        depth == 0
    };
    let end = source.find(closes).unwrap_or(source.len());
    let quoted: Vec<&str> = source[..end].split('"').collect();
    let keys = quoted.windows(2).skip(1).step_by(2);
    keys.filter(|pair| pair[1].starts_with(':'))
        .map(|pair| pair[0])
        .collect()
}

/// A Rust type in the words of JSON.
fn kind(rust: &str) -> String {
    let rust = rust.trim();
    let inner = |outer: &str| rust.strip_prefix(outer).and_then(|t| t.strip_suffix('>'));
    if let Some(inner) = inner("Option<") {
        return format!("{} or null", kind(inner));
    }
    if let Some(inner) = inner("Vec<") {
        return format!("list of {}", kind(inner));
    }
    if let Some(inner) = inner("BTreeMap<String, ") {
        return format!("by name: {}", kind(inner));
    }
    if let Some(inner) = rust.strip_prefix('[').and_then(|t| t.strip_suffix(']')) {
        let (item, count) = inner.rsplit_once("; ").unwrap_or((inner, ""));
        return format!("{count} of {}", kind(item));
    }
    match rust {
        "f64" | "f32" | "u8" | "u16" | "u32" | "u64" | "i64" | "usize" => "number".to_owned(),
        "bool" => "true or false".to_owned(),
        "String" | "&'static str" | "PathBuf" => "text".to_owned(),
        "DVec3" => "3 of number".to_owned(),
        other => other.to_owned(),
    }
}

/// Doc comments without the links and code of Rust.
fn plain(doc: &str) -> String {
    let mut text = doc
        .replace("`None`", "null")
        .replace("[`", "`")
        .replace("`]", "`")
        .replace('|', "\\|");
    while let Some(start) = text.find("](crate") {
        let end = text[start..]
            .find(')')
            .map_or(text.len(), |end| start + end + 1);
        text.replace_range(start..end, "");
    }
    while let Some(start) = text.find("`(crate") {
        let end = text[start..]
            .find(')')
            .map_or(text.len(), |end| start + end + 1);
        text.replace_range(start + 1..end, "");
    }
    text.replace('<', "&lt;")
}

const GENERATED: &str = "<!-- Written by `cargo test --test suite cli::report_keys`, with PALPATE_WRITE set; change the source instead. -->";

#[test]
fn report_pages_agree_with_the_code() {
    let read = |file: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
        read_to_string(&path).unwrap_or_else(|e| panic!("{file}: {e}"))
    };
    let mut index = format!(
        "# Reports\n\n{GENERATED}\n\nEvery key of the JSON that commands write or print with `--json`. \
         [Tables](../tables.md) has the columns of CSV files.\n\n| report | of |\n| --- | --- |\n"
    );
    for (name, title, about, types) in PAGES {
        index += &format!("| [{title}]({name}.md) | {about} |\n");
        let mut page = format!("# {title}\n\n{GENERATED}\n\n{about}\n");
        for (i, (of, file)) in types.iter().enumerate() {
            if i > 0 {
                page += &format!("\n## {of}\n");
            }
            page += "\n| key | meaning | type |\n| --- | --- | --- |\n";
            let keys = keys(&read(file), of);
            assert!(!keys.is_empty(), "{of}");
            for (key, doc, rust) in keys {
                page += &format!("| `{key}` | {} | {} |\n", plain(&doc), plain(&kind(&rust)));
            }
        }
        check_page(&format!("reports/{name}.md"), &page);
    }
    index += "\n## Small reports\n";
    for (command, file, meanings) in SMALL {
        let source = read(file);
        let written: BTreeSet<&str> = source.split("json!(").skip(1).flat_map(json_keys).collect();
        let known: BTreeSet<&str> = meanings.iter().map(|(key, _)| *key).collect();
        assert_eq!(written, known, "keys of {command} in {file}");
        index += &format!("\n### palpate {command}\n\n| key | meaning |\n| --- | --- |\n");
        for (key, meaning) in *meanings {
            index += &format!("| `{key}` | {meaning} |\n");
        }
    }
    check_page("reports/index.md", &index);
}

#[test]
fn keys_of_a_struct_are_those_that_serde_writes() {
    let source = "/// A.\npub struct A {\n    /// One,\n    /// in m.\n    pub one: Option<f64>,\n    #[serde(skip)]\n    two: u8,\n    #[serde(rename = \"drei\")]\n    three: Vec<[f64; 3]>,\n}\n";
    let found = keys(source, "A");
    let expected = [
        ("one", "One, in m.", "Option<f64>"),
        ("drei", "", "Vec<[f64; 3]>"),
    ];
    let expected = expected.map(|(a, b, c)| (a.to_owned(), b.to_owned(), c.to_owned()));
    assert_eq!(found, expected);
    assert_eq!(kind("Vec<[f64; 3]>"), "list of 3 of number");
    assert_eq!(plain("see [`A`](crate::b::A), or [`C`]"), "see `A`, or `C`");
}
