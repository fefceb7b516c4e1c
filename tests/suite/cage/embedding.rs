//! The embedding pass against `reference::cage`, and motions that it must reproduce exactly.

use super::noise;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use palpate::cage::Embedding;
use palpate::generate;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::physics::NodePositions;

/// Returns a limb, and tets around it.
fn limb_in_a_box() -> (TetMesh, TetMesh) {
    let fine = generate::by_name("limb", Some(4_000)).unwrap();
    let (low, high) = fine.bounds();
    let mut coarse =
        generate::box_mesh([7, 3, 3], 1.1 * (high - low), generate::Split::Six).unwrap();
    for p in &mut coarse.nodes {
        *p += low - 0.05 * (high - low);
    }
    (fine, coarse)
}

/// Returns the fine nodes for coarse ones at `there`, from the GPU.
fn carried(
    gpu: &Gpu,
    coarse: &TetMesh,
    fine: &TetMesh,
    there: &[DVec3],
) -> (Embedding, Vec<DVec3>) {
    let mut nodes = NodePositions::new(gpu, coarse).unwrap();
    let mut embedding = Embedding::new(gpu, coarse, &nodes, fine).unwrap();
    let mut work = gpu.start_recording();
    assert!(
        !embedding.record_update(&mut work, &nodes),
        "positions must be unchanged before the update"
    );
    nodes.set_positions(there).unwrap();
    assert!(embedding.record_update(&mut work, &nodes));
    work.submit().unwrap();
    let found = embedding.nodes().positions().unwrap();
    (embedding, found)
}

fn worst(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| a.distance(*b))
        .fold(0.0, f64::max)
}

#[test]
fn embedded_nodes_match_float64_on_random_cages() {
    let gpu = Gpu::new().unwrap();
    let (fine, coarse) = limb_in_a_box();
    let (low, high) = fine.bounds();
    let size = (high - low).max_element();
    let mut next = noise(3);
    for scale in [0.01, 1.0] {
        let there: Vec<DVec3> = coarse
            .nodes
            .iter()
            .map(|p| *p + scale * size * DVec3::new(next(), next(), next()))
            .collect();
        let (embedding, found) = carried(&gpu, &coarse, &fine, &there);
        assert_eq!(embedding.outside(), 0);
        let shares = embedding.transfer().source_weights();
        let truth = carry(shares, &there);
        let error = worst(&found, &truth) / size;
        assert!(error < 1e-6, "{error}");
        assert!(worst(&embedding.interpolate(&there).unwrap(), &truth) < 1e-12 * size);
        // Two swapped corners are detected.
        let mut wrong = shares.to_vec();
        let most = (0..wrong.len()).max_by(|a, b| {
            let spread = |i: &usize| wrong[*i].1[1] - wrong[*i].1[0];
            spread(a).total_cmp(&spread(b))
        });
        wrong[most.unwrap()].1.swap(0, 1);
        let control = worst(&found, &carry(&wrong, &there)) / size;
        assert!(control > 1e-4, "{control}");
    }
}

#[test]
fn embedding_reproduces_affine_motion() {
    let gpu = Gpu::new().unwrap();
    let (fine, coarse) = limb_in_a_box();
    let (low, high) = fine.bounds();
    let size = (high - low).max_element();
    let middle = 0.5 * (low + high);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, 2.1));
    let shear = DMat3::from_cols(
        DVec3::new(1.3, 0.1, 0.0),
        DVec3::new(0.4, 0.8, -0.2),
        DVec3::new(0.0, 0.3, 1.1),
    );
    for matrix in [DMat3::IDENTITY, turn, shear] {
        let moved =
            DAffine3::from_mat3_translation(matrix, 0.4 * size * DVec3::new(1.0, -2.0, 0.5));
        let to = |p: &DVec3| middle + moved.transform_point3(*p - middle);
        let there: Vec<DVec3> = coarse.nodes.iter().map(to).collect();
        let truth: Vec<DVec3> = fine.nodes.iter().map(to).collect();
        let (_, found) = carried(&gpu, &coarse, &fine, &there);
        let error = worst(&found, &truth) / size;
        assert!(error < 1e-6, "{error}");
    }
}

#[test]
fn nodes_outside_cage_are_embedded_and_counted() {
    let gpu = Gpu::new().unwrap();
    let coarse = generate::bar([4, 2, 2], DVec3::new(2.0, 1.0, 1.0)).unwrap();
    let mut fine = generate::bar([8, 4, 4], DVec3::new(2.0, 1.0, 1.0)).unwrap();
    let beyond = fine.nodes.iter().filter(|p| p.x > 1.9).count();
    for p in &mut fine.nodes {
        p.x = if p.x > 1.9 { 2.2 } else { p.x };
    }
    let stretch = |p: &DVec3| DVec3::new(1.5 * p.x, p.y, p.z + 0.2 * p.x);
    let there: Vec<DVec3> = coarse.nodes.iter().map(stretch).collect();
    let (embedding, found) = carried(&gpu, &coarse, &fine, &there);
    assert_eq!(embedding.outside(), beyond);
    let truth: Vec<DVec3> = fine.nodes.iter().map(stretch).collect();
    assert!(worst(&found, &truth) < 5e-6);
}

#[test]
#[ignore = "long: scripts/test --full"]
fn transferred_forces_preserve_work() {
    let (fine, coarse) = limb_in_a_box();
    let gpu = Gpu::new().unwrap();
    let nodes = NodePositions::new(&gpu, &coarse).unwrap();
    let embedding = Embedding::new(&gpu, &coarse, &nodes, &fine).unwrap();
    let mut next = noise(9);
    let mut random =
        |n: usize| -> Vec<DVec3> { (0..n).map(|_| DVec3::new(next(), next(), next())).collect() };
    let (forces, motion) = (random(fine.nodes.len()), random(coarse.nodes.len()));
    let gathered = embedding.transfer().apply_transpose(&forces).unwrap();
    let dot = |a: &[DVec3], b: &[DVec3]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
    let (fine_work, coarse_work) = (
        dot(&forces, &embedding.interpolate(&motion).unwrap()),
        dot(&gathered, &motion),
    );
    assert!((fine_work - coarse_work).abs() < 1e-9 * forces.len() as f64);
    assert!(embedding.transfer().apply_transpose(&forces[1..]).is_err());
}

/// Returns each point interpolated from four of the `nodes` by weights of sum 1: Σ w_k x_k.
fn carry(shares: &[([u32; 4], [f64; 4])], nodes: &[DVec3]) -> Vec<DVec3> {
    let at = |(corners, weights): &([u32; 4], [f64; 4])| {
        let parts = corners.iter().zip(weights);
        parts.map(|(v, w)| *w * nodes[*v as usize]).sum()
    };
    shares.iter().map(at).collect()
}
