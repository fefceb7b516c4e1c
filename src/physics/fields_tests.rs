//! Tests of strain and stress against closed-form solutions.
#![allow(clippy::unwrap_used)]

use super::fields::BodyField;
use super::{
    ConstitutiveModel, DiscreteModel, Element, Material, MaterialModel, VolumetricFormulation,
};
use crate::generate::{Split, box_mesh};
use glam::{DMat3, DVec3};

const YOUNG: f64 = 3e4;
const POISSON: f64 = 0.3;
const MU: f64 = YOUNG / (2.0 * (1.0 + POISSON));
const LAMBDA: f64 = YOUNG * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON));
const LAWS: [ConstitutiveModel; 2] = [ConstitutiveModel::NeoHookean, ConstitutiveModel::Corotated];

/// Fields of a generic tet, deformed by `f` and translated: principal stresses, von Mises stress,
/// largest strain, J and energy density.
fn fields(law: ConstitutiveModel, f: DMat3) -> [f64; 7] {
    let rest = [
        DVec3::new(0.1, 0.2, -0.1),
        DVec3::new(0.4, 0.15, 0.0),
        DVec3::new(0.2, 0.5, 0.1),
        DVec3::new(0.15, 0.25, 0.3),
    ];
    let tet = Element::new([0, 1, 2, 3], rest, YOUNG, POISSON, law).unwrap();
    let now = rest.map(|p| f * p + DVec3::new(0.3, -0.2, 0.7));
    [
        BodyField::Stress1,
        BodyField::Stress2,
        BodyField::Stress3,
        BodyField::VonMises,
        BodyField::Strain,
        BodyField::J,
        BodyField::EnergyDensity,
    ]
    .map(|field| field.of_element(&tet, (law, 0.0), &now))
}

/// Compares; stresses and energies relative to μ.
#[track_caller]
fn same(what: &str, found: [f64; 7], expected: [f64; 7]) {
    let sizes = [MU, MU, MU, MU, 1.0, 1.0, MU];
    for (k, size) in sizes.into_iter().enumerate() {
        let off = (found[k] - expected[k]).abs() / size;
        assert!(off < 1e-12, "{what}, {k}: {} for {}", found[k], expected[k]);
    }
}

/// All fields from principal stresses in any order, principal stretches and the energy.
fn of_principal(mut stress: [f64; 3], stretches: [f64; 3], energy: f64) -> [f64; 7] {
    stress.sort_by(|a, b| b.total_cmp(a));
    let [a, b, c] = stress;
    let mises = (0.5 * ((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2))).sqrt();
    let longest = stretches.into_iter().fold(0.0, f64::max);
    let strain = 0.5 * (longest * longest - 1.0);
    [a, b, c, mises, strain, stretches.iter().product(), energy]
}

#[test]
fn uniform_stretch_stress_matches_law_in_any_orientation() {
    for stretches in [[1.3, 0.9, 0.8], [1.1, 1.1, 1.1], [0.7, 0.95, 1.0]] {
        let [x, y, z] = stretches;
        let j: f64 = x * y * z;
        let squares: f64 = stretches.iter().map(|s| s * s).sum();
        let bent: f64 = stretches.iter().map(|s| (s - 1.0).powi(2)).sum();
        // Neo-Hookean material with λ' = λ + μ.
        let more = LAMBDA + MU;
        let neo = of_principal(
            stretches.map(|s| MU * s * s / j + more * (j - 1.0) - MU),
            stretches,
            0.5 * MU * (squares - 3.0) - MU * (j - 1.0) + 0.5 * more * (j - 1.0).powi(2),
        );
        let corotated = of_principal(
            stretches.map(|s| 2.0 * MU * (s - 1.0) * s / j + LAMBDA * (j - 1.0)),
            stretches,
            MU * bent + 0.5 * LAMBDA * (j - 1.0).powi(2),
        );
        for (law, expected) in LAWS.into_iter().zip([neo, corotated]) {
            let stretch = DMat3::from_diagonal(stretches.into());
            same("stretched", fields(law, stretch), expected);
            let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
            let other = DMat3::from_axis_angle(DVec3::new(0.0, 0.28, 0.96), -0.4);
            same("turned", fields(law, turn * stretch * other), expected);
        }
        if x == y {
            for law in LAWS {
                // Isotropic stretch: the von Mises stress vanishes up to rounding.
                assert!(fields(law, DMat3::from_diagonal(stretches.into()))[3] < 1e-12 * MU);
            }
        }
    }
}

