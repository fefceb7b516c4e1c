//! Reader for the VTK legacy format: unstructured grids and polygons (POLYDATA) of versions 2 to 5,
//! ASCII and binary.
//!
//! The `vtkio` crate (0.6.3) was tested on real files and on the output of VTK 9: it rejects
//! version 5 (`OFFSETS`/`CONNECTIVITY`) and arrays with 64-bit types, so this is a separate reader.

use super::cell_kinds::polygon_kind;
use super::cursor::{Cursor, ParseResult};
use super::raw_mesh::RawMesh;
use super::vtk_legacy_data::Values;
use super::vtk_regions::Global;
use crate::mesh::{AnatomicalFrame, Field, Location, ScalarType};
use glam::DVec3;

/// Magic bytes of the format.
pub(super) const MAGIC: &[u8] = b"# vtk DataFile";

/// Reads the mesh or surface in the content of a legacy VTK file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let file = File::open(bytes, &["UNSTRUCTURED_GRID", "POLYDATA"])?;
    let mut mesh = file.read()?.finish()?;
    // 3D Slicer states it in the title.
    mesh.frame = AnatomicalFrame::stated_in(bytes);
    Ok(mesh)
}

/// An image on a regular grid.
pub(super) struct Image {
    /// Number of points along each axis.
    pub points: [usize; 3],
    pub spacing: DVec3,
    /// Position of the first point.
    pub origin: DVec3,
    pub fields: Vec<Field>,
    pub warnings: Vec<String>,
}

/// Reads the image in the content of a legacy VTK file.
pub(super) fn read_image(bytes: &[u8]) -> ParseResult<Image> {
    let file = File::open(bytes, &["STRUCTURED_POINTS"])?.read()?;
    let points = file.grid.points.ok_or("file has no DIMENSIONS")?;
    Ok(Image {
        points,
        spacing: file.grid.spacing,
        origin: file.grid.origin,
        fields: file.mesh.fields,
        warnings: file.mesh.warnings,
    })
}

/// Whether this is a legacy VTK file of the kind `dataset`, in capitals.
pub(super) fn holds(bytes: &[u8], dataset: &str) -> bool {
    let head = &bytes[..bytes.len().min(1024)];
    let head = String::from_utf8_lossy(head).to_uppercase();
    bytes.starts_with(MAGIC) && head.contains(&format!("DATASET {dataset}"))
}

/// The grid of an image.
struct Grid {
    points: Option<[usize; 3]>,
    spacing: DVec3,
    origin: DVec3,
}
/// A file that is being read.
pub(super) struct File<'a> {
    pub from: Values<'a>,
    version: u32,
    pub mesh: RawMesh,
    has_points: bool,
    /// Nodes of all cells, and the end of each cell's nodes.
    cells: Option<(Vec<f64>, Vec<usize>)>,
    kinds: Option<Vec<f64>>,
    grid: Grid,
    /// Whether the file contains polygons instead of cells of any type.
    polygonal: bool,
    /// Owner of the attributes being read; `None` before POINT_DATA and CELL_DATA, where arrays
    /// belong to the whole file.
    pub owner: Option<Owner>,
    /// Whether the last array became a field.
    pub kept: bool,
    pub global: Global,
}

/// Owner of attributes: nodes or cells.
#[derive(Clone, Copy)]
pub(super) struct Owner {
    pub location: Location,
    /// Their number.
    pub items: usize,
    /// The number of tuples that the file announces.
    pub tuples: usize,
}

