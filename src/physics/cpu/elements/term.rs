//! Hyperelastic tetrahedra as a term of a body's energy.
//!
//! A chunk of nodes stores the tetrahedra with all nodes in the chunk and those with some. Every
//! chunk that has a node of a shared tetrahedron computes it, so that no chunk writes to the nodes
//! of another.

use super::batch::{TetBatch, TetPoint};
use super::element_batch::{Counted, DampedState, ElementBatch, ElementSources};
use super::nodal_volumes::NodalVolumeTerm;
use crate::physics::cpu::linear::block_csr::BlockCsr;
use crate::physics::cpu::partition::{Chunks, Nodes, Partition};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::term::{StateRef, SystemContribution, Term};
use crate::physics::cpu::vectors::{Mat3Columns, V4, scale, sub, sum_f64, zero};
use crate::physics::{ConstitutiveModel, DiscreteModel, Elements, LocalUnits};
use glam::{DMat3, DVec3};
use std::ops::Range;

/// Tetrahedra of a chunk, in batches of four.
#[derive(Debug)]
struct List<T: Real, B> {
    batches: Vec<B>,
    /// Destination of the blocks of each batch: for each node pair one slot per tetrahedron.
    block_slots: Vec<[u32; 4]>,
    /// 1, or 0 for tetrahedra whose energy another chunk counts.
    energy_mask: Vec<V4<T>>,
}

/// Tetrahedra of a chunk of nodes.
#[derive(Debug)]
struct Chunk<T: Real, B> {
    first: usize,
    /// Tetrahedra with all nodes in the chunk.
    interior: List<T, B>,
    /// Tetrahedra with some nodes in the chunk.
    shared: List<T, B>,
    /// Averaged nodal volumes, if the formulation uses them.
    volumes: Option<NodalVolumeTerm<T>>,
    rows: BlockCsr<T>,
    /// β K of the damping, in the sparsity pattern of the rows.
    damping: Vec<Mat3Columns<T>>,
    /// α m of every node, if α is not 0.
    mass_damping: Vec<T>,
}

/// All tetrahedra of a body, in batches `B`.
#[derive(Debug)]
pub struct ElementTerm<T: Real, B> {
    law: ConstitutiveModel,
    chunks: Vec<Chunk<T, B>>,
    /// β, local units.
    damping: T,
    projected: bool,
}

/// Options for linearising the tetrahedra of a chunk.
#[derive(Clone, Copy)]
struct AssemblyOptions<T> {
    law: ConstitutiveModel,
    projected: bool,
    /// Factor of the blocks.
    scale: T,
    /// Factor of the β K to add.
    damping: T,
}

impl<T: Real, B: ElementBatch<T>> ElementTerm<T, B> {
    /// Creates the term for `elements`, those of `model`, whose node `order[k]` is the engine's
    /// k-th, partitioned by `plan`; `implicit` if they will be linearised.
    pub fn new(
        (model, elements): (&DiscreteModel, &Elements),
        (order, units, plan): (&[u32], LocalUnits, &Partition),
        implicit: bool,
    ) -> ElementTerm<T, B> {
        let mut engine_index = vec![0u32; order.len()];
        for (k, v) in order.iter().enumerate() {
            engine_index[*v as usize] = k as u32;
        }
        let sources = ElementSources {
            elements,
            units: &units,
            engine_index: &engine_index,
        };
        let sorted = B::sorted(&sources);
        let lists = lists_of_chunks::<T, B>(&sorted, plan);
        let alpha = elements.mass_damping / units.damping();
        let drag = |v: &u32| T::from_f64(alpha * model.masses[*v as usize]);
        let chunks = lists.into_iter().enumerate().map(|(c, (inner, outer))| {
            let own = || inner.iter().chain(&outer).map(|(item, _)| B::nodes(item));
            let rows = match implicit {
                true => BlockCsr::new(plan.range(c), own()),
                false => BlockCsr::default(),
            };
            let fill = plan.range(c).start as u32;
            let list = |own: &[_]| List::new(own, &sources, &rows, fill);
            Chunk {
                volumes: B::volumes(&sources, plan.range(c), &sorted, [&inner, &outer], implicit),
                first: plan.range(c).start,
                interior: list(&inner),
                shared: list(&outer),
                damping: Vec::new(),
                mass_damping: order[plan.range(c)]
                    .iter()
                    .filter(|_| alpha > 0.0)
                    .map(drag)
                    .collect(),
                rows,
            }
        });
        let mut term = ElementTerm {
            law: elements.law,
            chunks: chunks.collect(),
            damping: T::from_f64(model.damping_time / units.time),
            projected: false,
        };
        if term.damping > T::ZERO {
            for chunk in &mut term.chunks {
                chunk.damping = vec![[zero(); 3]; chunk.rows.values.len()];
                if let Some(volumes) = &mut chunk.volumes {
                    volumes.damp();
                }
            }
        }
        term
    }
}

