//! Writers for surfaces: binary PLY with scalar fields, OBJ with texture coordinates, binary STL.

use crate::io::{atomic_write, extension};
use crate::mesh::{Field, Location, TriMesh};
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;

/// Writes a surface as `.ply`, `.obj` or `.stl`, atomically. PLY stores positions in double
/// precision and the scalar fields of the vertices; STL stores single precision.
///
/// # Errors
/// An error for another extension, for more triangles than the format can count, or if the file
/// cannot be written.
pub fn write_surface(path: impl AsRef<Path>, surface: &TriMesh) -> Result<()> {
    let path = path.as_ref();
    let fill: fn(&TriMesh, &mut dyn Write) -> std::io::Result<()> = match extension(path).as_str() {
        "ply" => ply,
        "obj" => obj,
        "stl" => stl,
        other => {
            return Err(Error::Input(format!(
                "{}: unsupported surface extension \".{other}\"; use .ply, .obj or .stl",
                path.display()
            )));
        }
    };
    if u32::try_from(surface.triangles.len()).is_err() {
        return Err(Error::Input(format!(
            "{}: {} triangles exceed the 32-bit count of the format",
            path.display(),
            surface.triangles.len()
        )));
    }
    atomic_write(path, |file| fill(surface, file).map_err(Error::io(path)))
}

/// Returns a line that states the frame of reference, as 3D Slicer reads it; empty if it is unknown.
fn frame_line(before: &str, surface: &TriMesh) -> String {
    let frame = surface.frame;
    frame.map_or(String::new(), |f| format!("{before}{}\n", f.statement()))
}

fn ply(surface: &TriMesh, file: &mut dyn Write) -> std::io::Result<()> {
    let fields: Vec<&Field> = surface
        .fields
        .iter()
        .filter(|f| f.location == Location::Node && f.components == 1)
        .filter(|f| f.values.len() == surface.vertices.len())
        .collect();
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\n{}element vertex {}\nproperty double x\nproperty double y\nproperty double z\n",
        frame_line("comment ", surface),
        surface.vertices.len()
    )?;
    for field in &fields {
        // A name is one word.
        let name: String = field.name.split_whitespace().collect::<Vec<_>>().join("_");
        writeln!(file, "property double {name}")?;
    }
    write!(
        file,
        "element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        surface.triangles.len()
    )?;
    for (n, p) in surface.vertices.iter().enumerate() {
        for value in p.to_array() {
            file.write_all(&value.to_le_bytes())?;
        }
        for field in &fields {
            file.write_all(&field.values[n].to_le_bytes())?;
        }
    }
    for triangle in &surface.triangles {
        file.write_all(&[3])?;
        for v in triangle {
            file.write_all(&v.to_le_bytes())?;
        }
    }
    Ok(())
}

fn obj(surface: &TriMesh, file: &mut dyn Write) -> std::io::Result<()> {
    write!(file, "{}", frame_line("# ", surface))?;
    for p in &surface.vertices {
        writeln!(file, "v {} {} {}", p.x, p.y, p.z)?;
    }
    let uvs = surface.corner_uvs();
    for uv in uvs.iter().flatten().flatten() {
        writeln!(file, "vt {} {}", uv.x, uv.y)?;
    }
    for (n, triangle) in surface.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        if uvs.is_some() {
            let [x, y, z] = [1, 2, 3].map(|k| 3 * n as u64 + k);
            writeln!(file, "f {a}/{x} {b}/{y} {c}/{z}")?;
        } else {
            writeln!(file, "f {a} {b} {c}")?;
        }
    }
    Ok(())
}

fn stl(surface: &TriMesh, file: &mut dyn Write) -> std::io::Result<()> {
    let mut header = [b' '; 80];
    let title = frame_line("binary STL, Palpate. ", surface);
    let title = match title.trim_end() {
        "" => "binary STL, Palpate",
        title => title,
    };
    header[..title.len()].copy_from_slice(title.as_bytes());
    file.write_all(&header)?;
    file.write_all(&(surface.triangles.len() as u32).to_le_bytes())?;
    for triangle in &surface.triangles {
        let [p, q, r] = triangle.map(|v| surface.vertices[v as usize]);
        let normal = (q - p).cross(r - p).normalize_or_zero();
        for v in [normal, p, q, r] {
            for value in v.to_array() {
                file.write_all(&(value as f32).to_le_bytes())?;
            }
        }
        file.write_all(&[0; 2])?;
    }
    Ok(())
}
