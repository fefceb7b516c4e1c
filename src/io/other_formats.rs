//! Formats that are not supported: their names, how to recognise them, and what converts them. One
//! table serves meshes, surfaces and volumes.

use super::start_of;
use Test::{Bytes, Hdf5, If, Never, Text, Xml};

/// A format that is not supported.
struct Other {
    /// Its name, with the programs that use it.
    name: &'static str,
    extensions: &'static [&'static str],
    /// Recognises the content.
    test: Test,
    /// What converts it.
    remedy: &'static str,
    /// Whether its files are volumes.
    volume: bool,
}

/// How to recognise the content of a file.
enum Test {
    /// Text that begins with one of these, in lower case.
    Text(&'static [&'static str]),
    Bytes(&'static [u8]),
    /// An HDF5 file with one of these words near its start.
    Hdf5(&'static [&'static str]),
    /// XML whose root is this element, in lower case.
    Xml(&'static str),
    /// Any other condition, on the content and its start in lower case.
    If(fn(&[u8], &str) -> bool),
    /// By extension only.
    Never,
}

// "{in}" stands for the file, "{out}" for its name without extension.
const MESHIO: &str = "convert it with meshio (pip install meshio; meshio convert {in} {out}.vtu)";
const MESHIO_OR_GMSH: &str = "convert it with meshio (pip install meshio; meshio convert {in} \
    {out}.vtu) or Gmsh (gmsh {in} -save -o {out}.msh)";
const MESHIO_HDF5: &str =
    "convert it with meshio (pip install meshio h5py; meshio convert {in} {out}.vtu)";
const MESHIO_OR_PARAVIEW: &str = "convert it with meshio (pip install meshio h5py netCDF4; meshio \
    convert {in} {out}.vtu), or save it as .vtu in ParaView";
const MESHIO_SURFACE: &str =
    "convert it with meshio (pip install meshio; meshio convert {in} {out}.ply)";
const XDMF_OF_HDF5: &str = "if an .xdmf file belongs to it, convert that with meshio (pip install \
    meshio h5py; meshio convert {out}.xdmf {out}.vtu) or ParaView; a volume of MINC with nibabel";
const GMSH: &str = "convert it with Gmsh (gmsh {in} -save -o {out}.msh)";
const MESH_WITH_GMSH: &str =
    "it describes a shape without a mesh: mesh it with Gmsh (gmsh -3 {in} -o {out}.msh)";
const PARAVIEW: &str = "open it in ParaView and save it as .vtu";
const LS_DYNA: &str = "open it in LS-PrePost or FEBio Studio, export its mesh as Nastran (.nas), \
    and convert that with meshio (pip install meshio; meshio convert {out}.nas {out}.vtu)";
const COMSOL: &str = "export the mesh from COMSOL as Nastran (.nas), and convert that with meshio \
    (pip install meshio; meshio convert {out}.nas {out}.vtu)";
const MAPDL: &str = "convert it in Python (pip install mapdl-archive[vtk]): \
    mapdl_archive.Archive(\"{in}\").grid.save(\"{out}.vtu\")";
const BLENDER: &str = "open it in Blender or MeshLab and export it as STL, PLY or OBJ";
const FREESURFER: &str =
    "convert it with FreeSurfer (mris_convert {in} {out}.stl), or save it as STL in 3D Slicer";

