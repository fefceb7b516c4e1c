//! Grid bodies on the CPU: Verlet integration of particles with 18 implicit neighbours (Mosegaard,
//! Herborg & Sørensen 2005). The counterparts are `shaders/physics/grid_verlet.wgsl` and the
//! reference `physics::grid::reference`.

use super::forces::{Slab, SoaVec3, SpringKind, SpringRun};
use crate::physics::cpu::node_constraints::{NodeConstraint, check_attachments};
use crate::physics::cpu::partition::Partition;
use crate::physics::cpu::scalar::Real;
use crate::physics::grid::{GridModel, GridShape};
use crate::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Fewest particles per thread for which another thread pays off.
const PARTICLES_A_THREAD: usize = 1500;

/// Largest number of missing particles inside a run.
const MAX_RUN_GAP: usize = 16;

/// Largest number of particles in a run of springs: its forces fit in the L1 cache.
const MAX_RUN: usize = 512;

/// A grid body stepped on the CPU with scalars of type `T`.
///
/// Inputs and outputs use the grid's particle numbering, including missing particles, and SI units,
/// with positions in metres from the origin of the model's frame. Internally, the body stores
/// displacements from rest in units of its size, so that f32 keeps its precision.
#[derive(Clone, Debug)]
pub struct CpuGridBody<T: Real> {
    pub(in crate::physics::cpu) rest: Vec<DVec3>,
    pub(in crate::physics::cpu) length: f64,
    pub(in crate::physics::cpu) mean_mass: f64,
    pub(in crate::physics::cpu) masses: Vec<f64>,
    pub(in crate::physics::cpu) damping: f64,
    pub(in crate::physics::cpu) gravity: DVec3,
    pub(in crate::physics::cpu) kinds: [SpringKind<T>; 9],
    pub(in crate::physics::cpu) stiffness: [f64; 9],
    pub(in crate::physics::cpu) springs: Vec<u32>,
    pub(in crate::physics::cpu) factors: Vec<T>,
    /// Mean mass over mass; 0 for fixed particles.
    pub(in crate::physics::cpu) inverse: Vec<T>,
    pub(in crate::physics::cpu) forces: Option<SoaVec3<T>>,
    pub(in crate::physics::cpu) external: Vec<DVec3>,
    pub(in crate::physics::cpu) pinned: Vec<bool>,
    pub(in crate::physics::cpu) attachments: Vec<NodeConstraint>,
    pub(in crate::physics::cpu) plan: Arc<Partition>,
    pub(in crate::physics::cpu) slabs: Vec<Slab<T>>,
    pub(in crate::physics::cpu) before: SoaVec3<T>,
    pub(in crate::physics::cpu) now: SoaVec3<T>,
    pub(in crate::physics::cpu) next: SoaVec3<T>,
    pub(in crate::physics::cpu) velocities: Vec<DVec3>,
    /// Current target spring forces on particles.
    pub(in crate::physics::cpu) spring_forces: Vec<(usize, DVec3)>,
    /// Length of the last step, s; `None` before the first.
    pub(in crate::physics::cpu) previous_dt: Option<f64>,
    pub(in crate::physics::cpu) steps: u64,
}

/// Pushes the parts of a run of particles whose springs of a kind, with the index offset `offset`,
/// begin or end in the slab of the particles `mine`.
fn within(
    run: &Range<usize>,
    kind: usize,
    offset: isize,
    mine: &Range<usize>,
    out: &mut Vec<SpringRun>,
) {
    let mut ends = [mine.start, mine.end, run.end, run.end].map(|e| e as isize);
    ends[2] = mine.start as isize - offset;
    ends[3] = mine.end as isize - offset;
    ends.sort_unstable();
    let mut from = run.start;
    for end in ends.into_iter().chain([run.end as isize]) {
        let end = end.clamp(from as isize, run.end as isize) as usize;
        let own = [from, from.wrapping_add_signed(offset)].map(|i| mine.contains(&i));
        if end > from && own != [false, false] {
            for first in (from..end).step_by(MAX_RUN) {
                out.push(SpringRun {
                    first,
                    count: MAX_RUN.min(end - first),
                    kind,
                    owned: own,
                });
            }
        }
        from = end;
    }
}

