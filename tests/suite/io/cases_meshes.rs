//! Files of the kinds that users have: Gmsh, Abaqus, Medit, AVS UCD and MFEM.

use crate::support;
use palpate::mesh::{Location, TetMesh};
use std::collections::BTreeMap;

fn read(name: &str) -> Option<TetMesh> {
    let path = support::real_data(&format!("cases/{name}"))?;
    Some(palpate::io::read(path).unwrap_or_else(|e| panic!("{e}")))
}

/// Returns the number of tets with each label.
fn counts(mesh: &TetMesh, name: &str) -> BTreeMap<i64, usize> {
    let mut counts = BTreeMap::new();
    for value in &mesh.field(name, Location::Cell).unwrap().values {
        *counts.entry(*value as i64).or_default() += 1;
    }
    counts
}

#[test]
fn partitioned_gmsh_file_has_regions_of_the_whole() {
    let (Some(parts), Some(whole)) = (read("16_partitioned.msh"), read("16_whole.msh")) else {
        return;
    };
    let names = [(11, "soft tissue".to_owned()), (22, "bone".to_owned())];
    assert_eq!(parts.region_names, names.into());
    assert_eq!(parts.region_names, whole.region_names);
    for field in ["label", "gmsh:physical", "gmsh:geometrical"] {
        assert_eq!(counts(&parts, field), counts(&whole, field), "{field}");
    }
    assert_eq!(parts.repairs.warnings, whole.repairs.warnings);
}

#[test]
fn gmsh_names_with_blanks_are_kept() {
    for (file, soft) in [
        ("24_g_name_spaces.msh", "soft, tissue; a/b"),
        ("24_g_utf16.msh", "soft tissue"),
    ] {
        let Some(mesh) = read(file) else { return };
        let names = [(11, soft.to_owned()), (22, "bone".to_owned())];
        assert_eq!(mesh.region_names, names.into(), "{file}");
        assert!((mesh.volume() - 2.0).abs() < 1e-9);
    }
}

#[test]
fn abaqus_cases_are_placed_and_complete() {
    let Some(moved) = read("22_i_instance_moved.inp") else {
        return;
    };
    let (low, high) = moved.bounds();
    assert_eq!((low.x, high.x), (100.0, 102.0));
    let Some(two) = read("22_i_two_parts.inp") else {
        return;
    };
    assert_eq!((two.nodes.len(), two.tets.len()), (54, 96));
    assert!((two.volume() - 16.0).abs() < 1e-12);
    assert_eq!(counts(&two, "label"), [(1, 48), (2, 48)].into());
    let Some(included) = read("22_i_include.inp") else {
        return;
    };
    assert_eq!((included.nodes.len(), included.tets.len()), (27, 48));
}

#[test]
fn medit_ucd_and_mfem_cases_have_their_volumes() {
    for (file, volume, tets) in [
        ("22_tets_and_hexaedra.mesh", 7.0 / 6.0, None),
        ("22_m_float_ref.mesh", 8.0, Some(48)),
        ("22_u_ucd.inp", 8.0, Some(48)),
        ("22_f_mfem.mesh", 8.0, Some(48)),
    ] {
        let Some(mesh) = read(file) else { return };
        assert!((mesh.volume() - volume).abs() < 1e-12, "{file}");
        assert!(tets.is_none_or(|tets| mesh.tets.len() == tets), "{file}");
        assert_eq!(mesh.repairs.inverted_fixed, 0, "{file}");
    }
    let Some(mesh) = read("22_u_ucd.inp") else {
        return;
    };
    let temperature = mesh.field("temp", Location::Node).unwrap();
    assert_eq!(temperature.values[..3], [0.0, 1.0, 2.0]);
}
