//! Averaged nodal volumes of the tetrahedra around nodes, as in `physics::model::nodal_volume`.
//!
//! The Hessian of their energy ½ Σ_a Λ_a θ_a² has two parts: that of the volume of each tetrahedron
//! under the mean pressure of its corners, which is added to its blocks, and for each cell a the
//! outer product of Λ_a^½ ∂θ_a/∂x with itself, which couples all nodes around one. The outer
//! products are stored as vectors: rows with all of those blocks would be four times as wide.
//!
//! A chunk stores the cells of all its tetrahedra and computes them completely: `beyond` lists the
//! tetrahedra needed only for that.

use super::batch::{LaneVec3, TetBatch, cofactor_from_gradient, dot, times};
use super::term::{CountedTet, SortedTet};
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::simd::Lane;
use crate::physics::cpu::vectors::{SymMat3, V4, scale, sum_f64, zero};
use crate::physics::model::nodal_volume::{NO_NODAL_VOLUME, NodalVolumes};
use crate::physics::{Elements, LocalUnits};
use glam::{DMat3, DVec3};
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Inputs for the cells of a chunk.
pub(in crate::physics::cpu) struct VolumeSources<'a> {
    pub elements: &'a Elements,
    pub units: &'a LocalUnits,
    pub cells: &'a NodalVolumes,
    /// Engine index of each node of the network.
    pub place: &'a [u32],
    /// All tetrahedra.
    pub sorted: &'a [SortedTet],
}

/// Cells of the tetrahedra of a list, four tetrahedra at a time.
#[derive(Clone, Debug)]
pub(in crate::physics::cpu) struct TetVolumeLinks<T: Real> {
    /// Cells of each tetrahedron, in the order of its nodes.
    cells: Vec<[[u32; 4]; 4]>,
    /// Λ_t/4.
    shares: Vec<T::Lanes>,
    /// Accumulation index of the gradient of each of its cells with respect to each of its nodes.
    slots: Vec<[[[u32; 4]; 4]; 4]>,
}

/// Volumetric strains of the cells of a chunk.
#[derive(Debug, Default)]
pub(in crate::physics::cpu) struct VolumeStrains<T> {
    /// θ.
    volume_strain: Vec<T>,
    /// Rate of θ for the current velocities, if requested.
    rate: Vec<T>,
}

/// The cells of a chunk of nodes.
#[derive(Debug)]
pub(in crate::physics::cpu) struct NodalVolumeTerm<T: Real> {
    pub inner: TetVolumeLinks<T>,
    pub outer: TetVolumeLinks<T>,
    beyond: (Vec<TetBatch<T>>, TetVolumeLinks<T>),
    /// 1/Λ_a; the last entry, for tetrahedra without cells, is 0.
    inverse_moduli: Vec<T>,
    /// Λ_a, or 0 if another chunk counts the energy.
    counted: Vec<T>,
    /// Nodes of each cell, ascending.
    starts: Vec<u32>,
    columns: Vec<u32>,
    /// √s Λ_a^½ ∂θ_a/∂x, where s is the factor of the Hessian; one extra entry at the end.
    gradients: Vec<V4<T>>,
    /// The same gradients for the damping, if there is any, and the factor of their outer products.
    damping_gradients: Vec<V4<T>>,
    damping: T,
    /// Scratch buffer; only the chunk's own thread locks it.
    changes: Mutex<VolumeStrains<T>>,
}

