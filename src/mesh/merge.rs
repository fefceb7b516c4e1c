//! Merging of several meshes into one, so that one picture shows all.

use super::{ElementOrder, Field, Location, ScalarType, TetMesh};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// The cell field of the source mesh and region of a tet.
const LABEL: &str = "label";

impl TetMesh {
    /// Merges the named meshes `parts`: concatenates nodes and tets, without joining nodes. The
    /// cell field `label` numbers the regions of all meshes from 1, named `name` or `name/region`.
    /// Other fields are kept; a field missing in one of the meshes is 0 there, and a warning
    /// reports it. The result has order 2 if all of them have.
    ///
    /// # Errors
    /// An [`Error::Input`] if the meshes have different units; an [`Error::Mesh`] if they have more
    /// nodes or tets than can be indexed.
    pub fn merge_meshes(parts: &[(String, &TetMesh)]) -> Result<TetMesh> {
        let nodes: usize = parts.iter().map(|(_, m)| m.nodes.len()).sum();
        let tets: usize = parts.iter().map(|(_, m)| m.tets.len()).sum();
        if nodes.max(tets) > u32::MAX as usize / 4 {
            return Err(Error::Mesh(format!(
                "bodies have {nodes} nodes and {tets} tets in total; each must be at most {} \
                (32-bit indices)",
                u32::MAX / 4
            )));
        }
        let unit = parts.first().and_then(|(_, m)| m.length_unit);
        if let Some((name, _)) = parts.iter().find(|(_, m)| m.length_unit != unit) {
            return Err(Error::Input(format!(
                "length unit of the mesh of \"{name}\" differs from the first body's; use the same \
                unit in all meshes"
            )));
        }
        let is_quadratic = |part: &(String, &TetMesh)| part.1.order == ElementOrder::Quadratic;
        let mut whole = TetMesh {
            nodes: Vec::with_capacity(nodes),
            tets: Vec::with_capacity(tets),
            order: match !parts.is_empty() && parts.iter().all(is_quadratic) {
                true => ElementOrder::Quadratic,
                false => ElementOrder::Linear,
            },
            length_unit: unit,
            frame: parts.iter().find_map(|(_, m)| m.frame),
            ..TetMesh::default()
        };
        for (name, mesh) in parts {
            let first = whole.nodes.len() as u32;
            whole.nodes.extend(&mesh.nodes);
            whole
                .tets
                .extend(mesh.tets.iter().map(|t| t.map(|v| v + first)));
            let warnings = mesh.repairs.warnings.iter();
            whole
                .repairs
                .warnings
                .extend(warnings.map(|w| format!("{name}: {w}")));
        }
        whole.label_parts(parts)?;
        whole.merge_fields(parts)?;
        Ok(whole)
    }

    /// Returns the number of the mesh and the region in it for each label, from 1, of the merged
    /// mesh; no region for a mesh without region field.
    pub(crate) fn merged_regions(parts: &[(String, &TetMesh)]) -> Vec<(usize, Option<i64>)> {
        let of_part = |(part, (_, mesh)): (usize, &(String, &TetMesh))| {
            let regions: Vec<Option<i64>> = match mesh.named_region_field() {
                None => vec![None],
                Some(field) => mesh.regions_of(field).into_keys().map(Some).collect(),
            };
            regions.into_iter().map(move |region| (part, region))
        };
        parts.iter().enumerate().flat_map(of_part).collect()
    }

    /// Numbers the regions of all meshes.
    fn label_parts(&mut self, parts: &[(String, &TetMesh)]) -> Result<()> {
        let mut numbers = vec![BTreeMap::new(); parts.len()];
        for (label, (part, region)) in (1..).zip(TetMesh::merged_regions(parts)) {
            let (name, mesh) = &parts[part];
            let name = match region {
                None => name.clone(),
                Some(region) => {
                    let known = mesh.region_names.get(&region).cloned();
                    format!("{name}/{}", known.unwrap_or_else(|| region.to_string()))
                }
            };
            self.region_names.insert(label, name);
            numbers[part].insert(region, label as f64);
        }
        let mut labels = Vec::with_capacity(self.tets.len());
        for ((_, mesh), number) in parts.iter().zip(&numbers) {
            let of = |region| number.get(&region).copied().unwrap_or(0.0);
            match mesh.named_region_field() {
                None => labels.extend(vec![of(None); mesh.tets.len()]),
                Some(field) => labels.extend(field.values.iter().map(|v| of(Some(*v as i64)))),
            }
        }
        self.set_field(Field {
            scalar_type: ScalarType::I32,
            ..Field::scalar(LABEL, Location::Cell, labels)
        })
    }

    /// Concatenates the other fields of all meshes.
    fn merge_fields(&mut self, parts: &[(String, &TetMesh)]) -> Result<()> {
        let all = parts.iter().flat_map(|(_, mesh)| &mesh.fields);
        let mut shapes: Vec<&Field> = Vec::new();
        for field in all.filter(|f| (f.name.as_str(), f.location) != (LABEL, Location::Cell)) {
            let same = |f: &&&Field| f.name == field.name && f.location == field.location;
            if shapes.iter().find(same).is_none() {
                shapes.push(field);
            }
        }
        for shape in shapes {
            let (mut values, mut without) = (Vec::new(), Vec::new());
            for (name, mesh) in parts {
                let count = match shape.location {
                    Location::Node => mesh.nodes.len(),
                    Location::Cell => mesh.tets.len(),
                };
                match mesh.field(&shape.name, shape.location) {
                    Some(field) if field.components == shape.components => {
                        values.extend_from_slice(&field.values);
                    }
                    _ => {
                        without.push(format!("\"{name}\""));
                        values.resize(values.len() + count * shape.components, 0.0);
                    }
                }
            }
            if !without.is_empty() {
                self.repairs.warnings.push(format!(
                    "field \"{}\" set to 0 in {}, where it is missing or has another number of \
                    components",
                    shape.name,
                    without.join(" and ")
                ));
            }
            self.set_field(Field {
                name: shape.name.clone(),
                values,
                ..*shape
            })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use glam::DVec3;

    fn tet(x: f64) -> TetMesh {
        let nodes = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        TetMesh {
            nodes: nodes.map(|p| p + DVec3::X * x).to_vec(),
            tets: vec![[0, 1, 2, 3]],
            ..TetMesh::default()
        }
    }

    #[test]
    fn merge_concatenates_meshes_fields_and_region_names() {
        let (mut a, b) = (tet(0.0), tet(2.0));
        let heat = Field::scalar("heat", Location::Node, vec![1.0, 2.0, 3.0, 4.0]);
        a.set_field(heat).unwrap();
        let whole = TetMesh::merge_meshes(&[("a".into(), &a), ("b".into(), &b)]).unwrap();
        assert_eq!(whole.tets, [[0, 1, 2, 3], [4, 5, 6, 7]]);
        assert_eq!(whole.nodes[5], DVec3::X * 3.0);
        let heat = &whole.field("heat", Location::Node).unwrap().values;
        assert_eq!(heat[..], [1.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0]);
        let labels = &whole.field(LABEL, Location::Cell).unwrap().values;
        assert_eq!(labels[..], [1.0, 2.0]);
        assert_eq!(whole.region_names[&2], "b");
        assert!(whole.repairs.warnings[0].contains("\"heat\" set to 0 in \"b\""));
        let metres = TetMesh {
            length_unit: Some(1.0),
            ..b
        };
        let mixed = TetMesh::merge_meshes(&[("a".into(), &a), ("b".into(), &metres)]);
        assert!(mixed.unwrap_err().to_string().contains("unit"));
    }
}