impl<'a> File<'a> {
    /// Reads the header of a file of one of the `kinds`.
    fn open(bytes: &'a [u8], kinds: &[&str]) -> ParseResult<File<'a>> {
        let mut at = Cursor::new(bytes);
        let first = String::from_utf8_lossy(at.rest_of_line()).into_owned();
        let version = first
            .rsplit(' ')
            .next()
            .and_then(|v| v.split('.').next())
            .and_then(|v| v.parse().ok())
            .filter(|_| first.starts_with("# vtk DataFile"))
            .ok_or_else(|| {
                format!("line 1: expected \"# vtk DataFile Version x.y\", found {first:?}")
            })?;
        if !(1..=5).contains(&version) {
            return Err(format!(
                "line 1: legacy VTK version {version} is not supported; use version 1 to 5"
            ));
        }
        at.rest_of_line(); // the title
        let mode = at
            .word(format_args!("ASCII or BINARY"))?
            .to_ascii_uppercase();
        let ascii = match mode.as_str() {
            "ASCII" => true,
            "BINARY" => false,
            _ => return Err(at.error(format_args!("expected ASCII or BINARY, found {mode:?}"))),
        };
        let dataset = at.word(format_args!("DATASET"))?.to_ascii_uppercase();
        let kind = at
            .word(format_args!("the kind of DATASET"))?
            .to_ascii_uppercase();
        if dataset != "DATASET" || !kinds.contains(&kind.as_str()) {
            let help = match kind.as_str() {
                "UNSTRUCTURED_GRID" => "it is a mesh of cells",
                "POLYDATA" => "it is a surface",
                "STRUCTURED_POINTS" => {
                    "it is an image on a regular grid, which is read as a volume"
                }
                _ => "convert the file to .vtu with ParaView (filter Append Datasets)",
            };
            return Err(at.error(format_args!(
                "expected DATASET {}, found {dataset} {kind}; {help}",
                kinds.join(" or ")
            )));
        }
        at.rest_of_line();
        at.binary = !ascii;
        Ok(File {
            from: Values::new(at, ascii),
            version,
            mesh: RawMesh::default(),
            has_points: false,
            cells: None,
            kinds: None,
            grid: Grid {
                points: None,
                spacing: DVec3::ONE,
                origin: DVec3::ZERO,
            },
            polygonal: kind == "POLYDATA",
            owner: None,
            kept: false,
            global: Global::default(),
        })
    }

    /// Reads all sections.
    fn read(mut self) -> ParseResult<File<'a>> {
        while let Some(token) = self.from.at.token() {
            let keyword = String::from_utf8_lossy(token).to_ascii_uppercase();
            match keyword.as_str() {
                "POINTS" => self.points()?,
                "CELLS" if !self.polygonal => self.cells()?,
                "CELL_TYPES" if !self.polygonal => self.cell_types()?,
                "VERTICES" | "LINES" | "POLYGONS" | "TRIANGLE_STRIPS" if self.polygonal => {
                    self.polygons(&keyword)?;
                }
                "DIMENSIONS" => self.dimensions()?,
                "SPACING" | "ASPECT_RATIO" => self.grid.spacing = self.vector(&keyword)?,
                "ORIGIN" => self.grid.origin = self.vector(&keyword)?,
                "POINT_DATA" => self.data_of(Location::Node)?,
                "CELL_DATA" => self.data_of(Location::Cell)?,
                "METADATA" => self.from.skip_metadata(),
                _ => self.attribute_or_note(&keyword)?,
            }
        }
        Ok(self)
    }

    fn dimensions(&mut self) -> ParseResult<()> {
        let mut points = [0; 3];
        for n in &mut points {
            let count = self.from.at.integer(format_args!("DIMENSIONS"))?;
            *n = usize::try_from(count)
                .ok()
                .filter(|n| *n > 0)
                .ok_or_else(|| {
                    self.from
                        .at
                        .error(format_args!("DIMENSIONS must be ≥ 1, got {count}"))
                })?;
        }
        self.grid.points = Some(points);
        Ok(())
    }

    fn vector(&mut self, keyword: &str) -> ParseResult<DVec3> {
        let mut number = || self.from.at.number(format_args!("{keyword}"));
        Ok(DVec3::new(number()?, number()?, number()?))
    }

    fn points(&mut self) -> ParseResult<()> {
        let count = self
            .from
            .at
            .count(format_args!("the number of POINTS"), 3)?;
        let mut kind = self.from.type_name("POINTS")?;
        if self.from.ascii && kind.eq_ignore_ascii_case("float") {
            // Many writers declare float and print the digits of a double: all digits are kept.
            kind = "double".into();
        }
        let values = self
            .from
            .values(count, 3, &kind, "POINTS")?
            .ok_or_else(|| self.from.at.error("POINTS cannot be strings"))?;
        self.mesh.nodes = values
            .0
            .as_chunks()
            .0
            .iter()
            .map(|p| DVec3::from_array(*p))
            .collect();
        self.has_points = true;
        Ok(())
    }