impl<T: Real> NodalVolumeTerm<T> {
    /// Long because all parts share one numbering of the chunk's cells and of their nodes.
    ///
    /// Creates the cells of the tetrahedra of the chunk `nodes`: `lists` are the tetrahedra with
    /// all nodes in the chunk and those with some. `implicit` if they will be linearised.
    pub fn new(
        of: &VolumeSources<'_>,
        nodes: Range<usize>,
        lists: [&[CountedTet]; 2],
        implicit: bool,
    ) -> NodalVolumeTerm<T> {
        // Indices within the chunk, in the order of their nodes.
        let mut own: Vec<(u32, u32)> = Vec::new();
        let corners = |t: u32| of.cells.of_tet[t as usize];
        let place = |c: u32| of.place[of.cells.cells[c as usize].node as usize];
        for ((.., t), _) in lists.into_iter().flatten() {
            let known = corners(*t).into_iter().filter(|c| *c != NO_NODAL_VOLUME);
            own.extend(known.map(|c| (place(c), c)));
        }
        own.sort_unstable();
        own.dedup();
        let mut number = vec![NO_NODAL_VOLUME; of.cells.cells.len()];
        for (n, (_, c)) in own.iter().enumerate() {
            number[*c as usize] = n as u32;
        }
        let is_own = |c: &u32| {
            number
                .get(*c as usize)
                .is_some_and(|n| *n != NO_NODAL_VOLUME)
        };
        let mut listed = vec![false; of.elements.tets.len()];
        for ((.., t), _) in lists.into_iter().flatten() {
            listed[*t as usize] = true;
        }
        let beyond: Vec<CountedTet> = of
            .sorted
            .iter()
            .filter(|(.., t)| !listed[*t as usize] && corners(*t).iter().any(is_own))
            .map(|tet| (*tet, false))
            .collect();
        let mut entries = Vec::new();
        for ((sorted, _, t), _) in lists.into_iter().flatten().chain(&beyond) {
            for c in corners(*t).iter().filter(|c| is_own(c)) {
                entries.extend(sorted.map(|v| (number[*c as usize], v)));
            }
        }
        entries.sort_unstable();
        entries.dedup();
        let firsts = 0..=own.len() as u32;
        let starts: Vec<u32> = firsts
            .map(|n| entries.partition_point(|e| e.0 < n) as u32)
            .collect();
        let columns: Vec<u32> = entries.iter().map(|e| e.1).collect();
        let slot = |n: u32, v: u32| {
            let (from, to) = (starts[n as usize] as usize, starts[n as usize + 1] as usize);
            let found = columns[from..to].binary_search(&v);
            found.map_or(columns.len(), |at| from + at) as u32
        };
        let (nowhere, spare) = (own.len() as u32, columns.len() as u32);
        let joules = of.units.energy();
        let corners_of = |list: &[CountedTet]| {
            let mut all = TetVolumeLinks {
                cells: Vec::new(),
                shares: Vec::new(),
                slots: Vec::new(),
            };
            for four in list.chunks(4) {
                let mut cells = [[nowhere; 4]; 4];
                let mut slots = [[[spare; 4]; 4]; 4];
                let mut shares = [T::ZERO; 4];
                for (l, ((sorted, turn, t), _)) in four.iter().enumerate() {
                    let tet = &of.elements.tets[*t as usize];
                    let share = 0.25 * tet.volume * of.elements.averaged_lambda(tet);
                    shares[l] = T::from_f64(share / joules);
                    let mine = turn.map(|a| corners(*t)[a]);
                    for a in (0..4).filter(|a| is_own(&mine[*a])) {
                        let n = number[mine[a] as usize];
                        cells[l][a] = n;
                        slots[l][a] = sorted.map(|v| slot(n, v));
                    }
                }
                all.cells.push(cells);
                all.shares.push(T::lanes(&shares));
                if implicit {
                    all.slots.push(slots);
                }
            }
            all
        };
        let fill = nodes.start as u32;
        let batch = |four: &[CountedTet]| TetBatch::of_tets(four, of.elements, of.units, fill);
        let stiffness = |c: u32| of.cells.cells[c as usize].stiffness / joules;
        let counts = |c: u32| nodes.contains(&(place(c) as usize));
        NodalVolumeTerm {
            inner: corners_of(lists[0]),
            outer: corners_of(lists[1]),
            inverse_moduli: own
                .iter()
                .map(|(_, c)| T::from_f64(1.0 / stiffness(*c)))
                .chain([T::ZERO])
                .collect(),
            counted: own
                .iter()
                .map(|(_, c)| T::from_f64(if counts(*c) { stiffness(*c) } else { 0.0 }))
                .chain([T::ZERO])
                .collect(),
            gradients: vec![zero(); if implicit { columns.len() + 1 } else { 0 }],
            damping_gradients: Vec::new(),
            damping: T::ZERO,
            changes: Mutex::new(VolumeStrains {
                volume_strain: vec![T::ZERO; own.len() + 1],
                rate: vec![T::ZERO; own.len() + 1],
            }),
            beyond: (beyond.chunks(4).map(batch).collect(), corners_of(&beyond)),
            starts,
            columns,
        }
    }

    /// Allocates storage for damping.
    pub fn damp(&mut self) {
        self.damping_gradients = vec![zero(); self.gradients.len()];
    }

