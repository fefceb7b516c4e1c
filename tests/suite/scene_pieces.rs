//! Partitioned meshes: written, read as one, and rendered by pieces as the whole is.

use crate::support::{gpu, real_data};
use palpate::generate;
use palpate::io;
use palpate::mesh::{Field, Location, TetMesh};
use palpate::render::{Image, ImageDifference, RaySegments};
use palpate::scene::{Piece, Scene, Stage, write_pieces};
use std::path::{Path, PathBuf};

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn limb() -> TetMesh {
    generate::by_name("limb", Some(5_000)).unwrap()
}

/// Returns the scene of a small picture with these entries.
fn scene(picture: &str) -> Scene {
    Scene::parse_in(
        // Pieces have the boundaries of their tets.
        &format!("[picture]\nsize = [150, 110]\nboundaries = \"tets\"\n{picture}"),
        Path::new("."),
    )
    .unwrap()
}

/// Returns the merged picture of all pieces of an index.
fn in_pieces(index: &Path, scene: &Scene) -> Image {
    let mut told: Option<RaySegments> = None;
    for number in 0..io::piece_files(index).unwrap().len() {
        let piece = Piece::read(index, number).unwrap();
        let own = piece.intervals(&gpu(), scene).unwrap();
        told = Some(match told {
            None => own,
            Some(before) => before.merged(&own).unwrap(),
        });
    }
    scene.composite(&told.unwrap()).unwrap()
}

/// Renders `mesh` in `pieces` pieces and as a whole, with the entries of each of `pictures`.
fn check(name: &str, mesh: &TetMesh, pieces: usize, pictures: &[&str]) {
    let index = folder(name).join("body.pvtu");
    write_pieces(&index, mesh, pieces).unwrap();
    for picture in pictures {
        let scene = scene(picture);
        let mut stage = Stage::with_mesh(&gpu(), &scene, mesh.clone()).unwrap();
        let whole = stage.image().unwrap();
        assert!(
            whole.values.iter().any(|v| *v > 0.1),
            "{picture}: empty picture"
        );
        let image = in_pieces(&index, &scene);
        let apart = ImageDifference::between(&image, &whole).unwrap();
        println!("{name} {picture:?}: {apart:?}");
        assert!(255.0 * apart.rmse < 0.15, "{name}, {picture}: {apart:?}");
    }
}

#[test]
fn composited_pieces_match_whole_mesh() {
    check(
        "pieces_limb",
        &limb(),
        7,
        &[
            // The regions, in their own colours.
            "",
            "field = \"intensity\"\nrange = [300, 1500]\ntransfer = \"tissue\"",
            "transfer = \"viridis\"\nsamples = 4",
            "hide = [\"skin\", \"fat\"]\nregion.muscle = { colour = \"wheat\", opacity = 0.3 }",
            "quality = 2.0\nbackground = \"white\"\n[camera]\neye = [0.3, 0.1, 0.4]\n[light]\nfrom = [1.0, 2.0, 0.5]",
        ],
    );
}

