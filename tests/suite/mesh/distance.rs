//! Depth below the boundary of shapes with known distances.

use glam::DVec3;
use palpate::generate::{Bore, Split, ball, box_mesh, duct};
use palpate::mesh::{Topology, depth_field, point_triangle_distance};
use proptest::prelude::*;

#[test]
fn box_depth_equals_distance_to_nearest_side() {
    let size = DVec3::new(3.0, 2.0, 1.0);
    let mesh = box_mesh([9, 8, 7], size, Split::Six).unwrap();
    let depth = depth_field(&mesh, &Topology::new(&mesh));
    assert_eq!(depth.name, "depth");
    for (p, d) in mesh.nodes.iter().zip(&depth.values) {
        let exact = p.min_element().min((size - *p).min_element());
        assert!((d - exact).abs() < 1e-12, "{p}: {d}, not {exact}");
    }
}

#[test]
fn triangle_bvh_matches_brute_force() {
    let mesh = duct([6, 6, 4], DVec3::new(1.0, 2.0, 3.0), Bore::Round).unwrap();
    let topology = Topology::new(&mesh);
    let depth = depth_field(&mesh, &topology);
    for (p, d) in mesh.nodes.iter().zip(&depth.values) {
        let nearest = topology.boundary.iter().map(|b| {
            let v = topology.boundary_nodes(&mesh, *b);
            point_triangle_distance(*p, v.map(|v| mesh.nodes[v as usize]))
        });
        assert!((d - nearest.fold(f64::INFINITY, f64::min)).abs() < 1e-12);
    }
    assert!(depth.values.iter().any(|d| *d > 0.1));
}

#[test]
fn ball_depth_is_greatest_at_centre() {
    let mesh = ball(2.0, 16).unwrap();
    let depth = depth_field(&mesh, &Topology::new(&mesh));
    for (p, d) in mesh.nodes.iter().zip(&depth.values) {
        assert!((d - (2.0 - p.length())).abs() < 0.02, "{p}: {d}");
    }
}

fn point() -> impl Strategy<Value = DVec3> {
    // Integers give many points on edges, and degenerate triangles.
    let coordinate = || prop_oneof![-2.0..2.0, (-2..=2).prop_map(f64::from)];
    (coordinate(), coordinate(), coordinate()).prop_map(DVec3::from)
}

proptest! {
    #[test]
    fn triangle_distance_matches_dense_sampling(p in point(), a in point(), b in point(), c in point()) {
        let distance = point_triangle_distance(p, [a, b, c]);
        let steps = 60;
        let mut nearest = f64::INFINITY;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                nearest = nearest.min(p.distance(a + u * (b - a) + v * (c - a)));
            }
        }
        let reach = a.distance(b).max(b.distance(c)).max(c.distance(a)) / f64::from(steps);
        prop_assert!(nearest >= distance - 1e-9, "{nearest} is less than {distance}");
        prop_assert!(nearest <= distance + reach, "{nearest} is more than {distance}");
    }
}