/// State from [`CpuGridBody::state`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticlesState<T> {
    /// Current displacements, and those of the previous step.
    pub u: [SoaVec3<T>; 2],
    /// Initial velocities, m/s; used before the first step only.
    pub velocities: Vec<[f64; 3]>,
    /// Length of the last step, s.
    pub lag: Option<f64>,
    /// Number of steps taken.
    pub steps: u64,
}

impl<T: Real> CpuGridBody<T> {
    /// Creates the body of `model` at rest, without pins or gravity.
    pub fn new(model: &GridModel) -> CpuGridBody<T> {
        let bodies = model.masses.iter().filter(|m| **m > 0.0).count();
        let threads = rayon::current_num_threads();
        CpuGridBody::with_slabs(model, threads.min(bodies / PARTICLES_A_THREAD))
    }

    /// As [`CpuGridBody::new`], with the rows partitioned into `slabs` slabs, or fewer.
    pub fn with_slabs(model: &GridModel, slabs: usize) -> CpuGridBody<T> {
        let rest = model.rest_positions_m();
        let count = rest.len();
        let length = model.frame.scale * model.length_unit;
        let bodies = model.masses.iter().filter(|m| **m > 0.0);
        let (sum, bodies) = bodies.fold((0.0, 0.0), |(s, n), m| (s + m, n + 1.0));
        let mean_mass = if bodies > 0.0 { sum / bodies } else { 1.0 };
        let shape = &model.shape;
        let (offsets, lengths) = (shape.offsets(), shape.rest_lengths());
        let kinds = std::array::from_fn(|k| {
            let step = DVec3::from(GridShape::SPRING_OFFSETS[k].map(|n| n as f64));
            let step = shape.axes * (shape.spacing * step) * model.length_unit / length;
            SpringKind {
                offset: offsets[k] as isize,
                rest: step.to_array().map(T::from_f64),
                length: T::from_f64(lengths[k] * model.length_unit / length),
                stiffness: T::ONE,
            }
        });
        let zeros = || std::array::from_fn(|_| vec![T::ZERO; count]);
        let mut body = CpuGridBody {
            rest,
            length,
            mean_mass,
            masses: model.masses.clone(),
            damping: model.damping,
            gravity: DVec3::ZERO,
            kinds,
            stiffness: model.stiffness,
            springs: model.springs.clone(),
            factors: model
                .stiffness_scales
                .iter()
                .map(|f| T::from_f64(*f))
                .collect(),
            inverse: vec![T::ZERO; count],
            forces: None,
            external: vec![DVec3::ZERO; count],
            pinned: vec![false; count],
            attachments: Vec::new(),
            plan: Arc::new(Partition::with_chunks(vec![0, count], 1)),
            spring_forces: Vec::new(),
            slabs: Vec::new(),
            before: zeros(),
            now: zeros(),
            next: zeros(),
            velocities: vec![DVec3::ZERO; count],
            previous_dt: None,
            steps: 0,
        };
        body.assign_slabs(model.shape.size[0], slabs);
        body.free_particles();
        body
    }

