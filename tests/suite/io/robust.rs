//! Damaged files give an error, never a panic, a hang or a wrong mesh.

use crate::io::sample::{Bench, bits};
use proptest::prelude::*;

#[test]
fn rejects_mesh_truncated_at_any_byte() {
    let bench = Bench::new();
    for (number, fixture) in crate::io::encode::all().into_iter().enumerate() {
        let whole = bits(&fixture.expected);
        let (bytes, second) = (&fixture.bytes, fixture.second.as_deref());
        // The many VTU variants share the truncation positions, except for the tail.
        let shared = fixture.name.ends_with(".vtu");
        for cut in 0..bytes.len() {
            if shared && cut % 24 != number % 24 && cut + 32 < bytes.len() {
                continue;
            }
            if let Ok(mesh) = bench.read_as(&fixture, &bytes[..cut], second) {
                let same = bits(&mesh) == whole && bytes[cut..].trim_ascii().is_empty();
                assert!(
                    same || fixture.may_end.contains(&cut),
                    "{} truncated at byte {cut} of {} is accepted",
                    fixture.name,
                    bytes.len()
                );
            }
        }
        let Some(second) = second else { continue };
        for cut in 0..second.len() {
            if let Ok(mesh) = bench.read_as(&fixture, bytes, Some(&second[..cut])) {
                let same = bits(&mesh) == whole && second[cut..].trim_ascii().is_empty();
                assert!(
                    same,
                    "{}: .ele truncated at byte {cut} is accepted",
                    fixture.name
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Random damage is read or rejected without a panic, and the result is valid.
    #[test]
    fn damaged_meshes_never_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        insert in any::<bool>(),
    ) {
        let bench = Bench::new();
        for fixture in crate::io::encode::all() {
            let mut bytes = fixture.bytes.clone();
            for (at, value) in &damage {
                let at = at.index(bytes.len());
                if insert {
                    bytes.insert(at, *value);
                } else {
                    bytes[at] = *value;
                }
            }
            if let Ok(mesh) = bench.read_as(&fixture, &bytes, fixture.second.as_deref()) {
                prop_assert!(mesh.tets.iter().flatten().all(|v| (*v as usize) < mesh.nodes.len()));
                prop_assert!(mesh.nodes.iter().all(|p| p.is_finite()));
            }
        }
    }

    /// The same for text of valid words in wrong places.
    #[test]
    fn shuffled_tokens_never_panic(swaps in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>()), 1..4)) {
        let bench = Bench::new();
        for fixture in crate::io::encode::all() {
            let Ok(text) = std::str::from_utf8(&fixture.bytes) else { continue };
            let mut words: Vec<&str> = text.split_inclusive(char::is_whitespace).collect();
            for (a, b) in &swaps {
                let (a, b) = (a.index(words.len()), b.index(words.len()));
                words.swap(a, b);
            }
            let _ = bench.read_as(&fixture, words.concat().as_bytes(), fixture.second.as_deref());
        }
    }
}
