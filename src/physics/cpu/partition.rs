//! Work shared out among threads: a body's nodes in a few consecutive chunks, each thread one.
//!
//! Sums are added up in an order that the chunks alone decide, so that a run gives the same bits
//! whenever it has as many threads.

use std::ops::Range;

/// Nodes below which a second thread costs more than it gives.
const MIN_NODES_PER_THREAD: usize = 1600;

/// How a body's nodes are shared out.
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
    /// Nodes in groups that begin at `starts` (the number of nodes last), in chunks of whole
    /// groups: one, or as many as there are threads where there is work for them.
    pub fn new(starts: Vec<usize>) -> Partition {
        let nodes = starts.last().copied().unwrap_or(0);
        let threads = rayon::current_num_threads();
        Partition::with_chunks(starts, threads.min(nodes / MIN_NODES_PER_THREAD))
    }

    /// The same in `chunks` chunks, or fewer where there are not as many groups.
    pub fn with_chunks(starts: Vec<usize>, chunks: usize) -> Partition {
        let groups = starts.len().saturating_sub(1);
        let nodes = starts.last().copied().unwrap_or(0);
        let chunks = chunks.clamp(1, groups.max(1));
        let mut group_bounds = vec![0];
        for c in 1..chunks {
            // A group at least for every chunk.
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

    /// The chunk that node `i` is in.
    pub fn chunk_of(&self, i: usize) -> usize {
        self.bounds.partition_point(|b| *b <= i).saturating_sub(1)
    }

    /// Calls `work(chunk, its nodes, its share of data)` for every chunk, at the same time, and
    /// adds up what they return.
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

    /// Runs `work` on a thread of the pool where the plan has several chunks: from outside every
    /// single call of [`Partition::for_each_chunk`] would have to wake it.
    pub fn in_pool<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self.chunks() {
            1 => work(),
            _ => rayon::scope(|_| work()),
        }
    }
}

/// Does both at the same time. What rayon needs for it is compiled once, and not for every `work`.
fn join(left: &mut (dyn FnMut() + Send), right: &mut (dyn FnMut() + Send)) {
    rayon::join(left, right);
}

/// How much of each kind of data goes left.
#[derive(Clone, Copy, Debug)]
pub struct SplitPoint {
    chunks: usize,
    nodes: usize,
    groups: usize,
}

/// Data that can be shared out among chunks.
pub trait SplitData: Sized + Send {
    /// The part of the chunks on the left, and that of the others.
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
    /// An item a node.
    Nodes,
    nodes
);
share_slice!(
    /// An item a group.
    Groups,
    groups
);
share_slice!(
    /// An item a chunk.
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