    /// Partitions the rows, of `row` particles each, into slabs.
    fn assign_slabs(&mut self, row: usize, slabs: usize) {
        let count = self.rest.len();
        let has = |i: &usize| self.masses[*i] > 0.0;
        let total = (0..count).filter(has).count();
        let (mut starts, mut done) = (vec![0], 0);
        for y in 1..count / row.max(1) {
            done += ((y - 1) * row..y * row).filter(has).count();
            if starts.len() < slabs && done * slabs >= starts.len() * total {
                starts.push(y * row);
            }
        }
        starts.push(count);
        let chunks = starts.len() - 1;
        self.plan = Arc::new(Partition::with_chunks(starts, chunks));
        // Runs of consecutive particles that may include small gaps: computing missing springs
        // costs less than starting another run.
        let mut runs: Vec<Range<usize>> = Vec::new();
        let mut slab = 0;
        for i in (0..count).filter(has) {
            let here = self.plan.chunk_of(i);
            match runs.last_mut() {
                Some(run) if i - run.end <= MAX_RUN_GAP && here == slab => run.end = i + 1,
                _ => runs.push(i..i + 1),
            }
            slab = here;
        }
        let slabs = (0..chunks).map(|c| {
            let mine = self.plan.range(c);
            let mut list = Vec::new();
            for (kind, k) in self.kinds.iter().enumerate() {
                for run in &runs {
                    within(run, kind, k.offset, &mine, &mut list);
                }
            }
            list.sort_by_key(|r: &SpringRun| (r.first, r.kind));
            let longest = list.iter().map(|r| r.count).max().unwrap_or(0);
            let particles = runs.iter().filter(|r| mine.contains(&r.start));
            Slab::new(list, particles.cloned().collect(), mine.len(), longest)
        });
        self.slabs = slabs.collect();
    }

    fn free_particles(&mut self) {
        for (i, inverse) in self.inverse.iter_mut().enumerate() {
            let free = self.masses[i] > 0.0 && !self.pinned[i];
            *inverse = T::from_f64(if free {
                self.mean_mass / self.masses[i]
            } else {
                0.0
            });
        }
        for a in &self.attachments {
            if let NodeConstraint::Fixed { node, .. } = a {
                self.inverse[*node as usize] = T::ZERO;
            }
        }
    }

    /// Returns the number of slabs.
    pub fn parts(&self) -> usize {
        self.slabs.len()
    }

    /// Returns the number of steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Sets the pinned particles.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of flags.
    pub fn set_pinned(&mut self, pinned: &[bool]) -> Result<()> {
        self.check("pins", pinned.len())?;
        self.pinned.copy_from_slice(pinned);
        self.free_particles();
        Ok(())
    }

