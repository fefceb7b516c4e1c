//! Parallel loops on rayon's threads.
//!
//! Rayon's own iterators are compiled anew for every closure, thousands of lines each time; this
//! module asks rayon for one loop that is compiled once. The size of the chunks depends on the
//! number of items alone, so sums over chunks are the same on any number of threads.

use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Maximum number of chunks; enough to balance the load on a machine with many cores.
const MAX_CHUNKS: usize = 128;
/// Number of cheap items below which a second thread costs more than it saves.
const MIN_ITEMS_PER_THREAD: usize = 256;

/// Returns of(0), …, of(n − 1), for cheap calls.
pub(crate) fn map<B: Send>(n: usize, of: impl Fn(usize) -> B + Sync) -> Vec<B> {
    gather(n, MIN_ITEMS_PER_THREAD, &|range, made| {
        made.extend(range.map(&of))
    })
}

/// Returns of(0), …, of(n − 1), for calls that are each worth a thread.
pub(crate) fn map_coarse<B: Send>(n: usize, of: impl Fn(usize) -> B + Sync) -> Vec<B> {
    gather(n, 1, &|range, made| made.extend(range.map(&of)))
}

/// Concatenates the items that `work` pushes for consecutive chunks of 0..n, in order.
pub(crate) fn collect<B: Send>(
    n: usize,
    work: impl Fn(Range<usize>, &mut Vec<B>) + Sync,
) -> Vec<B> {
    gather(n, MIN_ITEMS_PER_THREAD, &work)
}

/// Returns of(0) + … + of(n − 1), summed by chunks.
pub(crate) fn sum(n: usize, of: impl Fn(usize) -> f64 + Sync) -> f64 {
    let sums = collect(n, |range, sums| sums.push(range.map(&of).sum::<f64>()));
    sums.iter().sum()
}

/// Compiled once for every item type, not for every `work`.
fn gather<B: Send>(
    n: usize,
    least: usize,
    work: &(dyn Fn(Range<usize>, &mut Vec<B>) + Sync),
) -> Vec<B> {
    let length = n.div_ceil(MAX_CHUNKS).max(least);
    let mut all = Vec::new();
    if n <= length {
        work(0..n, &mut all);
        return all;
    }
    let chunks = (0..n.div_ceil(length)).map(|_| Mutex::new(Vec::new()));
    let chunks: Vec<Mutex<Vec<B>>> = chunks.collect();
    run_parallel(chunks.len(), &|c| {
        let mut made = Vec::new();
        work(c * length..n.min((c + 1) * length), &mut made);
        *chunks[c].lock().unwrap_or_else(PoisonError::into_inner) = made;
    });
    let chunks = chunks.into_iter().map(Mutex::into_inner);
    let chunks: Vec<Vec<B>> = chunks
        .map(|made| made.unwrap_or_else(PoisonError::into_inner))
        .collect();
    all.reserve_exact(chunks.iter().map(Vec::len).sum());
    for mut made in chunks {
        all.append(&mut made);
    }
    all
}

/// Calls run(0), …, run(parts − 1) on all threads. Each part is a separate job, so idle threads
/// steal work.
fn run_parallel(parts: usize, run: &(dyn Fn(usize) + Sync)) {
    let parts = (0..parts).into_par_iter().with_max_len(1);
    parts.for_each(run);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_item_order_for_any_count() {
        for n in [
            0,
            1,
            MAX_CHUNKS + 1,
            MIN_ITEMS_PER_THREAD + 1,
            MIN_ITEMS_PER_THREAD * MAX_CHUNKS + 1,
        ] {
            let all: Vec<usize> = (0..n).collect();
            assert_eq!(map(n, |i| i), all);
            assert_eq!(map_coarse(n, |i| i), all);
            let even = collect(n, |range, even| even.extend(range.filter(|i| i % 2 == 0)));
            assert_eq!(even, (0..n).step_by(2).collect::<Vec<_>>());
            assert_eq!(sum(n, |i| i as f64), all.iter().sum::<usize>() as f64);
        }
    }
}