const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// More specific rows precede others that recognise the same content.
static OTHERS: [Other; 57] = [
    row(
        "MED (SALOME, Code_Aster)",
        &["med", "rmed", "mmed"],
        Hdf5(&["INFOS_GENERALES", "ENS_MAA"]),
        MESHIO_HDF5,
    ),
    row("CGNS", &["cgns"], Hdf5(&["CGNSLibraryVersion"]), PARAVIEW),
    row("VTKHDF", &["vtkhdf"], Hdf5(&["VTKHDF"]), PARAVIEW),
    row("MOAB (H5M)", &["h5m"], Hdf5(&["tstt"]), MESHIO_HDF5),
    row(
        "Exodus II",
        &["e", "exo", "ex2", "exii", "g", "gen"],
        If(is_exodus),
        MESHIO_OR_PARAVIEW,
    ),
    volume(
        "MINC",
        &["mnc", "mnc2"],
        Hdf5(&["minc-2.0"]),
        "convert it with `mnc2nii {in} {out}.nii` or nibabel",
    ),
    row("HDF5", &["h5", "hdf5", "hdf"], Bytes(HDF5), XDMF_OF_HDF5),
    row(
        "NetCDF",
        &["nc", "cdf"],
        If(is_netcdf),
        "save its mesh as .vtu in ParaView, or its volume as .nii.gz with nibabel",
    ),
    row(
        "XDMF",
        &["xdmf", "xmf", "xdmf3"],
        Xml("<xdmf"),
        MESHIO_OR_PARAVIEW,
    ),
    row(
        "FEBio",
        &["feb", "fsm", "fs2", "fsprj"],
        Xml("<febio_spec"),
        "open it in FEBio Studio and export its mesh as VTK",
    ),
    row("DOLFIN XML (FEniCS)", &[], Xml("<dolfin"), MESHIO),
    row("GIFTI", &["gii"], Xml("<gifti"), FREESURFER),
    row("COLLADA", &["dae"], Xml("<collada"), BLENDER),
    row("X3D", &["x3d"], Xml("<x3d"), BLENDER),
    row(
        "UNV (I-DEAS universal file)",
        &["unv", "uff"],
        If(is_unv),
        GMSH,
    ),
    row(
        "Nastran",
        &["bdf", "nas", "fem", "bulk"],
        If(is_nastran),
        MESHIO_OR_GMSH,
    ),
    row("LS-DYNA", &["k", "key", "dyn"], If(is_ls_dyna), LS_DYNA),
    row("ANSYS archive (CDWRITE)", &["cdb"], If(is_cdb), MAPDL),
    row("ANSYS Fluent", &["cas"], If(is_fluent), MESHIO),
    row(
        "OpenFOAM",
        &["foam"],
        If(is_openfoam),
        "open the case in ParaView and save it as .vtu, or run foamToVTK",
    ),
    row(
        "COMSOL",
        &["mphtxt", "mphbin"],
        Text(&["# created by comsol"]),
        COMSOL,
    ),
    row("Netgen", &["vol"], Text(&["mesh3d"]), MESHIO),
    row("SU2", &["su2"], Text(&["ndime="]), MESHIO),
    row(
        "Tecplot",
        &["tec", "plt"],
        Text(&["title =", "title=", "variables =", "variables="]),
        MESHIO,
    ),
    row("FLAC3D", &["f3grid"], Text(&["* flac3d"]), MESHIO),
    row(
        "Kratos (MDPA)",
        &["mdpa"],
        Text(&["begin modelpartdata"]),
        MESHIO,
    ),
    row("binary Medit", &["meshb"], If(is_binary_medit), MESHIO),
    row("binary AVS UCD", &[], If(is_binary_ucd), PARAVIEW),
    row("EnSight", &["case", "encas"], Never, PARAVIEW),
    row(
        "TetGen input",
        &["poly", "smesh"],
        Never,
        "mesh it with TetGen (tetgen -p {in}) and give the .node file",
    ),
    row(
        "STEP (CAD)",
        &["step", "stp"],
        Text(&["iso-10303-21"]),
        MESH_WITH_GMSH,
    ),
    row("IGES (CAD)", &["iges", "igs"], If(is_iges), MESH_WITH_GMSH),
    row(
        "BREP (CAD)",
        &["brep"],
        Text(&["dbrep_drawable", "cascade topology"]),
        MESH_WITH_GMSH,
    ),
    row(
        "CAD",
        &["sldprt", "sat", "x_t", "x_b", "ipt", "jt", "3dm"],
        Never,
        "export it as STEP and mesh that with Gmsh (gmsh -3 FILE.step -o FILE.msh)",
    ),
    row("Gmsh geometry", &["geo"], Never, MESH_WITH_GMSH),
    row(
        "OFF",
        &["off"],
        Text(&["off\n", "off\r", "off ", "coff"]),
        MESHIO_SURFACE,
    ),
    row("VRML", &["wrl", "vrml"], Text(&["#vrml"]), BLENDER),
    row("3MF", &["3mf"], Never, BLENDER),
    row(
        "glTF, FBX, USD, 3DS or Blender",
        &[
            "gltf", "glb", "fbx", "3ds", "blend", "usd", "usdz", "usda", "usdc",
        ],
        Bytes(b"glTF"),
        BLENDER,
    ),
    row(
        "FreeSurfer surface",
        &["pial", "white", "inflated", "smoothwm"],
        Bytes(b"\xff\xff\xfe"),
        FREESURFER,
    ),
    volume(
        "DICOM without `DICM` at byte 128",
        &["dcm", "dicom", "ima"],
        Never,
        "add the header with `dcmconv +F` (DCMTK), or convert it with dcm2niix",
    ),
    volume(
        "AFNI",
        &["brik", "head"],
        Never,
        "convert it with `3dAFNItoNIFTI` or nibabel",
    ),
    volume(
        "Philips PAR/REC",
        &["par", "rec"],
        Never,
        "convert it with dcm2niix or `parrec2nii` (nibabel)",
    ),
    volume(
        "MRtrix",
        &["mif", "mih"],
        Text(&["mrtrix image"]),
        "convert it with `mrconvert {in} {out}.nii.gz`",
    ),
    volume(
        "GIPL",
        &["gipl"],
        Never,
        "convert it to .nii.gz with ITK-SNAP, 3D Slicer or SimpleITK",
    ),
    volume(
        "BXH/XCEDE",
        &["bxh", "xcede"],
        Never,
        "name its data file, or convert it with `bxh2analyze --niigz`",
    ),
    volume(
        "Interfile",
        &["hv", "h33", "i33"],
        Text(&["!interfile"]),
        "convert it with `medcon -c nifti`",
    ),
    volume(
        "ECAT",
        &[],
        Bytes(b"MATRIX7"),
        "convert it with nibabel or `medcon -c nifti`",
    ),
    volume(
        "Amira",
        &["am", "amira"],
        Text(&["# amiramesh", "# avizo"]),
        "open it in Amira or Fiji and save it as .nrrd",
    ),
    volume(
        "3D Slicer scene",
        &["mrb", "mrml"],
        Never,
        "open it in 3D Slicer and save its volume as .nrrd",
    ),
    volume(
        "TIFF",
        &["tif", "tiff"],
        If(is_tiff),
        "load the stack in 3D Slicer or Fiji, set its spacing, and save it as .nrrd",
    ),
    volume(
        "PNG, JPEG, GIF or BMP picture",
        &["png", "jpg", "jpeg", "gif", "bmp"],
        If(is_picture),
        "load the stack of pictures in 3D Slicer or Fiji, set its spacing, and save it as .nrrd",
    ),
    volume(
        "microscope image",
        &["czi", "lif", "nd2", "ims", "oib", "lsm"],
        Never,
        "save it as .nrrd with Fiji (Bio-Formats)",
    ),
    volume(
        "NumPy array",
        &["npy", "npz"],
        Bytes(b"\x93NUMPY"),
        "in Python use `palpate.Volume(array, affine)`",
    ),
    volume(
        "MATLAB array",
        &["mat"],
        Text(&["matlab 5.0"]),
        "write it as .nii.gz with nibabel, or as .vtu with meshio",
    ),
    volume(
        "voxels without a header",
        &["raw", "zraw"],
        Never,
        "name its header in the same folder (.mhd or .nhdr)",
    ),
    volume(
        "voxels without a header",
        &["img"],
        Never,
        "its header, the .hdr of the same name, must be in the same folder",
    ),
];

