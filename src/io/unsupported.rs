//! Meshes in formats that are not read: their names, and programs that convert them.

/// Magic bytes of HDF5, the container of several formats.
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Magic bytes of NetCDF 3, in which Exodus files are stored, too.
const NETCDF: &[u8] = b"CDF";

/// Compressed files and archives, by their magic bytes.
const PACKED: [(&[u8], &str, &str); 6] = [
    (b"\x1f\x8b", "gzip", "gunzip"),
    (b"BZh", "bzip2", "bunzip2"),
    (b"\xfd7zXZ\0", "xz", "unxz"),
    (b"\x28\xb5\x2f\xfd", "Zstandard", "unzstd"),
    (b"PK\x03\x04", "zip", "unzip"),
    (b"7z\xbc\xaf\x27\x1c", "7-Zip", "7z x"),
];

/// Returns why the mesh in the content of a file with that extension cannot be read, with what
/// makes it readable; `None` if it may be in a supported format.
pub(super) fn reason(bytes: &[u8], extension: &str) -> Option<String> {
    let packed = PACKED.iter().find(|(magic, ..)| bytes.starts_with(magic));
    if let Some((_, name, command)) = packed {
        return Some(format!(
            "file is compressed with {name}; decompress it first ({command})"
        ));
    }
    let (name, converters) = format_of(bytes, extension)?;
    Some(format!(
        "{name} files are not supported; convert the file to .vtu with {converters}"
    ))
}

/// Returns the name of an unsupported format, and what converts it.
fn format_of(bytes: &[u8], extension: &str) -> Option<(&'static str, &'static str)> {
    const MESHIO: &str = "meshio (`meshio convert IN OUT.vtu`) or ParaView (File > Save Data)";
    const PARAVIEW: &str = "ParaView (File > Save Data)";
    let start = super::start_of(bytes);
    if start.starts_with('<') && start.contains("<xdmf") {
        return Some(("XDMF", MESHIO));
    }
    let container = bytes.starts_with(HDF5) || bytes.starts_with(NETCDF);
    Some(match (extension, container) {
        ("xdmf" | "xmf" | "xdmf3", false) => ("XDMF", MESHIO),
        ("xdmf" | "xmf" | "h5" | "hdf5" | "hdf", true) => (
            "HDF5",
            "meshio or ParaView: open the .xdmf file beside it, if there is one",
        ),
        ("exo" | "ex2" | "exii" | "e" | "g" | "gen", _) => ("Exodus II", MESHIO),
        ("cgns", _) => ("CGNS", MESHIO),
        ("med", _) => ("Salome MED", MESHIO),
        ("vtkhdf", _) => ("VTKHDF", PARAVIEW),
        ("case" | "encas", _) => ("EnSight", PARAVIEW),
        _ if bytes.starts_with(NETCDF) => ("NetCDF (Exodus II)", MESHIO),
        _ if bytes.starts_with(HDF5) => ("HDF5", MESHIO),
        _ => return None,
    })
}
