//! The nodes of the linear tets within quadratic ones: all nodes but those in the middle of an edge.

use crate::mesh::TET_EDGES;
use crate::physics::cpu::partition::Partition;
use crate::physics::model::elements::Elements;

/// Fewest linear-tet nodes per chunk.
const MIN_NODES_PER_CHUNK: usize = 400;

/// Nodes of a group of rigid-body modes, over the fourth root of the number of linear-tet nodes: the
/// factorised matrix of the groups then takes about the same share of the time at any size.
const NODES_PER_GROUP_RATIO: f64 = 4.0;

/// Nodes and partition of the linear tets within the quadratic ones of a body.
///
/// The displacement of every node is half the sum of those of its two parents: the ends of its edge,
/// or twice itself. Nodes of rigid bodies are their own parents.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct LinearTetNodes {
    /// For each linear-tet node its node in the engine's order; ascending.
    pub nodes: Vec<u32>,
    /// For each node of the engine its two parents, as linear-tet nodes.
    pub parents: Vec<[u32; 2]>,
    /// Those in the middle of an edge that ends at linear-tet node k:
    /// `middles[starts[k]..starts[k + 1]]`.
    starts: Vec<u32>,
    middles: Vec<u32>,
    /// Partition of the linear-tet nodes: each group of the engine's partition, divided.
    pub plan: Partition,
    /// First group of a rigid body in [`LinearTetNodes::plan`].
    pub first_rigid_group: usize,
}

impl LinearTetNodes {
    /// Finds the linear-tet nodes of `elements` in a body partitioned by `plan`, whose nodes from
    /// `first_rigid` on belong to rigid bodies; `engine_index` is the engine's index of each node of
    /// the model. `None` in a body of order 1.
    pub fn new(
        elements: &Elements,
        engine_index: &[u32],
        plan: &Partition,
        first_rigid: usize,
    ) -> Option<LinearTetNodes> {
        if elements.order() == 1 {
            return None;
        }
        let mut ends: Vec<Option<[u32; 2]>> = vec![None; plan.nodes()];
        for (tet, edges) in elements.tets.iter().zip(&elements.mid_edges) {
            for (middle, [a, b]) in edges.nodes.iter().zip(TET_EDGES) {
                let middle = engine_index[*middle as usize] as usize;
                if middle < first_rigid {
                    ends[middle] = Some([a, b].map(|n| engine_index[tet.nodes[n] as usize]));
                }
            }
        }
        let nodes: Vec<u32> = (0..plan.nodes() as u32)
            .filter(|i| ends[*i as usize].is_none())
            .collect();
        let mut number = vec![0u32; plan.nodes()];
        for (k, i) in nodes.iter().enumerate() {
            number[*i as usize] = k as u32;
        }
        let parents: Vec<[u32; 2]> = ends
            .iter()
            .enumerate()
            .map(|(i, ends)| match ends {
                Some(ends) => ends.map(|v| number[v as usize]),
                None => [number[i]; 2],
            })
            .collect();
        let (starts, middles) = middles_of(&parents, nodes.len());
        let (plan, first_rigid_group) = divide(plan, &nodes, first_rigid);
        Some(LinearTetNodes {
            nodes,
            parents,
            starts,
            middles,
            plan,
            first_rigid_group,
        })
    }

    /// The nodes in the middle of an edge that ends at linear-tet node `k`.
    #[inline]
    pub fn middles(&self, k: usize) -> &[u32] {
        &self.middles[self.starts[k] as usize..self.starts[k + 1] as usize]
    }

    /// Number of nodes that are not linear-tet nodes.
    pub fn removed(&self) -> usize {
        self.parents.len() - self.nodes.len()
    }
}

/// Lists the children of each of `count` parents, without those that are their own parent.
fn middles_of(parents: &[[u32; 2]], count: usize) -> (Vec<u32>, Vec<u32>) {
    let middles = || (0u32..).zip(parents).filter(|(_, [a, b])| a != b);
    let mut starts = vec![0u32; count + 1];
    for (_, parents) in middles() {
        parents.iter().for_each(|k| starts[*k as usize + 1] += 1);
    }
    for k in 0..count {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut all = vec![0; starts[count] as usize];
    for (i, parents) in middles() {
        for k in parents {
            all[next[*k as usize] as usize] = i;
            next[*k as usize] += 1;
        }
    }
    (starts, all)
}

/// Divides the groups of `plan`, restricted to the nodes `kept`, into smaller ones; each rigid body,
/// whose nodes come last, stays one. Returns the partition and the group of the first rigid body.
fn divide(plan: &Partition, kept: &[u32], first_rigid: usize) -> (Partition, usize) {
    let most = (NODES_PER_GROUP_RATIO * (kept.len() as f64).powf(0.25)).ceil() as usize;
    let mut starts = vec![0];
    let mut first_rigid_group = usize::MAX;
    for g in 0..plan.groups() {
        let group = plan.group(g);
        let [from, to] =
            [group.start, group.end].map(|end| kept.partition_point(|i| (*i as usize) < end));
        let parts = match group.start >= first_rigid {
            true => {
                first_rigid_group = first_rigid_group.min(starts.len() - 1);
                1
            }
            false => (to - from).div_ceil(most.max(1)),
        };
        starts.extend((1..=parts).map(|k| from + (to - from) * k / parts));
    }
    let chunks = plan.chunks().min(kept.len() / MIN_NODES_PER_CHUNK);
    (Partition::with_chunks(starts, chunks), first_rigid_group)
}
