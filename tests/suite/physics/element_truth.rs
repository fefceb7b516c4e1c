//! A body of finite elements in float64: forces, and reference steps for those of the GPU.

use glam::{DMat3, DVec3};
use palpate::physics::reference::linear::conjugate_gradients;
use palpate::physics::{ConstitutiveModel, DiscreteModel, Elements, GpuBody};

/// A body and its state in float64, SI units.
pub struct Truth {
    pub model: DiscreteModel,
    pub x: Vec<DVec3>,
    pub v: Vec<DVec3>,
    pub gravity: DVec3,
    pub pinned: Vec<bool>,
}

pub type Blocks = Vec<([u32; 4], [[DMat3; 4]; 4])>;

impl Truth {
    pub fn of(body: &GpuBody) -> Truth {
        let model = body.model().clone();
        let unit = model.length_unit;
        let (x, v) = (body.positions().unwrap(), body.velocities().unwrap());
        Truth {
            x: x.iter().map(|x| model.to_metres(*x)).collect(),
            v: v.iter().map(|v| *v * unit).collect(),
            gravity: body.gravity(),
            pinned: body.pinned().to_vec(),
            model,
        }
    }

    fn elements(&self) -> &Elements {
        self.model.elements().unwrap()
    }

    pub fn law(&self) -> ConstitutiveModel {
        self.elements().law
    }

    pub fn energy(&self, x: &[DVec3]) -> f64 {
        let tets = self.model.tets().iter();
        tets.map(|e| e.energy(self.law(), &e.nodes.map(|v| x[v as usize])))
            .sum()
    }

    pub fn blocks(&self, x: &[DVec3]) -> Blocks {
        let tets = self.model.tets().iter();
        tets.map(|e| {
            let corners = e.nodes.map(|v| x[v as usize]);
            (e.nodes, e.projected_stiffness(self.law(), &corners))
        })
        .collect()
    }

    /// Returns the elastic forces, the weight, and the damping forces for the velocities `v`.
    pub fn forces(&self, x: &[DVec3], v: &[DVec3]) -> Vec<DVec3> {
        let masses = self.model.masses.iter();
        let drag = self.elements().mass_damping;
        let mut f: Vec<DVec3> = masses
            .zip(v)
            .map(|(m, v)| *m * (self.gravity - drag * *v))
            .collect();
        for e in self.model.tets() {
            let shares = e.forces(self.law(), &e.nodes.map(|v| x[v as usize]));
            for (v, share) in e.nodes.iter().zip(shares) {
                f[*v as usize] += share;
            }
        }
        let time = self.model.damping_time;
        if time > 0.0 {
            let kv = product(&self.blocks(x), v);
            f.iter_mut().zip(kv).for_each(|(f, kv)| *f -= time * kv);
        }
        f
    }

    pub fn accelerations(&self, x: &[DVec3], v: &[DVec3]) -> Vec<DVec3> {
        let f = self.forces(x, v);
        let each = f.iter().zip(&self.model.masses).zip(&self.pinned);
        each.map(|((f, m), held)| if *held { DVec3::ZERO } else { *f / *m })
            .collect()
    }

    pub fn symplectic(&mut self, h: f64) {
        let a = self.accelerations(&self.x, &self.v);
        self.v.iter_mut().zip(a).for_each(|(v, a)| *v += h * a);
        self.advance(self.v.clone(), h);
    }

    /// Returns the change of the velocities `w` by one Newton iteration, from the positions they
    /// predict.
    pub fn newton(&self, w: &[DVec3], h: f64) -> Vec<DVec3> {
        let x: Vec<DVec3> = self.x.iter().zip(w).map(|(x, w)| *x + h * *w).collect();
        let f = self.forces(&x, w);
        let blocks = self.blocks(&x);
        let masses = &self.model.masses;
        let scale = h * (h + self.model.damping_time);
        let drag = 1.0 + h * self.elements().mass_damping;
        let free = |v: Vec<DVec3>| -> Vec<DVec3> {
            let each = v.into_iter().zip(&self.pinned);
            each.map(|(v, held)| if *held { DVec3::ZERO } else { v })
                .collect()
        };
        let r = (0..w.len()).map(|i| masses[i] * (self.v[i] - w[i]) + h * f[i]);
        let system = |p: &[DVec3]| {
            let kp = product(&blocks, p);
            free(
                (0..p.len())
                    .map(|i| drag * masses[i] * p[i] + scale * kp[i])
                    .collect(),
            )
        };
        let mut diagonal: Vec<DMat3> = masses.iter().map(|m| DMat3::IDENTITY * drag * *m).collect();
        for (nodes, block) in &blocks {
            for (a, v) in nodes.iter().enumerate() {
                diagonal[*v as usize] += scale * block[a][a];
            }
        }
        let r = free(r.collect());
        conjugate_gradients(system, &diagonal, &self.pinned, r, 1e-11, 4000).x
    }