    fn cells(&mut self) -> ParseResult<()> {
        self.cells = Some(self.node_lists("CELLS")?);
        Ok(())
    }

    /// Adds the cells of a section of polygons or the like to the previous ones.
    fn polygons(&mut self, section: &str) -> ParseResult<()> {
        let (nodes, ends) = self.node_lists(section)?;
        let (all_nodes, all_ends) = self.cells.get_or_insert_default();
        let kinds = self.kinds.get_or_insert_default();
        let mut start = 0;
        for end in &ends {
            kinds.push(f64::from(polygon_kind(section, end - start)));
            start = *end;
        }
        let before = all_nodes.len();
        all_nodes.extend(nodes);
        all_ends.extend(ends.iter().map(|end| before + end));
        Ok(())
    }

    /// Reads the nodes of the cells of a section, and the end of each cell's nodes.
    fn node_lists(&mut self, section: &str) -> ParseResult<(Vec<f64>, Vec<usize>)> {
        let count = self
            .from
            .at
            .count(format_args!("the number of {section}"), 1)?;
        let size = self
            .from
            .at
            .count(format_args!("the size of the {section} list"), 1)?;
        self.from.at.rest_of_line();
        let split = self.version >= 5
            && self
                .from
                .at
                .peek()
                .is_some_and(|t| t.eq_ignore_ascii_case(b"OFFSETS"));
        if split {
            return self.from.split_cells(count, size);
        }
        let list = self.from.numbers(size, ScalarType::I32, section)?;
        self.from.counted_cells(count, &list)
    }

    fn cell_types(&mut self) -> ParseResult<()> {
        let count = self
            .from
            .at
            .count(format_args!("the number of CELL_TYPES"), 1)?;
        self.from.at.rest_of_line();
        self.kinds = Some(self.from.numbers(count, ScalarType::I32, "CELL_TYPES")?);
        Ok(())
    }

    fn data_of(&mut self, location: Location) -> ParseResult<()> {
        let less = usize::from(location == Location::Cell);
        let on_grid = self.grid.points.and_then(|points| {
            let items = points.map(|n| if n > 1 { n - less } else { 1 });
            items.iter().try_fold(1usize, |all, n| all.checked_mul(*n))
        });
        let (name, items) = match location {
            Location::Node => (
                "POINT_DATA",
                Some(self.mesh.nodes.len()).filter(|_| self.has_points),
            ),
            Location::Cell => ("CELL_DATA", self.cells.as_ref().map(|(_, ends)| ends.len())),
        };
        let count = self
            .from
            .at
            .integer(format_args!("the number of {name} tuples"))?;
        let Some(items) = items.or(on_grid) else {
            return Err(self.from.at.error(format_args!(
                "{name} must follow the {location} it belongs to"
            )));
        };
        let tuples = usize::try_from(count).map_err(|_| {
            self.from
                .at
                .error(format_args!("{name} must have ≥ 0 tuples, got {count}"))
        })?;
        self.owner = Some(Owner {
            location,
            items,
            tuples,
        });
        Ok(())
    }

    fn finish(self) -> ParseResult<RawMesh> {
        let mut mesh = self.mesh;
        let missing = |what: &str| format!("file has no {what}");
        if !self.has_points {
            return Err(missing("POINTS section"));
        }
        if self.polygonal && self.cells.is_none() {
            return Err(missing("POLYGONS section"));
        }
        let (nodes, ends) = self.cells.ok_or_else(|| missing("CELLS section"))?;
        let kinds = self.kinds.ok_or_else(|| missing("CELL_TYPES section"))?;
        if kinds.len() != ends.len() {
            return Err(format!(
                "file has {} CELLS, but {} CELL_TYPES",
                ends.len(),
                kinds.len()
            ));
        }
        mesh.add_cells(&kinds, &nodes, &ends)?;
        self.global.add_to(&mut mesh);
        Ok(mesh)
    }
}
