//! Writer for the Gmsh MSH format, versions 2.2 and 4.1, binary or text.
//!
//! Regions are physical volumes with their names; fields of 1, 3 or 9 components are $NodeData and
//! $ElementData. The section $Comments, which other programs skip, stores the other data of the
//! regions.

use super::atomic_write;
use super::format::{dropped_fields_note, one_line};
use super::groups::Groups;
use super::metadata;
use super::ten_node::FileMesh;
use crate::mesh::{ElementOrder, Field, Location, TetMesh};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;

/// Gmsh numbers of the dimension of a volume, and of the types of tets with four and ten nodes.
const VOLUME: i32 = 3;
const TET: i32 = 4;
const QUADRATIC_TET: i32 = 11;

/// Writes `mesh` as version `version`, 2 (2.2) or 4 (4.1).
pub(super) fn write(
    path: &Path,
    file_mesh: &FileMesh,
    version: u32,
    text: bool,
) -> Result<Vec<String>> {
    let mesh = &*file_mesh.mesh;
    let groups = Groups::from_mesh(mesh, 1);
    let is_covered = |f: &&Field| {
        groups.is_covered_by_groups(mesh, f)
            || (f.name == GEOMETRICAL && f.location == Location::Cell)
    };
    let (fields, others): (Vec<&Field>, Vec<&Field>) = mesh
        .fields
        .iter()
        .filter(|f| !is_covered(f))
        .partition(|f| matches!(f.components, 1 | 3 | 9));
    let entities = entities(mesh, &groups);
    atomic_write(path, |file| {
        let mut out = Out {
            file,
            text,
            wide: version >= 4,
        };
        out.mesh(file_mesh, version, &groups, &entities, &fields)
            .map_err(Error::io(path))
    })?;
    let mut notes = Vec::new();
    if groups.renumbered {
        notes.push(
            "region labels are not valid numbers of Gmsh physical groups; groups renumbered from 1"
                .to_owned(),
        );
    }
    notes.extend(dropped_fields_note(
        &others,
        "Gmsh fields must have 1, 3 or 9 components",
    ));
    Ok(notes)
}

/// The cell field of entities.
const GEOMETRICAL: &str = "gmsh:geometrical";

/// Returns the entity of each tet: that of the field `gmsh:geometrical` if each entity has a single
/// group, otherwise one entity per group.
fn entities(mesh: &TetMesh, groups: &Groups) -> Vec<i32> {
    let group = |t: usize| groups.tet_groups.get(t).copied().unwrap_or(0);
    if let Some(field) = mesh.field(GEOMETRICAL, Location::Cell)
        && field.components == 1
    {
        let mut group_of = BTreeMap::new();
        let usable = field.values.iter().enumerate().all(|(t, v)| {
            v.fract() == 0.0
                && (1.0..=f64::from(i32::MAX)).contains(v)
                && *group_of.entry(*v as i32).or_insert(group(t)) == group(t)
        });
        if usable {
            return field.values.iter().map(|v| *v as i32).collect();
        }
    }
    let used: BTreeSet<i32> = groups.all().map(|(group, _)| group).collect();
    let free = (1..).find(|n| !used.contains(n)).unwrap_or(1);
    (0..mesh.tets.len())
        .map(|t| match group(t) {
            0 => free,
            group => group,
        })
        .collect()
}

fn element_type(mesh: &FileMesh) -> i32 {
    match mesh.order() {
        ElementOrder::Linear => TET,
        ElementOrder::Quadratic => QUADRATIC_TET,
    }
}

struct Out<'a, W> {
    file: &'a mut W,
    text: bool,
    /// Whether counts and tags have 64 bits.
    wide: bool,
}

type Done = std::io::Result<()>;