const fn row(
    name: &'static str,
    extensions: &'static [&'static str],
    test: Test,
    remedy: &'static str,
) -> Other {
    Other {
        name,
        extensions,
        test,
        remedy,
        volume: false,
    }
}

/// A format of volumes.
const fn volume(
    name: &'static str,
    extensions: &'static [&'static str],
    test: Test,
    remedy: &'static str,
) -> Other {
    Other {
        volume: true,
        ..row(name, extensions, test, remedy)
    }
}

/// Compressed files and archives: magic bytes, name, and the command that extracts them.
const PACKED: [(&[u8], &str, &str); 6] = [
    (b"\x1f\x8b", "gzip", "gunzip"),
    (b"BZh", "bzip2", "bunzip2"),
    (b"\xfd7zXZ\0", "xz", "unxz"),
    (b"\x28\xb5\x2f\xfd", "Zstandard", "unzstd"),
    (b"PK\x03\x04", "zip", "unzip"),
    (b"7z\xbc\xaf\x27\x1c", "7-Zip", "7z x"),
];

impl Other {
    fn recognises(&self, bytes: &[u8], start: &str) -> bool {
        match self.test {
            Text(starts) => starts.iter().any(|s| start.starts_with(s)),
            Bytes(magic) => bytes.starts_with(magic),
            Hdf5(words) => bytes.starts_with(HDF5) && words.iter().any(|w| holds(bytes, w)),
            Xml(root) => start.starts_with('<') && start.contains(root),
            If(test) => test(bytes, start),
            Never => false,
        }
    }

    /// Returns what converts the file, which has that extension.
    fn remedy(&self, extension: &str) -> String {
        let file = match extension {
            "" => "FILE".to_owned(),
            _ => format!("FILE.{extension}"),
        };
        self.remedy.replace("{in}", &file).replace("{out}", "FILE")
    }
}

/// Names the unsupported format of a file by its content, and what converts it.
pub(super) fn by_content(bytes: &[u8], extension: &str) -> Option<String> {
    let packed = PACKED.iter().find(|(magic, ..)| bytes.starts_with(magic));
    if let Some((_, name, command)) = packed {
        // Some formats are archives themselves.
        return by_extension(extension).or_else(|| {
            Some(format!(
                "file is compressed with {name}; decompress it first ({command})"
            ))
        });
    }
    let other = of_content(bytes, extension)?;
    Some(format!(
        "file has the format {}, which is not supported; {}",
        other.name,
        other.remedy(extension)
    ))
}

