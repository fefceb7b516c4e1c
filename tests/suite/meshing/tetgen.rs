//! Meshing by the installed program TetGen (Debian package `tetgen`), which these tests need; some
//! read the real surfaces in `../shared/data`.

use glam::DVec3;
use palpate::mesh::{Field, Location, SurfaceDescription, TetMesh, TriMesh};
use palpate::mesher::{MeshedDomain, Spacing};
use palpate::meshing::tetgen;
use palpate::{Result, io};

/// Returns a sphere around the origin: an octahedron subdivided three times.
fn sphere(radius: f64) -> TriMesh {
    let mut corners: Vec<[DVec3; 3]> = Vec::new();
    for n in 0..8 {
        let sign = |axis: usize| if n >> axis & 1 == 0 { 1.0 } else { -1.0 };
        let [x, y, z] = [DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2)];
        let outward = x.cross(y).dot(z) > 0.0;
        corners.push(if outward { [x, y, z] } else { [x, z, y] });
    }
    for _ in 0..3 {
        let cut = |[a, b, c]: [DVec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        corners = corners.into_iter().flat_map(cut).collect();
    }
    let mut surface = TriMesh::default();
    for triangle in corners {
        surface.triangles.push(triangle.map(|p| {
            let place = p * radius;
            let same = |v: &DVec3| v.distance(place) < 1e-9 * radius;
            let known = surface.vertices.iter().position(same);
            known.unwrap_or_else(|| {
                surface.vertices.push(place);
                surface.vertices.len() - 1
            }) as u32
        }));
    }
    surface
}

fn made(surfaces: &[TriMesh], spacing: Spacing) -> Result<MeshedDomain> {
    tetgen(surfaces, spacing, &palpate::no_progress)
}

fn real(name: &str) -> Option<TriMesh> {
    Some(io::read_surface(crate::support::real_data(name)?).unwrap())
}

#[test]
fn nested_surfaces_become_conforming_regions() {
    let surfaces = [sphere(10.0), sphere(5.0)];
    let [outer, inner] = [0, 1].map(|n| surfaces[n].volume());
    let filling = made(&surfaces, Spacing::Edge(2.0)).unwrap();
    let volumes: Vec<f64> = filling.report.regions.iter().map(|r| r.volume).collect();
    assert!(
        (volumes[0] / (outer - inner) - 1.0).abs() < 1e-7,
        "{volumes:?}"
    );
    assert!((volumes[1] / inner - 1.0).abs() < 1e-7, "{volumes:?}");
    let labels = filling.regions.iter().map(|r| f64::from(*r)).collect();
    let field = Field::scalar("label", Location::Cell, labels);
    let mesh = TetMesh::new(filling.nodes, filling.tets, vec![field], Vec::new()).unwrap();
    for (labels, euler) in [(&[1][..], 4), (&[2], 2), (&[1, 2], 2)] {
        let surface = mesh.boundary_surface(Some(labels)).unwrap();
        let found = SurfaceDescription::new(&surface);
        assert!(found.closed);
        assert_eq!(found.euler_number, euler);
    }
    // In the opposite order, the later and larger one takes everything.
    let [a, b] = surfaces;
    let filling = made(&[b, a], Spacing::Edge(2.0)).unwrap();
    assert!(filling.regions.iter().all(|r| *r == 2));
}

#[test]
fn cavities_are_excluded() {
    let mut hollow = sphere(10.0);
    let cavity = sphere(5.0);
    let first = hollow.vertices.len() as u32;
    let inward = cavity
        .triangles
        .iter()
        .map(|[a, b, c]| [a + first, c + first, b + first]);
    hollow.triangles.extend(inward);
    hollow.vertices.extend(&cavity.vertices);
    let wanted = hollow.volume();
    let filling = made(&[hollow], Spacing::Tets(8000)).unwrap();
    assert!(
        filling.tets.len().abs_diff(8000) <= 1200,
        "{}",
        filling.tets.len()
    );
    assert_eq!(filling.report.regions.len(), 1);
    assert!((filling.report.regions[0].volume / wanted - 1.0).abs() < 1e-7);
}

#[test]
fn requested_tet_count_is_met_or_rejected() {
    // In metres, so that volumes are small numbers.
    let ball = [sphere(1e-5)];
    for wanted in [5000, 20_000] {
        let filling = made(&ball, Spacing::Tets(wanted)).unwrap();
        let off = filling.tets.len() as f64 / wanted as f64 - 1.0;
        assert!(off.abs() <= 0.15, "{off}");
        assert!((filling.report.regions[0].volume / ball[0].volume() - 1.0).abs() < 1e-6);
    }
    let error = made(&ball, Spacing::Tets(200)).unwrap_err().to_string();
    assert!(error.contains("at least"), "{error}");
    let error = made(&ball, Spacing::Edge(-1.0)).unwrap_err().to_string();
    assert!(error.contains("positive"), "{error}");
}

#[test]
fn real_femur_meshes_validly() {
    let Some(femur) = real("surfaces/pymskt_femur_thickness_mm_10k_pts.vtk") else {
        return;
    };
    let filling = made(std::slice::from_ref(&femur), Spacing::Edge(5.0)).unwrap();
    assert!(filling.tets.len() > 50_000 && filling.report.min_dihedral > 1.0);
    let off = filling.report.regions[0].volume / femur.volume() - 1.0;
    assert!(off.abs() < 1e-7, "{off}");
}

#[test]
fn rejects_self_intersecting_surface_with_remedy() {
    let Some(lung) = real("surfaces/chaste_lung_lul.stl") else {
        return;
    };
    let error = made(&[lung], Spacing::Edge(10.0));
    let error = error.unwrap_err().to_string();
    assert!(error.contains("--with lattice"), "{error}");
    assert!(error.contains("pairs of faces are intersecting"), "{error}");
}
