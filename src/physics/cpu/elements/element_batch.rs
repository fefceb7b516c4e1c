//! What a term of finite elements needs of four elements, one per SIMD lane.

use super::batch::{LaneMat3, TetBatch, TetPoint};
use super::kernels::{NODE_PAIRS, unpack_blocks};
use super::nodal_volumes::{NodalVolumeTerm, VolumeSources};
use super::term::{CountedTet, SortedTet};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::vectors::V4;
use crate::physics::{ConstitutiveModel, Element, Elements, LocalUnits};
use std::ops::Range;

/// An element in a list of a chunk, and whether the chunk counts its energy.
pub(in crate::physics::cpu) type Counted<I> = (I, bool);

/// A 3×3 block of each of four elements, as padded columns.
pub(in crate::physics::cpu) type FourBlocks<T> = [[V4<T>; 3]; 4];

/// State for the forces of elements: displacements, velocities, and β of the damping.
pub(in crate::physics::cpu) type DampedState<'a, T> = (&'a [V4<T>], &'a [V4<T>], T);

/// Model and layout that batches are made from.
#[derive(Clone, Copy)]
pub(in crate::physics::cpu) struct ElementSources<'a> {
    pub elements: &'a Elements,
    pub units: &'a LocalUnits,
    /// Engine index of each node.
    pub engine_index: &'a [u32],
}