#[test]
fn pieces_without_field_render_depth() {
    let mut mesh = generate::by_name("box", Some(4_000)).unwrap();
    mesh.fields.clear();
    check("pieces_depth", &mesh, 6, &["", "transfer = \"magma\""]);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn sixty_four_pieces_match_whole_heart() {
    let Some(heart) = real_data("scalar/chaste_heart_decimation.vtu") else {
        return;
    };
    let mesh = io::read(heart).unwrap();
    check(
        "pieces_heart",
        &mesh,
        64,
        &["", "mode = \"composite\"\ntransfer = \"magma\""],
    );
}

#[test]
fn pieces_round_trip() {
    let folder = folder("pieces_read");
    let mut mesh = limb();
    let number = (0..mesh.nodes.len()).map(|v| v as f64).collect();
    mesh.set_field(Field::scalar("number", Location::Node, number))
        .unwrap();
    for pieces in [1, 5] {
        let index = folder.join(format!("body{pieces}.pvtu"));
        write_pieces(&index, &mesh, pieces).unwrap();
        let read = io::read(&index).unwrap();
        assert_eq!(read.nodes, mesh.nodes);
        assert_eq!(read.tets, mesh.tets);
        assert_eq!(read.region_names, mesh.region_names);
        assert_eq!(read.length_unit, mesh.length_unit);
        let sorted = |mesh: &TetMesh| {
            let mut fields = mesh.fields.clone();
            fields.sort_by(|a, b| a.name.cmp(&b.name));
            fields
        };
        assert_eq!(sorted(&read), sorted(&mesh));
        assert_eq!(read.repairs.warnings, Vec::<String>::new());
    }
    // For a mesh rendered by depth, which is not one of its fields.
    mesh.fields.clear();
    let index = folder.join("plain.pvtu");
    write_pieces(&index, &mesh, 3).unwrap();
    assert!(io::read(&index).unwrap().fields.is_empty());
    // A piece contains its ghost cells only.
    let piece = Piece::read(&index, 1).unwrap();
    let own = piece.mesh();
    assert!(own.owned_tets < own.tets.len() && own.tets.len() < mesh.tets.len());
}

#[test]
fn foreign_pieces_merge_by_node_position() {
    let folder = folder("pieces_foreign");
    let mesh = generate::by_name("box", Some(600)).unwrap();
    let half = |first: bool| {
        let middle = |t: &[u32; 4]| t.iter().map(|v| mesh.nodes[*v as usize].x).sum::<f64>() / 4.0;
        let (low, high) = mesh.bounds();
        let tets = mesh.tets.iter().copied();
        let own = tets.filter(|t| (middle(t) < 0.5 * (low.x + high.x)) == first);
        TetMesh::new(mesh.nodes.clone(), own.collect(), Vec::new(), Vec::new()).unwrap()
    };
    let index = folder.join("two.pvtu");
    let name = |k| folder.join(format!("part{k}.vtu"));
    io::write(name(0), &half(true)).unwrap();
    io::write(name(1), &half(false)).unwrap();
    let listed = |pieces: &str| {
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PUnstructuredGrid\" version=\"0.1\">\n<PUnstructuredGrid GhostLevel=\"0\">{pieces}</PUnstructuredGrid>\n</VTKFile>\n"
        )
    };
    let both = listed("<Piece Source=\"part0.vtu\"/><Piece Source=\"part1.vtu\"/>");
    std::fs::write(&index, &both).unwrap();
    let read = io::read(&index).unwrap();
    assert_eq!(
        (read.nodes.len(), read.tets.len()),
        (mesh.nodes.len(), mesh.tets.len())
    );
    assert!((read.volume() / mesh.volume() - 1.0).abs() < 1e-12);
    // They cannot be rendered independently, and the message states the reason.
    let told = Piece::read(&index, 0).err().unwrap().to_string();
    assert!(
        told.contains("palpate convert") && told.contains("--pieces 2"),
        "{told}"
    );
    // A damaged index, or one that lists missing files.
    for cut in (0..both.len() - 1).step_by(7) {
        std::fs::write(&index, &both[..cut]).unwrap();
        assert!(io::read(&index).is_err(), "cut at {cut}");
    }
    for (wrong, said) in [
        (listed(""), "no pieces"),
        (listed("<Piece/>"), "no attribute Source"),
        (listed("<Piece Source=\"part7.vtu\"/>"), "part7.vtu"),
        (
            listed("<Piece Source=\"two.pvtu\"/>"),
            "expected \"UnstructuredGrid\"",
        ),
    ] {
        std::fs::write(&index, wrong).unwrap();
        let told = io::read(&index).unwrap_err().to_string();
        assert!(told.contains(said), "{told}");
    }
    let told = io::parse("two.pvtu", both.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(told.contains("single file"), "{told}");
}

#[test]
fn pieces_reject_unsupported_scenes() {
    let folder = folder("pieces_refused");
    let mesh = generate::by_name("box", Some(300)).unwrap();
    let index = folder.join("box.pvtu");
    write_pieces(&index, &mesh, 2).unwrap();
    let piece = Piece::read(&index, 0).unwrap();
    for (entries, said) in [
        ("mode = \"thickness\"", "composite"),
        ("legend = true", "legend"),
        ("[light]\nshadows = 0.5", "shadows"),
        ("[[plane]]\nclip = [0, 0, 0, 1, 0, 0]", "planes"),
        ("[[isosurface]]\nvalue = 0.5", "isosurfaces"),
        ("[solver]\nname = \"implicit\"", "solver"),
        ("field = \"nothing\"", "unknown field \"nothing\""),
    ] {
        let told = piece
            .intervals(&gpu(), &scene(entries))
            .unwrap_err()
            .to_string();
        assert!(told.contains(said), "{entries}: {told}");
    }
    assert!(
        Piece::read(&index, 2)
            .err()
            .unwrap()
            .to_string()
            .contains("index must be < 2")
    );
    for (path, pieces) in [(&index, 0), (&index, 10_000), (&folder.join("box.vtu"), 2)] {
        assert!(write_pieces(path, &mesh, pieces).is_err(), "{pieces}");
    }
    // The data about the whole mesh are damaged.
    let file = &io::piece_files(&index).unwrap()[0];
    let bytes = std::fs::read(file).unwrap();
    let told = b"Name=\"palpate:whole\"";
    let at = bytes.windows(told.len()).position(|w| w == told).unwrap();
    let number = at + bytes[at..].iter().position(|b| *b == b'>').unwrap() + 1;
    // Its first byte, a brace.
    assert_eq!(&bytes[number..number + 4], b"123 ");
    let mut damaged = bytes.clone();
    damaged[number + 2] = b'4';
    std::fs::write(file, damaged).unwrap();
    let told = Piece::read(&index, 0).err().unwrap().to_string();
    assert!(told.contains("write the pieces again"), "{told}");
}