#[test]
fn simple_shear_stress_matches_closed_form() {
    for shear in [1e-3, 0.4, 1.5] {
        let mut f = DMat3::IDENTITY;
        f.y_axis.x = shear;
        let half = 0.5 * shear;
        let first = half + (1.0 + half * half).sqrt();
        let stretches = [first, 1.0 / first, 1.0];
        let neo = of_principal(
            stretches.map(|s| MU * (s * s - 1.0)),
            stretches,
            0.5 * MU * shear * shear,
        );
        let bent: f64 = stretches.iter().map(|s| (s - 1.0).powi(2)).sum();
        let corotated = of_principal(
            stretches.map(|s| 2.0 * MU * (s * s - s)),
            stretches,
            MU * bent,
        );
        for (law, expected) in LAWS.into_iter().zip([neo, corotated]) {
            same("sheared", fields(law, f), expected);
        }
    }
}

#[test]
fn rotated_body_has_no_stress() {
    for law in LAWS {
        let turn = DMat3::from_axis_angle(DVec3::new(0.48, 0.6, 0.64).normalize(), 2.0);
        same(
            "turned",
            fields(law, turn),
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        );
        // A stretch by one billionth is detected.
        let bent = turn * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.0 + 1e-9));
        assert!(fields(law, bent)[3] > 1e-10 * MU);
    }
}

#[test]
fn flat_and_inverted_tets_have_finite_stress() {
    for law in LAWS {
        for squash in [0.0, -0.4, 1e-9, -1.0] {
            let all = fields(law, DMat3::from_diagonal(DVec3::new(1.0, 1.0, squash)));
            assert!(
                all.iter().all(|x| x.is_finite()),
                "{law:?} {squash}: {all:?}"
            );
        }
    }
}

#[test]
fn node_means_preserve_constant_and_linear_fields() {
    let mesh = box_mesh([4; 3], DVec3::splat(0.1), Split::Six).unwrap();
    let along = |p: DVec3| 3.0 + p.dot(DVec3::new(2.0, -1.0, 4.0));
    let centre = |t: usize| 0.25 * mesh.tet_nodes(t).iter().sum::<DVec3>();
    let cells: Vec<f64> = (0..mesh.tets.len()).map(|t| along(centre(t))).collect();
    let nodes = mesh.volume_weighted_node_means(&cells);
    let mut inside = 0;
    for (p, mean) in mesh.nodes.iter().zip(&nodes) {
        // The tets around an interior node lie opposite each other.
        if p.min_element() > 0.001 && p.max_element() < 0.099 {
            assert!((mean - along(*p)).abs() < 1e-12);
            inside += 1;
        }
    }
    assert_eq!(inside, 27);
    let ones = mesh.volume_weighted_node_means(&vec![7.0; mesh.tets.len()]);
    assert!(ones.iter().all(|x| (x - 7.0).abs() < 1e-12));
}

/// The shared energies sum to the total, and for uniform F each tet has the values it would have by
/// itself.
#[test]
fn averaged_volumes_enter_stress_and_energy() {
    let mesh = box_mesh([3, 2, 2], DVec3::new(0.3, 0.2, 0.2), Split::Six).unwrap();
    let discrete_model = |volume| {
        let material = Material {
            model: MaterialModel::NeoHookean,
            poisson: 0.45,
            volume,
            ..Material::from_young(YOUNG)
        };
        DiscreteModel::new(&mesh, &material).unwrap()
    };
    let networks = [
        VolumetricFormulation::PerTet,
        VolumetricFormulation::NodalAveraged,
    ]
    .map(discrete_model);
    let places = |bend: f64| -> Vec<DVec3> {
        let moved = |p: &DVec3| DVec3::new(1.1 * p.x + bend * p.x * p.x, p.y, 0.95 * p.z);
        networks[0].rest_positions.iter().map(moved).collect()
    };
    let values = |discrete_model: &DiscreteModel, field: BodyField, x: &[DVec3]| -> Vec<f64> {
        let elements = discrete_model.elements().unwrap();
        let shared = match field {
            BodyField::EnergyDensity => elements.averaged_energy_densities(x),
            _ => elements.averaged_pressures(x),
        };
        let each = elements.tets.iter().zip(shared);
        each.map(|(e, shared)| {
            let corners = e.nodes.map(|v| x[v as usize]);
            field.of_element(
                &elements.without_averaged_lambda(e),
                (elements.law, shared),
                &corners,
            )
        })
        .collect()
    };
    for field in [
        BodyField::Stress1,
        BodyField::Stress3,
        BodyField::EnergyDensity,
    ] {
        let apart = |x: &[DVec3]| {
            let [a, b] = networks.each_ref().map(|n| values(n, field, x));
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs() / MU)
                .fold(0.0, f64::max)
        };
        let [even, bent] = [0.0, 0.5].map(|bend| apart(&places(bend)));
        assert!(even < 1e-12 && bent > 1e-4, "{field}: {even}, {bent}");
    }
    let x = places(0.5);
    for discrete_model in &networks {
        let elements = discrete_model.elements().unwrap();
        let densities = values(discrete_model, BodyField::EnergyDensity, &x);
        let each = densities.iter().zip(&elements.tets);
        let sum: f64 = each.map(|(density, e)| density * e.volume).sum();
        assert!((sum / elements.energy(&x) - 1.0).abs() < 1e-12);
    }
}
