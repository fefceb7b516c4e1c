//! Reader for the VTK legacy format: unstructured grids and polygons (POLYDATA) of versions 2 to 5,
//! ASCII and binary.
//!
//! The `vtkio` crate (0.6.3) was tested on real files and on the output of VTK 9: it rejects
//! version 5 (`OFFSETS`/`CONNECTIVITY`) and arrays with 64-bit types, so this is a separate reader.

use super::cursor::{Cursor, ParseResult};
use super::raw_mesh::RawMesh;
use super::vtk_legacy_data::Values;
use super::vtk_legacy_names::decoded;
use super::vtk_regions::Global;
use crate::mesh::{AnatomicalFrame, Field, Location, ScalarType};
use glam::DVec3;

/// Magic bytes of the format.
pub(super) const MAGIC: &[u8] = b"# vtk DataFile";

/// Reads the content of a legacy VTK file.
pub(super) fn read(bytes: &[u8]) -> ParseResult<RawMesh> {
    let mut file = File::open(bytes)?;
    while let Some(token) = file.from.at.token() {
        let keyword = String::from_utf8_lossy(token).to_ascii_uppercase();
        match keyword.as_str() {
            "POINTS" => file.points()?,
            "CELLS" if !file.polygonal => file.cells()?,
            "CELL_TYPES" if !file.polygonal => file.cell_types()?,
            "VERTICES" | "LINES" | "POLYGONS" | "TRIANGLE_STRIPS" if file.polygonal => {
                file.polygons(&keyword)?;
            }
            "POINT_DATA" => file.data_of(Location::Node)?,
            "CELL_DATA" => file.data_of(Location::Cell)?,
            "METADATA" => file.from.skip_metadata(),
            _ => file.attribute(&keyword)?,
        }
    }
    let mut mesh = file.finish()?;
    // 3D Slicer states it in the title.
    mesh.frame = AnatomicalFrame::stated_in(bytes);
    Ok(mesh)
}

struct File<'a> {
    from: Values<'a>,
    version: u32,
    mesh: RawMesh,
    has_points: bool,
    /// Nodes of all cells, and the end of each cell's nodes.
    cells: Option<(Vec<f64>, Vec<usize>)>,
    kinds: Option<Vec<f64>>,
    /// Whether the file contains polygons instead of cells of any type.
    polygonal: bool,
    /// Location of the attributes being read, and number of their tuples; `None` before POINT_DATA
    /// and CELL_DATA, where arrays belong to the whole file.
    owner: Option<(Location, usize)>,
    global: Global,
}