/// The elements inside a chunk, and those across its border.
type ChunkLists<I> = (Vec<Counted<I>>, Vec<Counted<I>>);

/// Returns for every chunk the elements with all nodes in it, and those with some.
fn lists_of_chunks<T: Real, B: ElementBatch<T>>(
    sorted: &[B::Item],
    plan: &Partition,
) -> Vec<ChunkLists<B::Item>> {
    let mut lists = Vec::new();
    lists.resize_with(plan.chunks(), || (Vec::new(), Vec::new()));
    let mut homes = Vec::new();
    for item in sorted {
        homes.clear();
        homes.extend(B::nodes(item).iter().map(|v| plan.chunk_of(*v as usize)));
        homes.sort_unstable();
        homes.dedup();
        match homes[..] {
            [home] => lists[home].0.push((*item, true)),
            _ => {
                for (n, home) in homes.iter().enumerate() {
                    lists[*home].1.push((*item, n == 0));
                }
            }
        }
    }
    lists
}

/// A tetrahedron: its nodes in ascending order, their original positions, and its index.
pub(in crate::physics::cpu) type SortedTet = ([u32; 4], [usize; 4], u32);

/// A tetrahedron, and whether its energy is counted.
pub(in crate::physics::cpu) type CountedTet = (SortedTet, bool);

impl<T: Real> TetBatch<T> {
    /// Creates a batch of up to four elements; the padding refers to node `fill`.
    pub fn of_tets(
        own: &[CountedTet],
        elements: &Elements,
        units: &LocalUnits,
        fill: u32,
    ) -> TetBatch<T> {
        let mut nodes = [[fill; 4]; 4];
        let mut gradients = [[[T::ZERO; 4]; 3]; 3];
        let mut lame = [[T::ZERO; 4]; 2];
        for (l, ((sorted, turn, t), _)) in own.iter().enumerate() {
            let tet = elements.without_averaged_lambda(&elements.tets[*t as usize]);
            nodes[l] = *sorted;
            let all = tet.gradients();
            for k in 0..3 {
                let g: DVec3 = all[turn[k + 1]] * units.length;
                for (axis, x) in g.to_array().into_iter().enumerate() {
                    gradients[k][axis][l] = T::from_f64(x);
                }
            }
            for (to, modulus) in lame.iter_mut().zip(tet.lame_parameters) {
                to[l] = T::from_f64(modulus * tet.volume / units.energy());
            }
        }
        TetBatch {
            nodes,
            point: TetPoint {
                gradients: gradients.map(|g| g.map(|x| T::lanes(&x))),
                lame: lame.map(|l| T::lanes(&l)),
            },
        }
    }
}

impl<T: Real, B: ElementBatch<T>> List<T, B> {
    fn new(
        own: &[Counted<B::Item>],
        sources: &ElementSources<'_>,
        rows: &BlockCsr<T>,
        fill: u32,
    ) -> List<T, B> {
        let mut list = List {
            batches: Vec::new(),
            block_slots: Vec::new(),
            energy_mask: Vec::new(),
        };
        for four in own.chunks(4) {
            let mut counted = [T::ZERO; 4];
            for (to, (_, counts)) in counted.iter_mut().zip(four) {
                *to = T::of_bit(u32::from(*counts));
            }
            for [a, b] in B::PAIRS {
                let mut slots = [0; 4];
                for (slot, (item, _)) in slots.iter_mut().zip(four) {
                    let nodes = B::nodes(item);
                    *slot = rows.entry_slot(nodes[*a], nodes[*b]);
                }
                list.block_slots.push(slots);
            }
            list.batches.push(B::new(four, sources, fill));
            list.energy_mask.push(counted);
        }
        list
    }

    fn energy(&self, law: ConstitutiveModel, u: &[V4<T>]) -> f64 {
        let batches = self.batches.iter().zip(&self.energy_mask);
        batches
            .map(|(batch, counted)| sum_f64(T::array(batch.energy(law, u) * T::lanes(counted))))
            .sum()
    }

