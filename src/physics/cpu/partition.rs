//! Partition of a body's nodes into consecutive chunks, one per thread.
//!
//! The order of summation depends only on the chunks, so that runs with the same number of threads
//! are bitwise identical.

use std::ops::Range;

/// Fewest nodes per thread for which another thread pays off.
const MIN_NODES_PER_THREAD: usize = 1600;

/// A partition of a body's nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Partition {
    /// First node of each chunk, and the number of nodes.
    bounds: Vec<usize>,
    /// First group of each chunk, and the number of groups.
    group_bounds: Vec<usize>,
    /// First node of each group, and the number of nodes.
    starts: Vec<usize>,
}

impl Partition {
    /// Partitions groups that begin at `starts` (the number of nodes last) into chunks of whole
    /// groups: one, or up to the number of threads if there is enough work.
    pub fn new(starts: Vec<usize>) -> Partition {
        let nodes = starts.last().copied().unwrap_or(0);
        let threads = rayon::current_num_threads();
        Partition::with_chunks(starts, threads.min(nodes / MIN_NODES_PER_THREAD))
    }

    /// As [`Partition::new`], with `chunks` chunks, or fewer if there are fewer groups.
    pub fn with_chunks(starts: Vec<usize>, chunks: usize) -> Partition {
        let groups = starts.len().saturating_sub(1);
        let nodes = starts.last().copied().unwrap_or(0);
        let chunks = chunks.clamp(1, groups.max(1));
        let mut group_bounds = vec![0];
        for c in 1..chunks {
            // At least one group per chunk.
            let near = starts.partition_point(|s| *s < nodes * c / chunks);
            group_bounds.push(near.clamp(group_bounds[c - 1] + 1, groups - (chunks - c)));
        }
        group_bounds.push(groups);
        Partition {
            bounds: group_bounds.iter().map(|g| starts[*g]).collect(),
            group_bounds,
            starts,
        }
    }

    /// Number of chunks.
    pub fn chunks(&self) -> usize {
        self.bounds.len() - 1
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.bounds.last().copied().unwrap_or(0)
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The nodes of a group.
    pub fn group(&self, group: usize) -> Range<usize> {
        self.starts[group]..self.starts[group + 1]
    }

    /// The groups of a chunk.
    pub fn groups_of(&self, chunk: usize) -> Range<usize> {
        self.group_bounds[chunk]..self.group_bounds[chunk + 1]
    }

    /// The nodes of a chunk.
    pub fn range(&self, chunk: usize) -> Range<usize> {
        self.bounds[chunk]..self.bounds[chunk + 1]
    }

    /// Returns the chunk of node `i`.
    pub fn chunk_of(&self, i: usize) -> usize {
        self.bounds.partition_point(|b| *b <= i).saturating_sub(1)
    }

    /// Calls `work(chunk, its nodes, its share of data)` for all chunks in parallel, and sums the
    /// results.
    pub fn for_each_chunk<const K: usize, S: SplitData>(
        &self,
        data: S,
        work: &(impl Fn(usize, Range<usize>, S) -> [f64; K] + Sync),
    ) -> [f64; K] {
        self.for_each_in(0, self.chunks(), data, work)
    }

    fn for_each_in<const K: usize, S: SplitData>(
        &self,
        from: usize,
        to: usize,
        data: S,
        work: &(impl Fn(usize, Range<usize>, S) -> [f64; K] + Sync),
    ) -> [f64; K] {
        if to - from <= 1 {
            return work(from, self.range(from), data);
        }
        let middle = (from + to) / 2;
        let nodes = self.bounds[middle] - self.bounds[from];
        let (left, right) = data.split(SplitPoint {
            chunks: middle - from,
            nodes,
            groups: self.group_bounds[middle] - self.group_bounds[from],
        });
        let (mut left, mut right) = (Some(left), Some(right));
        let (mut sums, mut others) = ([0.0; K], [0.0; K]);
        join(
            &mut || {
                if let Some(data) = left.take() {
                    sums = self.for_each_in(from, middle, data, work);
                }
            },
            &mut || {
                if let Some(data) = right.take() {
                    others = self.for_each_in(middle, to, data, work);
                }
            },
        );
        for (s, o) in sums.iter_mut().zip(others) {
            *s += o;
        }
        sums
    }

    /// Runs `work` on a pool thread if the plan has several chunks: from outside the pool, every
    /// call of [`Partition::for_each_chunk`] would have to wake it.
    pub fn in_pool<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self.chunks() {
            1 => work(),
            _ => rayon::scope(|_| work()),
        }
    }
}

/// Runs both in parallel. Dynamic dispatch compiles rayon's code once, not for every `work`.
fn join(left: &mut (dyn FnMut() + Send), right: &mut (dyn FnMut() + Send)) {
    rayon::join(left, right);
}

/// Numbers of items of each kind on the left side of a split.
#[derive(Clone, Copy, Debug)]
pub struct SplitPoint {
    chunks: usize,
    nodes: usize,
    groups: usize,
}

/// Data that can be split among chunks.
pub trait SplitData: Sized + Send {
    /// Splits into the part of the chunks on the left, and the rest.
    fn split(self, cut: SplitPoint) -> (Self, Self);
}

impl SplitData for () {
    fn split(self, _: SplitPoint) -> (Self, Self) {
        ((), ())
    }
}

macro_rules! share_slice {
    ($(#[$doc:meta])* $name:ident, $count:ident) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub struct $name<'a, A>(pub &'a mut [A]);

        impl<A: Send> SplitData for $name<'_, A> {
            fn split(self, cut: SplitPoint) -> (Self, Self) {
                let (left, right) = self.0.split_at_mut(cut.$count.min(self.0.len()));
                ($name(left), $name(right))
            }
        }
    };
}

share_slice!(
    /// One item per node.
    Nodes,
    nodes
);
share_slice!(
    /// One item per group.
    Groups,
    groups
);
share_slice!(
    /// One item per chunk.
    Chunks,
    chunks
);

macro_rules! share_tuple {
    ($($name:ident $n:tt),+) => {
        impl<$($name: SplitData),+> SplitData for ($($name,)+) {
            fn split(self, cut: SplitPoint) -> (Self, Self) {
                let parts = ($(self.$n.split(cut),)+);
                (($(parts.$n.0,)+), ($(parts.$n.1,)+))
            }
        }
    };
}

share_tuple!(A 0, B 1);
share_tuple!(A 0, B 1, C 2);
share_tuple!(A 0, B 1, C 2, D 3);