/// Names the unsupported format of a file by its extension, and what converts it.
pub(super) fn by_extension(extension: &str) -> Option<String> {
    let other = of_extension(extension)?;
    Some(format!(
        "extension .{extension} denotes the format {}, which is not supported; {}",
        other.name,
        other.remedy(extension)
    ))
}

/// As [`by_content`], then [`by_extension`], for volumes only.
pub(super) fn of_volume(bytes: &[u8], extension: &str) -> Option<String> {
    let packed = PACKED.iter().any(|(magic, ..)| bytes.starts_with(magic));
    match of_content(bytes, extension).or_else(|| of_extension(extension)) {
        Some(other) if !other.volume => None,
        None if !packed => None,
        _ => by_content(bytes, extension).or_else(|| by_extension(extension)),
    }
}

fn of_content(bytes: &[u8], extension: &str) -> Option<&'static Other> {
    let start = start_of(bytes);
    let other = OTHERS.iter().find(|o| o.recognises(bytes, &start))?;
    // The extension tells what a container of many formats holds.
    Some(match other.name {
        "HDF5" | "NetCDF" => of_extension(extension).unwrap_or(other),
        _ => other,
    })
}

fn of_extension(extension: &str) -> Option<&'static Other> {
    OTHERS.iter().find(|o| o.extensions.contains(&extension))
}

fn holds(bytes: &[u8], word: &str) -> bool {
    let searched = &bytes[..bytes.len().min(1 << 16)];
    searched.windows(word.len()).any(|w| w == word.as_bytes())
}

fn is_netcdf(bytes: &[u8], _: &str) -> bool {
    matches!(bytes, [b'C', b'D', b'F', 1 | 2 | 5, ..])
}

fn is_exodus(bytes: &[u8], start: &str) -> bool {
    (is_netcdf(bytes, start) || bytes.starts_with(HDF5))
        && ["num_el_blk", "eb_prop1"].iter().any(|w| holds(bytes, w))
}

fn lines(start: &str) -> impl Iterator<Item = &str> {
    start.lines().map(str::trim).filter(|l| !l.is_empty())
}

fn is_unv(_: &[u8], start: &str) -> bool {
    let mut lines = lines(start);
    lines.next() == Some("-1")
        && lines
            .next()
            .is_some_and(|l| l.bytes().all(|b| b.is_ascii_digit()))
}

fn is_nastran(_: &[u8], start: &str) -> bool {
    lines(start).any(|l| {
        let grid = l.strip_prefix("grid").unwrap_or_default();
        l.starts_with("begin bulk") || grid.starts_with([',', '*', ' '])
    })
}

fn is_ls_dyna(_: &[u8], start: &str) -> bool {
    let mut lines = lines(start).filter(|l| !l.starts_with('$'));
    lines.next().is_some_and(|l| l.starts_with("*keyword"))
}

fn is_cdb(_: &[u8], start: &str) -> bool {
    ["/com", "/prep7", "/batch"]
        .iter()
        .any(|word| start.starts_with(word))
        || lines(start).any(|l| l.starts_with("nblock,"))
}

fn is_fluent(_: &[u8], start: &str) -> bool {
    let number = start.strip_prefix('(').and_then(|s| s.split(' ').next());
    number.is_some_and(|n| n.parse::<u8>().is_ok())
}

fn is_openfoam(_: &[u8], start: &str) -> bool {
    lines(start).any(|l| l.starts_with("foamfile"))
}

fn is_binary_medit(bytes: &[u8], _: &str) -> bool {
    matches!(bytes, [1, 0, 0, 0, 1..=4, 0, 0, 0, ..])
}

fn is_binary_ucd(bytes: &[u8], _: &str) -> bool {
    // A byte 7 and six 32-bit counts, of which none is large.
    matches!(bytes, [7, 0, ..] | [7, _, _, _, 0, ..]) && bytes.len() > 25
}

/// Cards have 80 columns; column 73 of the first holds an S, its number follows.
fn is_iges(bytes: &[u8], _: &str) -> bool {
    bytes.get(72) == Some(&b'S')
        && bytes
            .get(73..80)
            .is_some_and(|n| matches!(n.trim_ascii(), b"1" | b"0000001"))
}

fn is_tiff(bytes: &[u8], _: &str) -> bool {
    bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*")
}

fn is_picture(bytes: &[u8], _: &str) -> bool {
    let starts: [&[u8]; 3] = [b"\x89PNG", b"\xff\xd8\xff", b"GIF8"];
    starts.iter().any(|s| bytes.starts_with(s))
}
