//! Scaling: the computed memory equals the allocated memory.

use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::{Location, Topology};
use palpate::physics::{GpuBody, Material, SolverKind};
use palpate::render::Geometry;
use palpate::study::computed_bytes;

/// Returns the ratio of computed to allocated memory: body, solvers, geometry.
fn shares(cells: usize) -> Vec<(&'static str, f64)> {
    // A separate device: bytes are counted by device, and other tests allocate on the shared one.
    let gpu = Gpu::new().unwrap();
    let mesh = generate::benchmark_cube(cells, false).unwrap();
    let topology = Topology::new(&mesh);
    let scalars = mesh.field("scalar", Location::Node).unwrap().values.clone();
    let mut shares = Vec::new();
    let mut made = gpu.bytes_allocated();
    let mut add = |part| {
        let now = gpu.bytes_allocated();
        let computed = computed_bytes(part, &mesh, &topology);
        shares.push((part, computed / (now - made) as f64));
        made = now;
    };
    let body = GpuBody::new(&gpu, &mesh, &Material::soft_tissue()).unwrap();
    add("body");
    let _one = SolverKind::Symplectic.solver(&gpu, &body).unwrap();
    add("symplectic");
    let _two = SolverKind::Implicit.solver(&gpu, &body).unwrap();
    add("implicit");
    let (frame, array) = (body.nodes().frame(), body.nodes().array());
    let _geometry = Geometry::new(&gpu, &mesh, &topology, frame, array, &scalars).unwrap();
    add("geometry");
    shares
}

#[test]
fn measured_memory_matches_computed() {
    for cells in [8, 20] {
        for (part, share) in shares(cells) {
            println!("{cells}: {part} {share:.4}");
            // Rows of springs are padded to multiples of four, and to the longest of 32; each
            // solver keeps a history of its last steps, which is significant for a small mesh.
            let least = if matches!(part, "body" | "implicit") || cells < 20 {
                0.8
            } else {
                0.9
            };
            assert!(share > least && share <= 1.0, "{cells}: {part} {share}");
        }
    }
}

#[test]
fn absent_part_uses_no_memory() {
    let mesh = generate::benchmark_cube(2, false).unwrap();
    assert_eq!(computed_bytes("skin", &mesh, &Topology::new(&mesh)), 0.0);
}
