//! Verlet integration of a grid of particles with 18 implicit neighbours: the reference of
//! `shaders/physics/grid_verlet.wgsl`, in float64 for accuracy and in float32 for speed
//! comparisons.

use crate::parallel;

macro_rules! grid_reference {
    ($(#[$doc:meta])* $name:ident, $real:ty, $vector:ty) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        pub struct $name {
            /// Position of every grid point, empty ones included.
            pub x: Vec<$vector>,
            /// The positions one step before.
            pub previous: Vec<$vector>,
            /// Springs of each particle: bit 2 k is the forward spring of kind k, bit 2 k + 1 the
            /// backward one; 0 for empty grid points.
            pub springs: Vec<u32>,
            /// Inverse mass; 0 for pinned particles.
            pub inverse_masses: Vec<$real>,
            /// Stiffness of each particle relative to the body's; a spring takes the mean of its
            /// two ends.
            pub factors: Vec<$real>,
            /// External force on each particle.
            pub forces: Vec<$vector>,
            /// Offset from a particle's number to its neighbour's, for each kind of spring.
            pub offsets: [i64; 9],
            /// Rest length of each kind.
            pub lengths: [$real; 9],
            /// κ of each kind: the spring force is κ (l − L).
            pub stiffness: [$real; 9],
            /// Gravity.
            pub gravity: $vector,
            /// Damping rate γ: every particle is subject to the force −γ m v.
            pub damping: $real,
            /// The particles of the body.
            pub particles: Vec<u32>,
        }

        impl $name {
            /// Σ_j κ_ij (1 − L/|d|) d over the springs of particle i, d = x_j − x_i.
            pub fn spring_force(&self, i: usize) -> $vector {
                let (x, springs, mut f) = (self.x[i], self.springs[i], <$vector>::ZERO);
                for kind in 0..9 {
                    for (bit, sign) in [(2 * kind, 1), (2 * kind + 1, -1)] {
                        if springs >> bit & 1 == 0 {
                            continue;
                        }
                        let j = (i as i64 + sign * self.offsets[kind]) as usize;
                        let d = self.x[j] - x;
                        let l = d.length();
                        let over = if l > 0.0 { 1.0 / l } else { 0.0 };
                        let k = 0.5 * (self.factors[i] + self.factors[j]) * self.stiffness[kind];
                        f += k * (1.0 - self.lengths[kind] * over) * d;
                    }
                }
                f
            }

            /// Returns the unnormalised approximate normal Σ_j normalize(x_i − x_j).
            pub fn normal(&self, i: usize) -> $vector {
                let mut sum = <$vector>::ZERO;
                for kind in 0..9 {
                    for (bit, sign) in [(2 * kind, 1), (2 * kind + 1, -1)] {
                        if self.springs[i] >> bit & 1 == 1 {
                            let j = (i as i64 + sign * self.offsets[kind]) as usize;
                            sum += (self.x[i] - self.x[j]).normalize_or_zero();
                        }
                    }
                }
                sum
            }

            /// Advances one Verlet step with centred damping: x' = x + ((1 − γh/2)(x − x₋₁) + h² a)
            /// / (1 + γh/2).
            pub fn step(&mut self, h: $real) {
                self.advance(h, 1.0);
            }

            /// Advances the first step from the velocity v, stored in `previous` as x − h (1 +
            /// γh/2) v. Half of the acceleration acts, which makes the step exact to second order.
            pub fn first_step(&mut self, h: $real) {
                self.advance(h, 0.5);
            }

            fn advance(&mut self, h: $real, share: $real) {
                let gain = 1.0 / (1.0 + 0.5 * self.damping * h);
                let kept = (1.0 - 0.5 * self.damping * h) * gain;
                let next: Vec<$vector> = parallel::map(self.particles.len(), |n| {
                    let i = self.particles[n] as usize;
                    let w = self.inverse_masses[i];
                    if w == 0.0 {
                        return self.x[i];
                    }
                    let a = w * (self.spring_force(i) + self.forces[i]) + self.gravity;
                    self.x[i] + kept * (self.x[i] - self.previous[i]) + share * gain * h * h * a
                });
                for (i, x) in self.particles.iter().zip(next) {
                    self.previous[*i as usize] = self.x[*i as usize];
                    self.x[*i as usize] = x;
                }
            }
        }
    };
}

grid_reference!(
    /// The particles in float64, SI units.
    GridReference,
    f64,
    glam::DVec3
);
grid_reference!(
    /// The same in float32: a plain loop over the particles, the baseline of benchmarks.
    GridReferenceF32,
    f32,
    glam::Vec3
);

impl GridReference {
    /// Converts the particles to float32.
    pub fn to_f32(&self) -> GridReferenceF32 {
        let vectors = |v: &[glam::DVec3]| v.iter().map(|p| p.as_vec3()).collect();
        let reals = |v: &[f64]| v.iter().map(|x| *x as f32).collect();
        GridReferenceF32 {
            x: vectors(&self.x),
            previous: vectors(&self.previous),
            springs: self.springs.clone(),
            inverse_masses: reals(&self.inverse_masses),
            factors: reals(&self.factors),
            forces: vectors(&self.forces),
            offsets: self.offsets,
            lengths: self.lengths.map(|x| x as f32),
            stiffness: self.stiffness.map(|x| x as f32),
            gravity: self.gravity.as_vec3(),
            damping: self.damping as f32,
            particles: self.particles.clone(),
        }
    }

    /// Returns the kinetic energy (of the mean velocity over the last step of length h) and the
    /// energy of the springs.
    pub fn energy(&self, h: f64) -> [f64; 2] {
        let (mut kinetic, mut elastic) = (0.0, 0.0);
        for i in self.particles.iter().map(|i| *i as usize) {
            if self.inverse_masses[i] > 0.0 {
                let v = (self.x[i] - self.previous[i]) / h;
                kinetic += 0.5 * v.length_squared() / self.inverse_masses[i];
            }
            for kind in 0..9 {
                if self.springs[i] >> (2 * kind) & 1 == 1 {
                    let j = (i as i64 + self.offsets[kind]) as usize;
                    let k = 0.5 * (self.factors[i] + self.factors[j]) * self.stiffness[kind];
                    let stretch = self.x[i].distance(self.x[j]) - self.lengths[kind];
                    elastic += 0.5 * k * stretch * stretch;
                }
            }
        }
        [kinetic, elastic]
    }
}
