//! Images and surfaces of VTK.

use crate::io::sample::Bench;
use crate::support::real_data;
use palpate::io::{self, Kind};
use palpate::volume::Volume;

fn read(name: &str, text: &str) -> palpate::Result<Volume> {
    let bench = Bench::new();
    let path = bench.path(name);
    std::fs::write(&path, text).unwrap();
    assert_eq!(io::detect_kind(&path).unwrap(), Kind::Volume, "{name}");
    io::read_volume(path)
}

fn vti(extent: &str, attributes: &str, pieces: &str) -> String {
    format!(
        "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"{extent}\" {attributes}>{pieces}</ImageData></VTKFile>"
    )
}

fn values(volume: &Volume) -> Vec<f64> {
    (0..volume.voxels()).map(|n| volume.value(n)).collect()
}

#[test]
fn xml_image_is_placed_by_extent_origin_spacing_and_direction() {
    let piece = "<Piece Extent=\"1 2 0 1 0 0\"><PointData><DataArray type=\"Int16\" Name=\"ct\">1 2 3 4</DataArray></PointData></Piece>";
    let text = vti(
        "1 2 0 1 0 0",
        "Origin=\"5 6 7\" Spacing=\"2 3 4\" Direction=\"0 -1 0 1 0 0 0 0 1\"",
        piece,
    );
    let volume = read("a.vti", &text).unwrap();
    assert_eq!(volume.size, [2, 2, 1]);
    assert_eq!(values(&volume), [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(volume.centre(0, 0, 0).to_array(), [5.0, 8.0, 7.0]);
    assert_eq!(volume.centre(1, 0, 0).to_array(), [5.0, 10.0, 7.0]);
    assert_eq!(volume.centre(0, 1, 0).to_array(), [2.0, 8.0, 7.0]);
}

#[test]
fn values_at_cells_and_pieces_are_assembled() {
    let piece = |extent: &str, values: &str| {
        format!(
            "<Piece Extent=\"{extent}\"><CellData><DataArray type=\"UInt8\" Name=\"label\">{values}</DataArray></CellData></Piece>"
        )
    };
    let pieces = piece("0 1 0 2 0 1", "1 3") + &piece("1 2 0 2 0 1", "2 4");
    let volume = read("a.vti", &vti("0 2 0 2 0 1", "", &pieces)).unwrap();
    assert_eq!(volume.size, [2, 2, 1]);
    assert_eq!(values(&volume), [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(volume.centre(0, 0, 0).to_array(), [0.5; 3]);
}

#[test]
fn array_stated_as_scalars_is_read_of_several() {
    let piece = |scalars: &str| {
        format!(
            "<Piece Extent=\"0 1 0 0 0 0\"><PointData {scalars}><DataArray type=\"UInt8\" Name=\"a\">1 2</DataArray><DataArray type=\"UInt8\" Name=\"b\">3 4</DataArray><DataArray type=\"UInt8\" Name=\"rgb\" NumberOfComponents=\"3\">0 0 0 0 0 0</DataArray></PointData></Piece>"
        )
    };
    let text = |scalars: &str| vti("0 1 0 0 0 0", "", &piece(scalars));
    let volume = read("a.vti", &text("Scalars=\"b\"")).unwrap();
    assert_eq!(values(&volume), [3.0, 4.0]);
    let error = read("a.vti", &text("")).unwrap_err().to_string();
    assert!(error.contains("0 \"a\", 1 \"b\""), "{error}");
}

#[test]
fn wrong_images_are_errors() {
    let data = "<PointData><DataArray type=\"UInt8\" Name=\"a\">1 2</DataArray></PointData>";
    let piece = format!("<Piece Extent=\"0 1 0 0 0 0\">{data}</Piece>");
    for (text, expected) in [
        (vti("0 1 0 0", "", &piece), "WholeExtent must be"),
        (
            vti("0 1 0 0 0 0", "Spacing=\"0 1 1\"", &piece),
            "spacing must be",
        ),
        (
            vti("0 1 0 0 0 0", "Spacing=\"x\"", &piece),
            "Spacing must be 3 numbers",
        ),
        (vti("0 5 0 0 0 0", "", &piece), "have 2 values of the 6"),
        (
            vti("0 4000000000 0 4000000000 0 4000000000", "", &piece),
            "addressable",
        ),
        (vti("5 6 0 0 0 0", "", &piece), "outside WholeExtent"),
        (
            vti("0 1 0 0 0 0", "", "<Piece Extent=\"0 1 0 0 0 0\"></Piece>"),
            "no numeric array",
        ),
    ] {
        let error = read("a.vti", &text).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

#[test]
fn legacy_structured_points_are_read() {
    let text = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 1 2\nORIGIN 1 2 3\nSPACING 0.5 1 2\nPOINT_DATA 4\nSCALARS ct short\nLOOKUP_TABLE default\n-1 2 3 4\nCELL_DATA 1\nSCALARS c float\nLOOKUP_TABLE default\n9\n";
    let volume = read("a.vtk", text).unwrap();
    assert_eq!(volume.size, [2, 1, 2]);
    assert_eq!(values(&volume), [-1.0, 2.0, 3.0, 4.0]);
    assert_eq!(volume.centre(1, 0, 1).to_array(), [1.5, 2.0, 5.0]);
    let cut = text.replace("DIMENSIONS 2 1 2\n", "");
    let error = read("a.vtk", &cut).unwrap_err().to_string();
    assert!(error.contains("POINT_DATA must follow"), "{error}");
}

#[test]
fn xml_surface_reads_polygons_and_strips() {
    let array = |name: &str, values: &str| {
        format!("<DataArray type=\"Int32\" Name=\"{name}\">{values}</DataArray>")
    };
    let section = |name: &str, nodes: &str, ends: &str| {
        format!(
            "<{name}>{}{}</{name}>",
            array("connectivity", nodes),
            array("offsets", ends)
        )
    };
    let text = format!(
        "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPoints=\"5\" NumberOfVerts=\"1\" NumberOfLines=\"0\" NumberOfStrips=\"1\" NumberOfPolys=\"2\"><CellData>{}</CellData><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\">0 0 0 1 0 0 1 1 0 0 1 0 .5 .5 1</DataArray></Points>{}{}{}</Piece></PolyData></VTKFile>",
        array("part", "7 8 9 10"),
        section("Verts", "0", "1"),
        section("Strips", "1 2 4 3", "4"),
        section("Polys", "0 3 2 1 0 1 4", "4 7"),
    );
    let bench = Bench::new();
    let path = bench.path("a.vtp");
    std::fs::write(&path, text).unwrap();
    assert_eq!(io::detect_kind(&path).unwrap(), Kind::Surface);
    let surface = io::read_surface(&path).unwrap();
    assert_eq!((surface.vertices.len(), surface.triangles.len()), (5, 5));
    assert_eq!(surface.fields[0].values, [8.0, 8.0, 9.0, 10.0, 10.0]);
    let error = io::read(&path).unwrap_err().to_string();
    assert!(error.contains("closed surface"), "{error}");
}

#[test]
fn cases_of_images_surfaces_and_compressors_read() {
    let real = |name: &str| real_data(&format!("cases/{name}"));
    for name in ["24_v_image.vti", "24_v_image.vtk"] {
        let Some(path) = real(name) else {
            return;
        };
        let volume = io::read_volume(path).unwrap();
        assert_eq!(volume.size, [20, 21, 22], "{name}");
        assert_eq!(volume.centre(0, 0, 0).to_array(), [5.0, 6.0, 7.0]);
        assert_eq!(volume.spacing().to_array(), [1.0, 1.0, 2.0]);
        let all = values(&volume);
        let low = all.iter().copied().fold(f64::INFINITY, f64::min);
        let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert_eq!((low, high), (1.0, 25.0), "{name}");
    }
    if let Some(path) = real("24_v_sphere.vtp") {
        let surface = io::read_surface(path).unwrap();
        assert_eq!(
            (surface.vertices.len(), surface.triangles.len()),
            (226, 448)
        );
    }
    if let Some(path) = real("24_v_lz4.vtu") {
        let mesh = io::read(path).unwrap();
        assert_eq!((mesh.nodes.len(), mesh.tets.len()), (144, 432));
    }
}
