//! In-place update of sorted lists.

/// Removes the items with the keys `removed` from `list` and inserts `added`; all are sorted by key.
/// Unchanged runs are moved as blocks, without inspecting them.
pub(crate) fn replace_sorted<T: Copy, K: Ord + Copy>(
    list: &mut Vec<T>,
    key: impl Fn(&T) -> K,
    removed: &[K],
    added: &[T],
) {
    let position = |list: &[T], from: usize, wanted: K| {
        from + list[from..].partition_point(|item| key(item) < wanted)
    };
    let (mut from, mut to) = (0, 0);
    for wanted in removed {
        let at = position(list, from, *wanted);
        if from != to {
            list.copy_within(from..at, to);
        }
        to += at - from;
        let found = list.get(at).is_some_and(|item| key(item) == *wanted);
        from = at + usize::from(found);
    }
    list.copy_within(from.., to);
    list.truncate(to + list.len() - from);
    // Backwards: each added item moves the following run to its final position.
    let mut end = list.len();
    list.extend_from_slice(added);
    for (k, item) in added.iter().enumerate().rev() {
        let at = list[..end].partition_point(|other| key(other) < key(item));
        list.copy_within(at..end, at + k + 1);
        list[at + k] = *item;
        end = at;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replace_sorted_keeps_list_sorted() {
        let mut list = vec![1, 3, 5, 7, 9];
        replace_sorted(&mut list, |x| *x, &[3, 4, 9], &[0, 3, 6, 11]);
        assert_eq!(list, [0, 1, 3, 5, 6, 7, 11]);
        replace_sorted(&mut list, |x| *x, &[0, 11], &[]);
        assert_eq!(list, [1, 3, 5, 6, 7]);
        replace_sorted(&mut list, |x| *x, &[], &[]);
        assert_eq!(list, [1, 3, 5, 6, 7]);
    }
}