    /// Sets gravity, m/s².
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.gravity = gravity;
    }

    /// Sets the external force on every particle, N.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of forces or one that is not finite.
    pub fn set_forces(&mut self, forces: &[DVec3]) -> Result<()> {
        self.check_vectors("forces", forces)?;
        self.external.copy_from_slice(forces);
        let some = forces.iter().any(|f| *f != DVec3::ZERO);
        let axis = |a: usize| {
            forces
                .iter()
                .map(|f| T::from_f64(f[a] / self.length))
                .collect()
        };
        self.forces = some.then(|| std::array::from_fn(axis));
        Ok(())
    }

    /// Replaces the springs of every particle by those left after a cut.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of them, or springs that did not exist before.
    pub fn set_springs(&mut self, springs: &[u32]) -> Result<()> {
        self.check("springs", springs.len())?;
        let new =
            |i: usize| springs[i] & 0x1_5555 != 0 && self.masses[i] == 0.0 || springs[i] >> 18 != 0;
        if let Some(i) = (0..springs.len()).find(|i| new(*i)) {
            return Err(Error::Input(format!(
                "invalid springs of particle {i}: {:#x}",
                springs[i]
            )));
        }
        self.springs.copy_from_slice(springs);
        Ok(())
    }

    /// Replaces the constraints and target springs of particles.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid attachments.
    pub fn set_node_constraints(&mut self, attachments: &[NodeConstraint]) -> Result<()> {
        check_attachments(attachments, self.rest.len())?;
        self.attachments = attachments.to_vec();
        self.free_particles();
        for a in attachments {
            if let NodeConstraint::Fixed { node, place } = a {
                let i = *node as usize;
                let u = (*place - self.rest[i]) / self.length;
                for axis in 0..3 {
                    self.now[axis][i] = T::from_f64(u[axis]);
                    self.before[axis][i] = T::from_f64(u[axis]);
                }
            }
        }
        Ok(())
    }

    pub(in crate::physics::cpu) fn displacement(&self, axes: &SoaVec3<T>, i: usize) -> DVec3 {
        DVec3::new(
            axes[0][i].to_f64(),
            axes[1][i].to_f64(),
            axes[2][i].to_f64(),
        ) * self.length
    }

    /// Returns the positions, m from the frame's origin.
    pub fn positions(&self) -> Vec<DVec3> {
        let particles = self.rest.iter().enumerate();
        particles
            .map(|(i, x)| *x + self.displacement(&self.now, i))
            .collect()
    }

    /// Returns the velocities, m/s: the mean over the last step, or the initial ones before the
    /// first.
    pub fn velocities(&self) -> Vec<DVec3> {
        match self.previous_dt {
            None => self.velocities.clone(),
            Some(h) => (0..self.rest.len())
                .map(|i| {
                    let [now, before] = [&self.now, &self.before];
                    (self.displacement(now, i) - self.displacement(before, i)) / h
                })
                .collect(),
        }
    }

    /// Returns the kinetic energy, Σ ½mv² of the mean velocity over the last step, J; 0 before the
    /// first.
    pub fn kinetic_energy(&self) -> f64 {
        let Some(h) = self.previous_dt else {
            return 0.0;
        };
        let unit = self.length / h;
        let mut sum = 0.0;
        for (i, m) in self.masses.iter().enumerate().filter(|(_, m)| **m > 0.0) {
            let moved = |a: usize| (self.now[a][i] - self.before[a][i]).to_f64();
            let square: f64 = (0..3).map(|a| moved(a) * moved(a)).sum();
            sum += 0.5 * m * square;
        }
        sum * unit * unit
    }

    /// Sets particle positions (m from the frame's origin) and velocities (m/s); the integrator
    /// restarts.
    ///
    /// # Errors
    /// [`Error::Input`] for a wrong number of vectors or one that is not finite.
    pub fn set_state(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<()> {
        self.check_vectors("positions", positions)?;
        self.check_vectors("velocities", velocities)?;
        for (i, x) in positions.iter().enumerate() {
            let u = (*x - self.rest[i]) / self.length;
            for axis in 0..3 {
                self.now[axis][i] = T::from_f64(u[axis]);
            }
        }
        self.velocities.copy_from_slice(velocities);
        self.previous_dt = None;
        Ok(())
    }

    /// Returns the bitwise exact state.
    pub fn state(&self) -> ParticlesState<T> {
        ParticlesState {
            u: [self.now.clone(), self.before.clone()],
            velocities: self.velocities.iter().map(|v| v.to_array()).collect(),
            lag: self.previous_dt,
            steps: self.steps,
        }
    }

    /// Restores a state from [`CpuGridBody::state`] of this body or of one made in the same way.
    ///
    /// # Errors
    /// [`Error::Input`] for the state of another body.
    pub fn resume(&mut self, state: &ParticlesState<T>) -> Result<()> {
        for axes in &state.u {
            for a in axes {
                self.check("displacements", a.len())?;
            }
        }
        self.check("velocities", state.velocities.len())?;
        self.now.clone_from(&state.u[0]);
        self.before.clone_from(&state.u[1]);
        self.velocities = state.velocities.iter().map(|v| DVec3::from(*v)).collect();
        self.previous_dt = state.lag;
        self.steps = state.steps;
        Ok(())
    }

    fn check(&self, what: &str, given: usize) -> Result<()> {
        match given == self.rest.len() {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "got {given} {what} for a grid of {} particles",
                self.rest.len()
            ))),
        }
    }

    fn check_vectors(&self, what: &str, given: &[DVec3]) -> Result<()> {
        self.check(what, given.len())?;
        match given.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(i) => Err(Error::Input(format!(
                "the {what} of particle {i} are not finite"
            ))),
        }
    }
}