    fn inverted(&self, u: &[V4<T>]) -> bool {
        self.batches.iter().any(|batch| batch.inverted(u))
    }

    /// As [`ElementBatch::forces`]. `push` returns the additional pressure in the tetrahedra of a
    /// batch, and its rate.
    #[inline(always)]
    fn forces<const INNER: bool, const DAMPED: bool>(
        &self,
        law: ConstitutiveModel,
        at: DampedState<'_, T>,
        push: impl Fn(usize) -> [T::Lanes; 2],
        first: usize,
        f: &mut [V4<T>],
    ) -> f64 {
        let mut sum = 0.0;
        for (n, (batch, counted)) in self.batches.iter().zip(&self.energy_mask).enumerate() {
            let energy = batch.forces::<INNER, DAMPED>(law, at, push(n), first, f);
            sum += sum_f64(T::array(energy * T::lanes(counted)));
        }
        sum
    }

    #[inline(always)]
    fn assemble(
        &self,
        how: AssemblyOptions<T>,
        u: &[V4<T>],
        push: impl Fn(usize) -> [T::Lanes; 2],
        rows: &mut BlockCsr<T>,
    ) {
        let all_slots = self.block_slots.chunks(B::PAIRS.len());
        for (k, (batch, slots)) in self.batches.iter().zip(all_slots).enumerate() {
            let (with, scale) = ((how.law, how.projected), how.scale.splat());
            batch.blocks(with, u, push(k)[0], scale, |n, blocks| {
                for (block, slot) in blocks.iter().zip(slots[n]) {
                    rows.add_placed(slot, block);
                }
            });
        }
    }
}

impl<T: Real, B: ElementBatch<T>> Chunk<T, B> {
    /// The linear tets inside the chunk and across its border, if its elements are linear.
    fn tets(&self) -> [&[TetBatch<T>]; 2] {
        [&self.interior, &self.shared].map(|list| B::as_tets(&list.batches))
    }

    fn assemble(&mut self, how: AssemblyOptions<T>, u: &[V4<T>]) {
        if how.damping > T::ZERO {
            for (to, from) in self.rows.values.iter_mut().zip(&self.damping) {
                *to = from.map(|c| scale(how.damping, c));
            }
        } else {
            self.rows.values.fill([zero(); 3]);
        }
        let (inner, outer, rows) = (&self.interior, &self.shared, &mut self.rows);
        if let Some(volumes) = &mut self.volumes {
            let lists = [inner, outer].map(|list| B::as_tets(&list.batches));
            {
                let changes = volumes.changes::<false>(u, u, lists);
                inner.assemble(how, u, |n| changes.tet_pressures(&volumes.inner, n), rows);
                outer.assemble(how, u, |n| changes.tet_pressures(&volumes.outer, n), rows);
            }
            volumes.linearise(u, lists, how.scale, how.damping);
        } else {
            inner.assemble(how, u, nothing, rows);
            outer.assemble(how, u, nothing, rows);
        }
        self.rows.finish();
    }

    #[inline(always)]
    fn forces<const DAMPED: bool>(
        &self,
        law: ConstitutiveModel,
        with: DampedState<'_, T>,
        f: &mut [V4<T>],
    ) -> f64 {
        let (inner, outer, first) = (&self.interior, &self.shared, self.first);
        let Some(volumes) = &self.volumes else {
            return inner.forces::<true, DAMPED>(law, with, nothing, first, f)
                + outer.forces::<false, DAMPED>(law, with, nothing, first, f);
        };
        let changes = volumes.changes::<DAMPED>(with.0, with.1, self.tets());
        let push = |n| changes.tet_pressures(&volumes.inner, n);
        let sum = inner.forces::<true, DAMPED>(law, with, push, first, f);
        let push = |n| changes.tet_pressures(&volumes.outer, n);
        sum + outer.forces::<false, DAMPED>(law, with, push, first, f) + volumes.energy(&changes)
    }

    fn energy(&self, law: ConstitutiveModel, u: &[V4<T>]) -> f64 {
        let shared = self.volumes.as_ref().map_or(0.0, |volumes| {
            volumes.energy(&volumes.changes::<false>(u, u, self.tets()))
        });
        self.interior.energy(law, u) + self.shared.energy(law, u) + shared
    }
}

