//! Whole pictures against the exact ray integral.

use crate::common::*;
use palpate::mesh::generate;
use palpate::render::{Mode, RaycastOptions, TableForm, Walk};

#[test]
fn the_benchmark_cube_by_both_walks_and_tables() {
    let gpu = gpu();
    let mesh = generate::benchmark_cube(12, false).unwrap();
    let scalars = node_scalars(&mesh, "scalar");
    for (walk, table) in [
        (Walk::Vertices, TableForm::Sliced),
        (Walk::Planes, TableForm::Sliced),
        (Walk::Vertices, TableForm::Volume),
    ] {
        let options = RaycastOptions {
            walk,
            table,
            ..Default::default()
        };
        let mut scene = Scene::new(
            &gpu,
            &mesh,
            &mesh.nodes,
            &scalars,
            &peers_transfer(),
            options,
        );
        let (image, rms, worst) = scene.compare(&peers_camera(), [160, 120]);
        println!("{walk:?} {table:?}: rms {rms:.3} worst {worst:.3}");
        keep(&image, &format!("cube-{walk:?}-{table:?}.png"));
        let report = scene.caster.report(&peers_camera(), [160, 120]).unwrap();
        println!("{report:?}");
        assert!(
            rms < 0.5 && worst < 2.0,
            "{walk:?} {table:?}: {rms} {worst}"
        );
        assert_eq!(report.lost_rays, 0);
        let _ = Mode::Thickness;
    }
}
