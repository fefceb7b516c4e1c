//! Presses, and maps of them, on meshes refined until a force is as exact as wanted.

use crate::press::{block, finger, map_of};
use crate::support::gpu;
use palpate::accuracy::Round;
use palpate::press::{MapPoint, PointResult, Press, PressMap};
use palpate::render::Image;
use palpate::scene::Scene;

/// Presses on a body refined until its largest force is within a share of itself; returns the press and
/// the numbers of pictures of its meshes.
fn refined(scene: &Scene, share: f64, max_elements: usize) -> (Press, usize) {
    let mut scene = scene.clone();
    scene.accuracy.within = Some(share);
    scene.accuracy.max_tets = Some(max_elements);
    let mut pictures = 0;
    let mut on_round = |_: &Round, draw: &mut dyn FnMut() -> palpate::Result<Image>| {
        let picture = draw()?;
        pictures += usize::from(picture.values.chunks(4).any(|p| p[1] > p[0]));
        Ok(())
    };
    let of = (&scene, &finger());
    let press = Press::refined(&gpu(), of, &mut on_round, &|_, _| {
        std::ops::ControlFlow::Continue(())
    });
    (press.unwrap(), pictures)
}

/// The force on the block converges to 3.886 N (`--within 0.5%` with 16,800 quadratic tets, and 3.880 N with
/// 60,000 equal ones). The mesh of the round before misses the goal.
#[test]
fn refined_press_is_within_its_error() {
    let mut scene = block("[picture]\nsize = [40, 30]\n");
    scene.material.order = None;
    let (mut press, pictures) = refined(&scene, 0.04, 10_000);
    assert!(press.missed().is_none(), "{:?}", press.missed());
    let rounds = press.rounds().to_vec();
    assert_eq!(pictures, rounds.len());
    let orders: Vec<u32> = rounds.iter().map(|r| r.order).collect();
    assert_eq!(orders[..3], [1, 2, 2], "{rounds:?}");
    let last = rounds.last().unwrap();
    assert!(
        last.share().unwrap() <= 0.04 && last.elements < 5_000,
        "{last:?}"
    );
    for round in &rounds[1..] {
        let off = (round.value - 3.886).abs();
        assert!(off <= round.error.unwrap(), "{round:?}");
    }
    // The round before is not as exact, and its error says so.
    let before = &rounds[rounds.len() - 2];
    assert!(before.elements < last.elements && before.share().unwrap() > 0.04);
    assert!((before.value / 3.886 - 1.0).abs() > 0.02, "{before:?}");
    while press.advance().unwrap().is_some() {}
    press
        .estimate_error(&|_, _| std::ops::ControlFlow::Continue(()))
        .unwrap();
    let report = press.report(1.0);
    assert!(
        (report.max_force_n / last.value - 1.0).abs() < 2e-3,
        "{report:?}"
    );
    let error = report.max_force_error_n.unwrap();
    assert!(
        (report.max_force_n - 3.886).abs() < error && error < 0.045 * 3.886,
        "{error}"
    );
    assert_eq!(report.rounds, rounds);
}

#[test]
fn refined_press_says_what_goal_would_take() {
    let mut scene = block("[picture]\nsize = [40, 30]\n");
    scene.material.order = None;
    let (press, _) = refined(&scene, 1e-3, 2_000);
    let why = press.missed().unwrap();
    assert!(
        why.contains("more than the 2000 allowed (--max-tets)"),
        "{why}"
    );
    assert!(press.rounds().iter().all(|r| r.elements <= 2_000));
    // Without a second mesh, the error is estimated in the finer space.
    let (mut press, _) = refined(&scene, 0.05, 100);
    assert!(press.missed().is_some() && press.rounds().len() == 1);
    while press.advance().unwrap().is_some() {}
    press
        .estimate_error(&|_, _| std::ops::ControlFlow::Continue(()))
        .unwrap();
    let report = press.report(1.0);
    let error = report.max_force_error_n.unwrap();
    assert!(
        error > report.max_force_n - 3.886 && error < 8.0,
        "{report:?}"
    );
    // Linear tets, if the scene asks for them.
    let (press, _) = refined(&block("[picture]\nsize = [40, 30]\n"), 0.2, 20_000);
    assert!(
        press.rounds().iter().all(|r| r.order == 1),
        "{:?}",
        press.rounds()
    );
    let last = press.rounds().last().unwrap();
    assert!((last.value - 3.886).abs() < last.error.unwrap(), "{last:?}");
}

/// The stiffness of each point is within its error of that on finer meshes.
#[test]
fn refined_map_has_errors_that_hold() {
    let gpu = gpu();
    let map = |within: f64| {
        let mut scene = block("");
        scene.material.order = None;
        scene.accuracy.within = Some(within);
        let mut map = PressMap::new(&scene, &map_of([2, 1])).unwrap();
        map.measure(&gpu, &mut |_| Ok(())).unwrap();
        assert_eq!(map.missed(), 0);
        map
    };
    let results = |map: &PressMap| {
        let of = |p: &MapPoint| match p.pressed {
            Some(PointResult::Stiffness {
                n_per_m,
                error: Some(error),
            }) => [n_per_m, error],
            other => panic!("{other:?}"),
        };
        map.points().iter().map(of).collect::<Vec<_>>()
    };
    let (rough, fine) = (map(0.15), map(0.03));
    assert_ne!(rough.fingerprint(), fine.fingerprint());
    for ([rough, error], [fine, small]) in results(&rough).into_iter().zip(results(&fine)) {
        assert!(small < 0.03 * fine && small < error && error < 0.15 * rough);
        assert!((rough - fine).abs() < error + small, "{rough} {fine}");
        assert!((rough - fine).abs() > 1e-3 * fine, "the same mesh");
    }
    let error = rough.median_error().unwrap().total();
    assert!(error > 0.0 && rough.stiffest_error().is_some());
    // Restored results keep their errors.
    let mut scene = block("");
    scene.material.order = None;
    scene.accuracy.within = Some(0.15);
    let mut again = PressMap::new(&scene, &map_of([2, 1])).unwrap();
    assert_eq!(again.fingerprint(), rough.fingerprint());
    let found: Vec<Option<PointResult>> = rough.points().iter().map(|p| p.pressed).collect();
    again.restore(&found).unwrap();
    assert_eq!(again.median_error(), rough.median_error());
}
