//! The meshes under `data/` equal the output of the generator.

#[allow(dead_code)]
#[path = "../../../data/generate/src/main.rs"]
mod generate_data;

#[test]
fn shipped_meshes_match_generators() {
    for (name, made) in generate_data::meshes().unwrap() {
        let path = format!("{}/data/{name}", env!("CARGO_MANIFEST_DIR"));
        let kept = palpate::io::read(path).unwrap();
        assert_eq!(
            kept.tets, made.tets,
            "{name}: run cargo run -p palpate-data"
        );
        assert_eq!(kept.repairs, Default::default(), "{name}");
        // Sines may differ in the last bit between platforms.
        let near = |(a, b): (&glam::DVec3, &glam::DVec3)| a.distance(*b) < 1e-9;
        assert!(kept.nodes.iter().zip(&made.nodes).all(near), "{name}");
        assert_eq!(kept.fields.len(), made.fields.len(), "{name}");
        for (a, b) in kept.fields.iter().zip(&made.fields) {
            assert_eq!(
                (&a.name, a.location, a.scalar_type),
                (&b.name, b.location, b.scalar_type)
            );
            let near = |(x, y): (&f64, &f64)| (x - y).abs() <= 1e-3 * x.abs().max(1.0);
            assert!(
                a.values.iter().zip(&b.values).all(near),
                "{name}: {}",
                a.name
            );
        }
    }
}

#[test]
fn shipped_volumes_and_surfaces_match_generators() {
    let kept = |name: &str| format!("{}/data/{name}", env!("CARGO_MANIFEST_DIR"));
    for (name, made) in generate_data::volumes() {
        let kept = palpate::io::read_volume(kept(name)).unwrap();
        assert_eq!(
            kept.size, made.size,
            "{name}: run cargo run -p palpate-data"
        );
        assert_eq!(kept.label_names, made.label_names, "{name}");
        let here = kept
            .to_world
            .transform_point3(glam::DVec3::new(5.0, 6.0, 7.0));
        assert!(here.distance(made.centre(5, 6, 7)) < 1e-4, "{name}");
        // A voxel on the boundary may be rounded differently on another platform.
        let other = |n: &usize| (kept.value(*n) - made.value(*n)).abs() > 3.0;
        let others = (0..kept.voxels()).filter(other).count();
        assert!(others * 10_000 < kept.voxels(), "{name}: {others}");
    }
    for (name, made) in generate_data::surfaces().unwrap() {
        let kept = palpate::io::read_surface(kept(name)).unwrap();
        assert_eq!(kept.triangles.len(), made.triangles.len(), "{name}");
        assert!((kept.volume() / made.volume() - 1.0).abs() < 1e-5, "{name}");
        let bytes = std::fs::metadata(format!("{}/data/{name}", env!("CARGO_MANIFEST_DIR")));
        assert!(name != "foot_bones.ply" || bytes.unwrap().len() < 400_000);
    }
}