    fn lists<'a>(
        &'a self,
        [inner, outer]: [&'a [TetBatch<T>]; 2],
    ) -> [(&'a [TetBatch<T>], &'a TetVolumeLinks<T>); 3] {
        let (beyond, corners) = &self.beyond;
        [
            (inner, &self.inner),
            (outer, &self.outer),
            (beyond, corners),
        ]
    }

    /// Computes the volumetric strains at the displacements `u`, and their rates for the velocities
    /// `v` if `RATES`.
    pub fn changes<const RATES: bool>(
        &self,
        u: &[V4<T>],
        v: &[V4<T>],
        lists: [&[TetBatch<T>]; 2],
    ) -> MutexGuard<'_, VolumeStrains<T>> {
        let mut changes = self.changes.lock().unwrap_or_else(PoisonError::into_inner);
        let VolumeStrains {
            volume_strain,
            rate,
        } = &mut *changes;
        volume_strain.fill(T::ZERO);
        rate.fill(T::ZERO);
        for (batches, corners) in self.lists(lists) {
            let all = corners.cells.iter().zip(&corners.shares);
            for (batch, (cells, share)) in batches.iter().zip(all) {
                let (c, _, more) = cofactor_from_gradient(&batch.gradient(u));
                accumulate(volume_strain, cells, T::array(more * *share));
                if RATES {
                    let d = batch.gradient(v);
                    let more = dot(c[0], d[0]) + dot(c[1], d[1]) + dot(c[2], d[2]);
                    accumulate(rate, cells, T::array(more * *share));
                }
            }
        }
        for (k, over) in self.inverse_moduli.iter().enumerate() {
            volume_strain[k] = volume_strain[k] * *over;
            rate[k] = rate[k] * *over;
        }
        changes
    }

    /// Returns the energy counted by this chunk.
    pub fn energy(&self, changes: &VolumeStrains<T>) -> f64 {
        let each = self.counted.iter().zip(&changes.volume_strain);
        0.5 * each.map(|(c, j)| (*c * *j * *j).to_f64()).sum::<f64>()
    }

    /// Stores the gradients at `u` for a Hessian scaled by `by`, plus `damping` times the damping
    /// matrix.
    pub fn linearise(&mut self, u: &[V4<T>], lists: [&[TetBatch<T>]; 2], by: T, damping: T) {
        let mut slopes = std::mem::take(&mut self.gradients);
        slopes.fill(zero());
        for (batches, corners) in self.lists(lists) {
            let all = corners.slots.iter().zip(&corners.shares);
            for (batch, (slots, share)) in batches.iter().zip(all) {
                let (c, ..) = cofactor_from_gradient(&batch.gradient(u));
                let of_nodes = batch.point.all_gradients().map(|g| {
                    let [x, y, z]: LaneVec3<T::Lanes> = times(&c, g).map(|x| *share * x);
                    T::Lanes::transpose([x, y, z, T::Lanes::splat(0.0)])
                });
                for (l, slots) in slots.iter().enumerate() {
                    for (b, of_node) in of_nodes.iter().enumerate() {
                        for slots in slots {
                            let slope = &mut slopes[slots[b] as usize];
                            *slope = T::array(T::lanes(slope) + of_node[l]);
                        }
                    }
                }
            }
        }
        for (n, over) in self
            .inverse_moduli
            .iter()
            .enumerate()
            .take(self.starts.len() - 1)
        {
            let factor = (by * *over).sqrt();
            for slope in &mut slopes[self.starts[n] as usize..self.starts[n + 1] as usize] {
                *slope = scale(factor, *slope);
            }
        }
        self.gradients = slopes;
        self.damping = damping;
    }

    /// Uses the last linearisation as the damping matrix.
    pub fn freeze_damping(&mut self) {
        std::mem::swap(&mut self.gradients, &mut self.damping_gradients);
    }

    /// Iterates over the nodes and gradients of every cell.
    fn each<'a>(&'a self, slopes: &'a [V4<T>]) -> impl Iterator<Item = (&'a [u32], &'a [V4<T>])> {
        self.starts.windows(2).map(move |s| {
            let range = s[0] as usize..s[1] as usize;
            (&self.columns[range.clone()], &slopes[range])
        })
    }

    /// Returns the linearised parts, each with its factor.
    fn parts(&self) -> impl Iterator<Item = (&[V4<T>], T)> {
        let damped = self.damping > T::ZERO;
        let damping = damped.then_some((&self.damping_gradients[..], self.damping));
        [(&self.gradients[..], T::ONE)].into_iter().chain(damping)
    }

    /// Adds the diagonal blocks to those of the chunk's nodes, which begin with `first`.
    pub fn add_diagonal(&self, first: usize, out: &mut [SymMat3<T>]) {
        for (slopes, by) in self.parts() {
            for (columns, slopes) in self.each(slopes) {
                for (v, s) in columns.iter().zip(slopes) {
                    if let Some(d) = out.get_mut((*v as usize).wrapping_sub(first)) {
                        let [x, y, z, _] = *s;
                        for (d, m) in d.iter_mut().zip([x * x, y * y, z * z, x * y, x * z, y * z]) {
                            *d += by * m;
                        }
                    }
                }
            }
        }
    }

    /// Adds the outer products times p to the chunk's nodes, which begin with `first`.
    pub fn multiply(&self, first: usize, p: &[V4<T>], y: &mut [V4<T>]) {
        for (slopes, by) in self.parts() {
            self.apply_rank_one(slopes, p, |along, v, s| {
                if let Some(y) = y.get_mut((v as usize).wrapping_sub(first)) {
                    *y = T::array(T::lanes(y) + (by * along).splat() * T::lanes(s));
                }
            });
        }
    }

    /// Subtracts the damping matrix times w from the forces on the chunk's nodes, which begin with
    /// `first`. Returns the chunk's share of w times that product.
    pub fn subtract_damping_forces(&self, first: usize, w: &[V4<T>], f: &mut [V4<T>]) -> f64 {
        let mut sum = 0.0;
        self.apply_rank_one(&self.damping_gradients, w, |along, v, s| {
            if let Some(f) = f.get_mut((v as usize).wrapping_sub(first)) {
                let force = along.splat() * T::lanes(s);
                sum += sum_f64(T::array(force * T::lanes(&w[v as usize])));
                *f = T::array(T::lanes(f) - force);
            }
        });
        sum
    }

    #[inline(always)]
    fn apply_rank_one(&self, slopes: &[V4<T>], p: &[V4<T>], mut take: impl FnMut(T, u32, &V4<T>)) {
        for (columns, slopes) in self.each(slopes) {
            let mut lanes = T::ZERO.splat();
            for (v, s) in columns.iter().zip(slopes) {
                lanes = lanes + T::lanes(s) * T::lanes(&p[*v as usize]);
            }
            let [x, y, z, _] = T::array(lanes);
            for (v, s) in columns.iter().zip(slopes) {
                take(x + y + z, *v, s);
            }
        }
    }

    /// Visits the blocks above the diagonal.
    pub fn pairs(&self, visit: &mut dyn FnMut([u32; 2], &DMat3)) {
        for (slopes, by) in self.parts() {
            for (n, (columns, slopes)) in self.each(slopes).enumerate() {
                if self.counted[n] == T::ZERO {
                    continue;
                }
                let wide = |s: &V4<T>| DVec3::new(s[0].to_f64(), s[1].to_f64(), s[2].to_f64());
                for (i, a) in columns.iter().zip(slopes) {
                    let left = wide(a) * by.to_f64();
                    for (j, b) in columns.iter().zip(slopes).filter(|(j, _)| *j > i) {
                        let b = wide(b);
                        visit(
                            [*i, *j],
                            &DMat3::from_cols(left * b.x, left * b.y, left * b.z),
                        );
                    }
                }
            }
        }
    }
}

impl<T: Real> VolumeStrains<T> {
    /// Returns the averaged pressure in the tetrahedra of a batch times their volume, and its rate.
    #[inline(always)]
    pub fn tet_pressures(&self, corners: &TetVolumeLinks<T>, batch: usize) -> [T::Lanes; 2] {
        let share = corners.shares[batch];
        [&self.volume_strain, &self.rate].map(|of| {
            let sums = corners.cells[batch].map(|cells| {
                let [a, b, c, d] = cells.map(|c| of[c as usize]);
                (a + b) + (c + d)
            });
            share * T::lanes(&sums)
        })
    }
}

#[inline(always)]
fn accumulate<T: Real>(to: &mut [T], cells: &[[u32; 4]; 4], of_tets: [T; 4]) {
    for (cells, more) in cells.iter().zip(of_tets) {
        for c in cells {
            to[*c as usize] += more;
        }
    }
}