    pub fn advance(&mut self, w: Vec<DVec3>, h: f64) {
        self.x.iter_mut().zip(&w).for_each(|(x, w)| *x += h * *w);
        self.v = w;
    }

    /// Makes one step of the GPU scheme; `before` are the velocities before the last step. Returns
    /// the selected initial guess.
    pub fn step(&mut self, before: &[DVec3], h: f64) -> usize {
        let nodes = 0..self.x.len();
        let held = |i: usize, w: DVec3| if self.pinned[i] { DVec3::ZERO } else { w };
        let starts: [Vec<DVec3>; 3] = [
            nodes.clone().map(|_| DVec3::ZERO).collect(),
            nodes.clone().map(|i| held(i, self.v[i])).collect(),
            nodes
                .map(|i| held(i, 2.0 * self.v[i] - before[i]))
                .collect(),
        ];
        let potentials = starts.each_ref().map(|w| self.potential(w, h));
        let best = (0..3).min_by(|a, b| potentials[*a].total_cmp(&potentials[*b]));
        let best = best.unwrap();
        let mut w = starts[best].clone();
        let u = self.newton(&w, h);
        w.iter_mut().zip(u).for_each(|(w, u)| *w += u);
        self.advance(w, h);
        best
    }

    pub fn potential(&self, w: &[DVec3], h: f64) -> f64 {
        let x: Vec<DVec3> = self.x.iter().zip(w).map(|(x, w)| *x + h * *w).collect();
        let drag = h * self.elements().mass_damping;
        let inertia: f64 = (0..w.len())
            .filter(|i| !self.pinned[*i])
            .map(|i| {
                let still = (w[i] - self.v[i]).length_squared() + drag * w[i].length_squared();
                self.model.masses[i] * (0.5 * still - h * self.gravity.dot(w[i]))
            })
            .sum();
        inertia + self.energy(&x)
    }

    /// Makes a step to the minimum of the incremental potential.
    pub fn converged_step(&mut self, h: f64) {
        let held = |(v, held): (&DVec3, &bool)| if *held { DVec3::ZERO } else { *v };
        let mut w: Vec<DVec3> = self.v.iter().zip(&self.pinned).map(held).collect();
        for _ in 0..40 {
            let u = self.newton(&w, h);
            let size = |u: &[DVec3]| u.iter().map(|u| u.length()).fold(0.0, f64::max);
            w.iter_mut().zip(&u).for_each(|(w, u)| *w += *u);
            if size(&u) <= 1e-9 * size(&w) {
                break;
            }
        }
        self.advance(w, h);
    }
}

pub fn product(blocks: &Blocks, p: &[DVec3]) -> Vec<DVec3> {
    let mut out = vec![DVec3::ZERO; p.len()];
    for (nodes, block) in blocks {
        for (a, i) in nodes.iter().enumerate() {
            for (b, j) in nodes.iter().enumerate() {
                out[*i as usize] += block[a][b] * p[*j as usize];
            }
        }
    }
    out
}

/// Returns the largest distance, relative to the largest length in `b`.
pub fn relative(a: &[DVec3], b: &[DVec3]) -> f64 {
    let most = |a: f64, b: f64| if b.is_nan() { f64::NAN } else { a.max(b) };
    let apart = a.iter().zip(b).map(|(a, b)| a.distance(*b));
    apart.fold(0.0, most) / b.iter().map(|b| b.length()).fold(0.0, most)
}