/// Four elements of the same kind; the padding of the last batch of a list has zero volume.
pub(in crate::physics::cpu) trait ElementBatch<T: Real>:
    std::fmt::Debug + Send + Sync + Sized + 'static
{
    /// An element with its nodes in the engine's order; elements close in memory compare as close.
    type Item: Copy + Ord;

    /// Pairs of nodes whose blocks are assembled.
    const PAIRS: &'static [[usize; 2]];

    /// Returns all elements in ascending order.
    fn sorted(sources: &ElementSources<'_>) -> Vec<Self::Item>;

    /// Returns the nodes of an element.
    fn nodes(item: &Self::Item) -> &[u32];

    /// Returns the index of an element.
    fn element(item: &Self::Item) -> usize;

    /// Returns an element with its nodes, in the same order, numbered from `first`.
    fn renumbered(item: &Self::Item, first: u32) -> Self::Item;

    /// Creates a batch of up to four elements; the padding refers to node `fill`.
    fn new(own: &[Counted<Self::Item>], sources: &ElementSources<'_>, fill: u32) -> Self;

    /// Creates the nodal volumes of the chunk `nodes` with these elements inside and across its
    /// border, if the formulation has them.
    fn volumes(
        _: &ElementSources<'_>,
        _nodes: Range<usize>,
        _sorted: &[Self::Item],
        _lists: [&[Counted<Self::Item>]; 2],
        _implicit: bool,
    ) -> Option<NodalVolumeTerm<T>> {
        None
    }

    /// The batches as linear tets, if they are; nodal volumes need them.
    fn as_tets(_: &[Self]) -> &[TetBatch<T>] {
        &[]
    }

    /// Returns the energy of each element at the displacements `u`.
    fn energy(&self, law: ConstitutiveModel, u: &[V4<T>]) -> T::Lanes;

    /// Whether any of the elements is inverted at the displacements `u`.
    fn inverted(&self, u: &[V4<T>]) -> bool;

    /// Adds the forces, and the β damping forces for the velocities `v` if `DAMPED`, to the nodes
    /// that lie within `f`, which begins with node `first`; all do if `INNER`. `pressure` is an
    /// additional pressure times the volume, and its rate. Returns the energy of each element.
    fn forces<const INNER: bool, const DAMPED: bool>(
        &self,
        law: ConstitutiveModel,
        at: DampedState<'_, T>,
        pressure: [T::Lanes; 2],
        first: usize,
        f: &mut [V4<T>],
    ) -> T::Lanes;

    /// Computes the blocks of [`ElementBatch::PAIRS`], in their order, at constant additional
    /// pressure, times `scale`.
    fn blocks(
        &self,
        with: (ConstitutiveModel, bool),
        u: &[V4<T>],
        pressure: T::Lanes,
        scale: T::Lanes,
        emit: impl FnMut(usize, FourBlocks<T>),
    );

    /// Calls `of_point` for each quadrature point with the gradients of nodal `fields`, and adds −P ∇N of each
    /// stress times the volume that it returns to the nodes of the vectors `out`.
    fn distribute(
        &self,
        fields: &[Vec<V4<T>>],
        of_point: impl FnMut(&TetPoint<T>, &[LaneMat3<T::Lanes>], &mut [LaneMat3<T::Lanes>]),
        out: &mut [Vec<V4<T>>],
    );
}

impl<T: Real> ElementBatch<T> for TetBatch<T> {
    type Item = SortedTet;

    const PAIRS: &'static [[usize; 2]] = &NODE_PAIRS;

    fn sorted(sources: &ElementSources<'_>) -> Vec<SortedTet> {
        let of_tet = |(t, tet): (usize, &Element)| {
            let nodes = tet.nodes.map(|v| sources.engine_index[v as usize]);
            let mut turn = [0, 1, 2, 3];
            turn.sort_unstable_by_key(|a| nodes[*a]);
            (turn.map(|a| nodes[a]), turn, t as u32)
        };
        let tets = sources.elements.tets.iter().enumerate();
        let mut sorted: Vec<SortedTet> = tets.map(of_tet).collect();
        sorted.sort_unstable();
        sorted
    }

    fn nodes(item: &SortedTet) -> &[u32] {
        &item.0
    }

    fn element((_, _, t): &SortedTet) -> usize {
        *t as usize
    }

    fn renumbered((_, turn, t): &SortedTet, first: u32) -> SortedTet {
        ([0, 1, 2, 3].map(|k| first + k), *turn, *t)
    }

    fn new(own: &[CountedTet], sources: &ElementSources<'_>, fill: u32) -> TetBatch<T> {
        TetBatch::of_tets(own, sources.elements, sources.units, fill)
    }

    fn volumes(
        sources: &ElementSources<'_>,
        nodes: Range<usize>,
        sorted: &[SortedTet],
        lists: [&[CountedTet]; 2],
        implicit: bool,
    ) -> Option<NodalVolumeTerm<T>> {
        let cells = sources.elements.cells();
        (!cells.cells.is_empty()).then(|| {
            let volumes = VolumeSources {
                elements: sources.elements,
                units: sources.units,
                cells: &cells,
                place: sources.engine_index,
                sorted,
            };
            NodalVolumeTerm::new(&volumes, nodes, lists, implicit)
        })
    }

    fn as_tets(batches: &[TetBatch<T>]) -> &[TetBatch<T>] {
        batches
    }

    #[inline(always)]
    fn energy(&self, law: ConstitutiveModel, u: &[V4<T>]) -> T::Lanes {
        self.point.energy(law, &self.gradient(u))
    }

    #[inline(always)]
    fn inverted(&self, u: &[V4<T>]) -> bool {
        self.point.inverted(&self.gradient(u))
    }

    #[inline(always)]
    fn forces<const INNER: bool, const DAMPED: bool>(
        &self,
        law: ConstitutiveModel,
        (u, v, damping): DampedState<'_, T>,
        pressure: [T::Lanes; 2],
        first: usize,
        f: &mut [V4<T>],
    ) -> T::Lanes {
        let g = self.gradient(u);
        let (mut stress, energy) = self.point.stress(law, &g, pressure[0]);
        if DAMPED {
            let rate = self.gradient(v);
            let change = self.point.stress_differential(law, &g, &rate, pressure);
            for (s, c) in stress
                .as_flattened_mut()
                .iter_mut()
                .zip(change.as_flattened())
            {
                *s = *s + damping.splat() * *c;
            }
        }
        self.scatter::<INNER>(&stress, first, f);
        energy
    }

    #[inline(always)]
    fn blocks(
        &self,
        with: (ConstitutiveModel, bool),
        u: &[V4<T>],
        pressure: T::Lanes,
        scale: T::Lanes,
        mut emit: impl FnMut(usize, FourBlocks<T>),
    ) {
        let g = self.gradient(u);
        self.point.blocks(with, &g, pressure, scale, |n, block| {
            emit(n, unpack_blocks::<T>(&block));
        });
    }

    fn distribute(
        &self,
        fields: &[Vec<V4<T>>],
        mut of_point: impl FnMut(&TetPoint<T>, &[LaneMat3<T::Lanes>], &mut [LaneMat3<T::Lanes>]),
        out: &mut [Vec<V4<T>>],
    ) {
        let gradients: Vec<LaneMat3<T::Lanes>> = fields.iter().map(|u| self.gradient(u)).collect();
        let mut stresses = vec![[[T::Lanes::splat(0.0); 3]; 3]; out.len()];
        of_point(&self.point, &gradients, &mut stresses);
        for (stress, out) in stresses.iter().zip(out) {
            self.scatter::<true>(stress, 0, out);
        }
    }
}
