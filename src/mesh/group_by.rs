//! Grouping of items by an integer key: a counting sort.

use crate::parallel;

/// Sorts `items`, given with their keys, by key, stably; also returns the start of each of the
/// `groups`, followed by the end of the last.
///
/// The iterator runs twice. There must be fewer than 2³² items.
pub(crate) fn group_by_key<T: Copy + Default>(
    groups: usize,
    items: impl Iterator<Item = (u32, T)> + Clone,
) -> (Vec<u32>, Vec<T>) {
    // Shifted by two entries, the counts become the starts of the groups and then, as the groups
    // fill up, their ends.
    let mut firsts = vec![0u32; groups + 2];
    for (group, _) in items.clone() {
        firsts[group as usize + 2] += 1;
    }
    for group in 2..groups + 2 {
        firsts[group] += firsts[group - 1];
    }
    let mut all = vec![T::default(); firsts[groups + 1] as usize];
    for (group, item) in items {
        let next = &mut firsts[group as usize + 1];
        all[*next as usize] = item;
        *next += 1;
    }
    firsts.truncate(groups + 1);
    (firsts, all)
}

/// Concatenates the items that `emit` pushes for each group of `items` (see [`group_by_key`]), the
/// group being sorted.
pub(crate) fn map_groups<T: Copy + Default + Ord + Sync, B: Send>(
    groups: usize,
    items: impl Iterator<Item = (u32, T)> + Clone,
    emit: impl Fn(&[T], &mut Vec<B>) + Sync,
) -> Vec<B> {
    let (firsts, items) = group_by_key(groups, items);
    parallel::collect(groups, |range, output| {
        let mut own = Vec::new();
        for group in range {
            own.clear();
            own.extend_from_slice(&items[firsts[group] as usize..firsts[group + 1] as usize]);
            own.sort_unstable();
            emit(&own, output);
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn group_by_key_preserves_item_order() {
        let items = [(2, 'a'), (0, 'b'), (2, 'c'), (4, 'd'), (0, 'e')];
        let (firsts, all) = group_by_key(6, items.into_iter());
        assert_eq!(firsts, [0, 2, 2, 4, 4, 5, 5]);
        assert_eq!(all, ['b', 'e', 'a', 'c', 'd']);
        assert_eq!(group_by_key::<u8>(0, [].into_iter()), (vec![0], vec![]));
    }

    #[test]
    fn map_groups_visits_sorted_groups_in_order() {
        let items = (0..10_000u32).rev().map(|i| (i % 700, i / 700));
        let most = map_groups(701, items, |own, most: &mut Vec<u32>| {
            assert!(own.is_sorted());
            most.extend(own.last());
        });
        let expected: Vec<u32> = (0..700).map(|g| (9_999 - g) / 700).collect();
        assert_eq!(most, expected);
    }
}
