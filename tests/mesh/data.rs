//! The meshes under `data/` are those that the example makes.

#[allow(dead_code)]
#[path = "../../examples/generate_data/main.rs"]
mod generate_data;

#[test]
fn the_meshes_that_ship_are_up_to_date() {
    for (name, made) in generate_data::meshes().unwrap() {
        let path = format!("{}/data/{name}", env!("CARGO_MANIFEST_DIR"));
        let kept = palpate::io::read(path).unwrap();
        assert_eq!(
            kept.tets, made.tets,
            "{name}: run the example generate_data"
        );
        assert_eq!(kept.repairs, Default::default(), "{name}");
        // Sines may differ in the last bit from one platform to the next.
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