/// No additional pressure.
#[inline(always)]
fn nothing<L: Lane>(_: usize) -> [L; 2] {
    [L::splat(0.0); 2]
}

impl<T: Real, B: ElementBatch<T>> Term<T> for ElementTerm<T, B> {
    fn forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let drag = &self.chunks[chunk].mass_damping;
        let velocities = &at.v[self.chunks[chunk].first..];
        for ((f, v), c) in f.iter_mut().zip(velocities).zip(drag) {
            *f = sub(*f, scale(*c, *v));
        }
        if self.damping == T::ZERO {
            return self.elastic_forces(chunk, at.u, f);
        }
        self.chunks[chunk].forces::<true>(self.law, (at.u, at.v, self.damping), f)
    }

    fn elastic_forces(&self, chunk: usize, u: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        self.chunks[chunk].forces::<false>(self.law, (u, u, T::ZERO), f)
    }

    fn energy(&self, chunk: usize, u: &[V4<T>]) -> f64 {
        self.chunks[chunk].energy(self.law, u)
    }

    fn inverted(&self, chunk: usize, u: &[V4<T>]) -> bool {
        let chunk = &self.chunks[chunk];
        chunk.interior.inverted(u) || chunk.shared.inverted(u)
    }

    fn freeze_damping(&mut self, plan: &Partition, u: &[V4<T>]) {
        if self.damping == T::ZERO {
            return;
        }
        let how = AssemblyOptions {
            law: self.law,
            projected: true,
            scale: self.damping,
            damping: T::ZERO,
        };
        plan.for_each_chunk((Chunks(&mut self.chunks), ()), &|_, _, (chunks, ())| {
            for chunk in chunks.0 {
                chunk.assemble(how, u);
                std::mem::swap(&mut chunk.rows.values, &mut chunk.damping);
                if let Some(volumes) = &mut chunk.volumes {
                    volumes.freeze_damping();
                }
            }
            []
        });
    }

    fn damped(&self) -> bool {
        self.damping > T::ZERO
    }

    fn damping_forces(&self, chunk: usize, at: StateRef<'_, T>, f: &mut [V4<T>]) -> f64 {
        let chunk = &self.chunks[chunk];
        if chunk.damping.is_empty() {
            return 0.0;
        }
        let shared = chunk.volumes.as_ref();
        let shared = shared.map_or(0.0, |v| v.subtract_damping_forces(chunk.first, at.v, f));
        0.5 * (chunk.rows.subtract_product(&chunk.damping, at.v, f) + shared)
    }

    fn set_psd_projection(&mut self, projected: bool) {
        self.projected = projected;
    }

    fn linearise(
        &mut self,
        plan: &Partition,
        at: StateRef<'_, T>,
        h: T,
        share: SystemContribution<'_, T>,
    ) {
        let how = AssemblyOptions {
            law: self.law,
            projected: self.projected,
            scale: h * h,
            damping: if self.damping > T::ZERO { h } else { T::ZERO },
        };
        let data = (Chunks(&mut self.chunks), Nodes(share.diagonal));
        plan.for_each_chunk(data, &|_, _, (chunks, diagonal)| {
            for chunk in chunks.0 {
                chunk.assemble(how, at.u);
                chunk.rows.add_diagonal(diagonal.0);
                if let Some(volumes) = &chunk.volumes {
                    volumes.add_diagonal(chunk.first, diagonal.0);
                }
            }
            []
        });
    }

    fn multiply(&self, chunk: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        let Chunk {
            rows,
            volumes,
            first,
            ..
        } = &self.chunks[chunk];
        rows.multiply(&rows.values, p, y);
        if let Some(volumes) = volumes {
            volumes.multiply(*first, p, y);
        }
    }

    fn visit_off_diagonal(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for chunk in &self.chunks {
            chunk.rows.visit_upper_blocks(visit);
            if let Some(volumes) = &chunk.volumes {
                volumes.pairs(visit);
            }
        }
    }

    fn visit_off_diagonal_in(&self, nodes: Range<usize>, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        let inside = nodes.end as u32;
        for chunk in &self.chunks {
            chunk.rows.pairs_of(nodes.clone(), &mut |[i, j], m| {
                if j < inside {
                    visit([i, j], m);
                }
            });
            if let Some(volumes) = &chunk.volumes {
                volumes.pairs(&mut |pair, m| {
                    if pair.iter().all(|i| nodes.contains(&(*i as usize))) {
                        visit(pair, m);
                    }
                });
            }
        }
    }
}