impl<W: Write> Out<'_, W> {
    fn ints(&mut self, values: &[i32]) -> Done {
        for value in values {
            match self.text {
                true => write!(self.file, "{value} ")?,
                false => self.file.write_all(&value.to_le_bytes())?,
            }
        }
        Ok(())
    }

    fn sizes(&mut self, values: &[usize]) -> Done {
        for value in values {
            match (self.text, self.wide) {
                (true, _) => write!(self.file, "{value} ")?,
                (false, true) => self.file.write_all(&(*value as u64).to_le_bytes())?,
                (false, false) => self.file.write_all(&(*value as i32).to_le_bytes())?,
            }
        }
        Ok(())
    }

    fn reals(&mut self, values: &[f64]) -> Done {
        for value in values {
            match self.text {
                true => write!(self.file, "{value:?} ")?,
                false => self.file.write_all(&value.to_le_bytes())?,
            }
        }
        Ok(())
    }

    /// Ends a line of numbers.
    fn end_line(&mut self) -> Done {
        match self.text {
            true => self.file.write_all(b"\n"),
            false => Ok(()),
        }
    }

    /// Writes lines that are text in binary files, too.
    fn lines(&mut self, text: &str) -> Done {
        self.file.write_all(text.as_bytes())
    }

    /// Writes `$EndName` on a separate line.
    fn end(&mut self, name: &str) -> Done {
        let before = if self.text { "" } else { "\n" };
        self.lines(&format!("{before}$End{name}\n"))
    }

    fn mesh(
        &mut self,
        file_mesh: &FileMesh,
        version: u32,
        groups: &Groups,
        entities: &[i32],
        fields: &[&Field],
    ) -> Done {
        let mesh = &*file_mesh.mesh;
        let number = if version >= 4 { "4.1" } else { "2.2" };
        let binary = u8::from(!self.text);
        self.lines(&format!("$MeshFormat\n{number} {binary} 8\n"))?;
        if !self.text {
            self.ints(&[1])?;
            self.lines("\n")?;
        }
        self.lines("$EndMeshFormat\n")?;
        let remarks = metadata::mesh_comments("", mesh, groups, &[]);
        if !remarks.is_empty() {
            self.lines(&format!("$Comments\n{remarks}$EndComments\n"))?;
        }
        self.names(groups)?;
        if version >= 4 {
            self.mesh_4(file_mesh, groups, entities)?;
        } else {
            self.mesh_2(file_mesh, groups, entities)?;
        }
        fields.iter().try_for_each(|field| self.field(field))
    }

    fn names(&mut self, groups: &Groups) -> Done {
        let named: Vec<String> = groups
            .all()
            .filter_map(|(group, region)| {
                let name = one_line(region.name.as_ref()?).replace('"', "'");
                Some(format!("{VOLUME} {group} \"{name}\"\n"))
            })
            .collect();
        if named.is_empty() {
            return Ok(());
        }
        self.lines(&format!(
            "$PhysicalNames\n{}\n{}$EndPhysicalNames\n",
            named.len(),
            named.concat()
        ))
    }

    fn mesh_2(&mut self, file_mesh: &FileMesh, groups: &Groups, entities: &[i32]) -> Done {
        let mesh = &*file_mesh.mesh;
        let kind = element_type(file_mesh);
        self.lines(&format!("$Nodes\n{}\n", mesh.nodes.len()))?;
        for (i, node) in mesh.nodes.iter().enumerate() {
            self.sizes(&[i + 1])?;
            self.reals(&node.to_array())?;
            self.end_line()?;
        }
        self.end("Nodes")?;
        self.lines(&format!("$Elements\n{}\n", mesh.tets.len()))?;
        if !self.text {
            self.ints(&[kind, mesh.tets.len() as i32, 2])?;
        }
        for (t, entity) in entities.iter().enumerate() {
            self.sizes(&[t + 1])?;
            if self.text {
                self.ints(&[kind, 2])?;
            }
            let group = groups.tet_groups.get(t).copied().unwrap_or(0);
            self.ints(&[group, *entity])?;
            for v in file_mesh.gmsh_tags_of(t) {
                self.sizes(&[v])?;
            }
            self.end_line()?;
        }
        self.end("Elements")
    }

    fn mesh_4(&mut self, file_mesh: &FileMesh, groups: &Groups, entities: &[i32]) -> Done {
        let mesh = &*file_mesh.mesh;
        // The tets of each entity, in their order.
        let mut blocks: BTreeMap<i32, Vec<usize>> = BTreeMap::new();
        for (t, entity) in entities.iter().enumerate() {
            blocks.entry(*entity).or_default().push(t);
        }
        self.lines("$Entities\n")?;
        self.sizes(&[0, 0, 0, blocks.len()])?;
        self.end_line()?;
        for (entity, tets) in &blocks {
            self.ints(&[*entity])?;
            let nodes = tets.iter().flat_map(|t| file_mesh.nodes_of(*t));
            let (low, high) = nodes
                .map(|v| mesh.nodes[*v as usize])
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                    (low.min(p), high.max(p))
                });
            self.reals(&low.to_array())?;
            self.reals(&high.to_array())?;
            let group = tets.first().and_then(|t| groups.tet_groups.get(*t));
            match group.copied().unwrap_or(0) {
                0 => self.sizes(&[0])?,
                group => {
                    self.sizes(&[1])?;
                    self.ints(&[group])?;
                }
            }
            self.sizes(&[0])?; // surfaces around it
            self.end_line()?;
        }
        self.end("Entities")?;
        let count = mesh.nodes.len();
        self.lines("$Nodes\n")?;
        self.sizes(&[1, count, 1, count])?;
        self.end_line()?;
        let first = blocks.keys().next().copied().unwrap_or(1);
        self.ints(&[VOLUME, first, 0])?;
        self.sizes(&[count])?;
        self.end_line()?;
        for i in 0..count {
            self.sizes(&[i + 1])?;
            self.end_line()?;
        }
        for node in &mesh.nodes {
            self.reals(&node.to_array())?;
            self.end_line()?;
        }
        self.end("Nodes")?;
        let count = mesh.tets.len();
        self.lines("$Elements\n")?;
        self.sizes(&[blocks.len(), count, 1, count])?;
        self.end_line()?;
        for (entity, tets) in &blocks {
            self.ints(&[VOLUME, *entity, element_type(file_mesh)])?;
            self.sizes(&[tets.len()])?;
            self.end_line()?;
            for t in tets {
                self.sizes(&[t + 1])?;
                for v in file_mesh.gmsh_tags_of(*t) {
                    self.sizes(&[v])?;
                }
                self.end_line()?;
            }
        }
        self.end("Elements")
    }

    fn field(&mut self, field: &Field) -> Done {
        let section = match field.location {
            Location::Node => "NodeData",
            Location::Cell => "ElementData",
        };
        let name = one_line(&field.name).replace('"', "'");
        let width = field.components;
        self.lines(&format!(
            "${section}\n1\n\"{name}\"\n1\n0.0\n3\n0\n{width}\n{}\n",
            field.values.len() / width
        ))?;
        for (i, tuple) in field.values.chunks_exact(width).enumerate() {
            self.ints(&[i as i32 + 1])?;
            self.reals(tuple)?;
            self.end_line()?;
        }
        self.end(section)
    }
}
