//! Gmsh sections $NodeData and $ElementData: values by node or element tag.

use super::cursor::ParseResult;
use super::gmsh_source::Source;
use super::raw_mesh::RawMesh;
use super::ten_node::fill_middles;
use crate::mesh::{Field, Location, ScalarType};

/// One section of values.
pub(super) struct DataSection {
    name: String,
    components: usize,
    tags: Vec<u64>,
    values: Vec<f64>,
}

impl DataSection {
    /// Reads the content of $NodeData or $ElementData.
    pub fn read(at: &mut Source) -> ParseResult<DataSection> {
        let mut name = String::new();
        for i in 0..at.ascii_count(format_args!("the number of string tags"), 1)? {
            let text = at.line();
            if i == 0 {
                name = text.trim_matches('"').to_string();
            }
        }
        for _ in 0..at.ascii_count(format_args!("the number of real tags"), 1)? {
            at.line();
        }
        let mut counts = [0; 3];
        for i in 0..at.ascii_count(format_args!("the number of integer tags"), 1)? {
            let text = at.line();
            if let Some(count) = counts.get_mut(i) {
                *count = text.parse::<usize>().map_err(|_| {
                    at.error(format_args!("integer tag {i} of \"{name}\" is {text:?}"))
                })?;
            }
        }
        let [_, components, items] = counts;
        let mut section = DataSection {
            name,
            components,
            tags: Vec::new(),
            values: Vec::new(),
        };
        for _ in 0..items {
            let tag = at.int(format_args!("a tag in \"{}\"", section.name))?;
            section.tags.push(tag as u64);
            for _ in 0..components {
                let value = at.double(format_args!("a value of {tag} in \"{}\"", section.name))?;
                section.values.push(value);
            }
        }
        Ok(section)
    }

    /// Adds the section to `mesh` as a field with a tuple for each item of `needed`, if it has one
    /// for all needed items; without one at the middle of an edge of a ten-node tet it is the mean of the
    /// ends. A later time step replaces an earlier one.
    pub fn add_to(
        self,
        mesh: &mut RawMesh,
        location: Location,
        needed: &[bool],
        index: impl Fn(u64) -> Option<usize>,
    ) {
        if !matches!(self.components, 1 | 3 | 9) {
            mesh.warnings.push(format!(
                "field \"{}\" skipped: it has {} components, but Gmsh fields have 1, 3 or 9",
                self.name, self.components
            ));
            return;
        }
        let mut values = vec![f64::NAN; needed.len() * self.components];
        let mut missing = needed.to_vec();
        for (tag, tuple) in self
            .tags
            .iter()
            .zip(self.values.chunks_exact(self.components))
        {
            if let Some(i) = index(*tag) {
                values[i * self.components..][..self.components].copy_from_slice(tuple);
                missing[i] = false;
            }
        }
        if location == Location::Node {
            fill_middles(&mesh.cells, self.components, &mut values, &mut missing);
        }
        let gaps = missing.iter().filter(|m| **m).count();
        if gaps > 0 {
            mesh.warnings.push(format!(
                "field \"{}\" skipped: {gaps} of the {} {location} of the volume have no value",
                self.name,
                needed.iter().filter(|n| **n).count()
            ));
            return;
        }
        let earlier = mesh.fields.len();
        mesh.fields
            .retain(|f| f.name != self.name || f.location != location);
        if mesh.fields.len() < earlier {
            mesh.warnings.push(format!(
                "field \"{}\" occurs more than once (possibly time steps); the last one is kept",
                self.name
            ));
        }
        mesh.fields.push(Field {
            name: self.name,
            location,
            components: self.components,
            values,
            scalar_type: ScalarType::F64,
        });
    }
}
