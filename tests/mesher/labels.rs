//! Label volumes.

use crate::support::{angles, faults, filled, options, volume_of};
use palpate::mesher::LabelDomain;
use proptest::prelude::*;

fn noise(seed: u64, n: usize) -> u64 {
    let mut x = seed ^ (n as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn random_labels_are_filled_soundly(
        seed: u64,
        labels in 2u64..=6,
        block in 1usize..=4,
        edge in 0.6f64..3.0,
        grading in 0u32..3,
    ) {
        let n = 10;
        let volume = volume_of([n; 3], |[i, j, k]| {
            let cell = i / block + 100 * (j / block) + 10_000 * (k / block);
            (noise(seed, cell) % labels) as u8
        });
        let Ok(domain) = LabelDomain::new(&volume, None) else { return Ok(()) };
        let f = filled(&domain, &options(edge, f64::from(1 << grading)));

        prop_assert_eq!(faults(&f), Vec::<String>::new());
        prop_assert!(angles(&f).0 > 4.0);
    }
}