impl<'a> File<'a> {
    fn open(bytes: &'a [u8]) -> ParseResult<File<'a>> {
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
        if dataset != "DATASET" || !["UNSTRUCTURED_GRID", "POLYDATA"].contains(&kind.as_str()) {
            return Err(at.error(format_args!(
                "expected DATASET UNSTRUCTURED_GRID (a mesh of cells) or POLYDATA (a surface), found {dataset} {kind}"
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
            polygonal: kind == "POLYDATA",
            owner: None,
            global: Global::default(),
        })
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
            let (one, several) = match section {
                "VERTICES" => (1.0, 2.0),
                "LINES" => (3.0, 4.0),
                "POLYGONS" => (7.0, 7.0),
                _ => (6.0, 6.0),
            };
            let single = end - start <= if section == "LINES" { 2 } else { 1 };
            kinds.push(if single { one } else { several });
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
        match items {
            Some(items) if usize::try_from(count) == Ok(items) => {
                self.owner = Some((location, items));
                Ok(())
            }
            Some(items) => Err(self.from.at.error(format_args!(
                "{name} announces {count} tuples, but there are {items} {location}"
            ))),
            None => Err(self.from.at.error(format_args!(
                "{name} must follow the {location} it belongs to"
            ))),
        }
    }

    /// Reads SCALARS, VECTORS, FIELD and similar attributes.
    fn attribute(&mut self, keyword: &str) -> ParseResult<()> {
        if keyword == "FIELD" {
            return self.field_arrays();
        }
        let known = [
            "SCALARS",
            "COLOR_SCALARS",
            "LOOKUP_TABLE",
            "VECTORS",
            "NORMALS",
            "TENSORS",
            "TENSORS6",
            "TEXTURE_COORDINATES",
            "GLOBAL_IDS",
            "PEDIGREE_IDS",
            "EDGE_FLAGS",
        ];
        if !known.contains(&keyword) {
            let shown: String = keyword.chars().take(40).collect();
            return Err(self.from.at.error(format_args!(
                "expected POINTS, CELLS, CELL_TYPES, POINT_DATA, CELL_DATA, FIELD or the name of an attribute, found {shown:?}"
            )));
        }
        let name = decoded(self.from.at.word(format_args!("the name of {keyword}"))?);
        if keyword == "LOOKUP_TABLE" {
            let rows = self
                .from
                .at
                .count(format_args!("the size of LOOKUP_TABLE {name}"), 4)?;
            return self.from.colours(rows, 4, &name).map(|_| ());
        }
        let Some((location, tuples)) = self.owner else {
            return Err(self.from.at.error(format_args!(
                "{keyword} {name} must follow POINT_DATA or CELL_DATA"
            )));
        };
        let (components, values) = match keyword {
            "COLOR_SCALARS" => {
                let components = self
                    .from
                    .components(format_args!("components of COLOR_SCALARS {name}"))?;
                (
                    components,
                    Some(self.from.colours(tuples, components, &name)?),
                )
            }
            "SCALARS" => self.scalars(tuples, &name)?,
            _ => {
                let components = match keyword {
                    "VECTORS" | "NORMALS" => 3,
                    "TENSORS" => 9,
                    "TENSORS6" => 6,
                    "TEXTURE_COORDINATES" => self
                        .from
                        .components(format_args!("dimensions of TEXTURE_COORDINATES {name}"))?,
                    _ => 1,
                };
                let kind = self.from.type_name(&name)?;
                (
                    components,
                    self.from.values(tuples, components, &kind, &name)?,
                )
            }
        };
        self.keep(name, location, components, values);
        Ok(())
    }

    /// Reads the components and values of SCALARS.
    fn scalars(
        &mut self,
        tuples: usize,
        name: &str,
    ) -> ParseResult<(usize, Option<(Vec<f64>, ScalarType)>)> {
        let kind = self
            .from
            .at
            .word(format_args!("the type of SCALARS {name}"))?
            .to_string();
        let given = String::from_utf8_lossy(self.from.at.rest_of_line())
            .trim()
            .to_string();
        let components = if given.is_empty() {
            Ok(1)
        } else {
            given.parse()
        };
        let components: usize = components
            .ok()
            .filter(|c| (1..=1 << 16).contains(c))
            .ok_or_else(|| {
                self.from.at.error(format_args!(
                    "SCALARS {name}: number of components must be 1 to 65536, got \
                    {given:?}"
                ))
            })?;
        self.from.skip_table_name();
        let values = self.from.values(tuples, components, &kind, name)?;
        Ok((components, values))
    }

    /// Reads FIELD name n: n arrays, each with its own name, width, length and type.
    fn field_arrays(&mut self) -> ParseResult<()> {
        self.from.at.word(format_args!("the name of FIELD"))?;
        let arrays = self
            .from
            .at
            .count(format_args!("the number of arrays in FIELD"), 1)?;
        for array in 0..arrays {
            let mut name = self
                .from
                .at
                .word(format_args!("the name of array {array} of FIELD"))?;
            while name == "METADATA" {
                self.from.skip_metadata();
                name = self
                    .from
                    .at
                    .word(format_args!("the name of array {array} of FIELD"))?;
            }
            if name == "NULL_ARRAY" {
                continue;
            }
            let name = decoded(name);
            let components = self
                .from
                .components(format_args!("components of array {name}"))?;
            let tuples = self
                .from
                .at
                .count(format_args!("tuples of array {name}"), 0)?;
            let kind = self.from.type_name(&name)?;
            let values = self.from.values(tuples, components, &kind, &name)?;
            match self.owner {
                Some((location, items)) if tuples == items => {
                    self.keep(name, location, components, values);
                }
                Some((location, items)) => self.mesh.warnings.push(format!(
                    "array \"{name}\" skipped: it has {tuples} tuples, but there are {items} \
                    {location}"
                )),
                // An array of the whole mesh.
                None => {
                    if let Some((values, _)) = values {
                        self.global.array(&name, &values);
                    }
                }
            }
        }
        Ok(())
    }

    fn keep(
        &mut self,
        name: String,
        location: Location,
        components: usize,
        values: Option<(Vec<f64>, ScalarType)>,
    ) {
        match values {
            Some((values, scalar_type)) => self.mesh.fields.push(Field {
                name,
                location,
                components,
                values,
                scalar_type,
            }),
            None => self
                .mesh
                .warnings
                .push(format!("array \"{name}\" skipped: it is not numeric")),
        }
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
        mesh.add_cells(&kinds, &nodes, &ends, 0)?;
        self.global.add_to(&mut mesh);
        Ok(mesh)
    }
}
