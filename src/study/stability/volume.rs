//! The force that keeps the volume of every tet, which Tejada & Ertl tried and dropped: what it
//! gives and what it costs, in float64.

use crate::Result;
use crate::mesh::{TetMesh, generate, signed_volume};
use crate::physics::plain::springs::Particles;
use crate::physics::{Material, SpringNetwork};
use crate::study::{Axis, Cell, Chart, Look, Run, Series};
use glam::DVec3;

/// Young's modulus of the springs, Pa.
const YOUNG: f64 = 1e5;

/// How far the bar is drawn out, of its length.
const STRETCH: f64 = 0.1;

const SETTINGS: [&str; 1] = ["bulk_over_young"];
const RESULTS: [&str; 5] = [
    "volume_change_percent",
    "pull_n",
    "largest_step_s",
    "inverted_at_start",
    "inverted_left",
];

/// A body with springs, and in every tet the energy ½ k V₀ (V/V₀ − 1)².
struct Filled {
    particles: Particles,
    tets: Vec<[u32; 4]>,
    volumes: Vec<f64>,
    /// k, Pa.
    bulk: f64,
}

impl Filled {
    fn new(mesh: &TetMesh, bulk: f64, damping_time: f64) -> Result<Filled> {
        let material = Material {
            damping_time,
            ..Material::young(YOUNG)
        };
        let particles = Particles::new(SpringNetwork::new(mesh, &material)?);
        let mut filled = Filled {
            particles,
            tets: mesh.tets.clone(),
            volumes: Vec::new(),
            bulk,
        };
        filled.volumes = filled.volumes_now();
        Ok(filled)
    }

    fn corners(&self, tet: [u32; 4]) -> [DVec3; 4] {
        tet.map(|v| self.particles.x[v as usize])
    }

    fn volumes_now(&self) -> Vec<f64> {
        let tets = self.tets.iter();
        tets.map(|t| signed_volume(self.corners(*t))).collect()
    }

    /// −k (V/V₀ − 1) ∂V/∂x on the corners of every tet, and the springs' forces.
    fn forces(&self) -> Vec<DVec3> {
        let mut forces = self.particles.forces();
        for (tet, rest) in self.tets.iter().zip(&self.volumes) {
            let [a, b, c, d] = self.corners(*tet);
            let gradients = [
                (d - b).cross(c - b) / 6.0,
                (c - a).cross(d - a) / 6.0,
                (d - a).cross(b - a) / 6.0,
                (b - a).cross(c - a) / 6.0,
            ];
            let pressure = -self.bulk * (signed_volume([a, b, c, d]) / rest - 1.0);
            for (v, gradient) in tet.iter().zip(gradients) {
                forces[*v as usize] += pressure * gradient;
            }
        }
        forces
    }

    /// A step of symplectic Euler.
    fn step(&mut self, h: f64) {
        let forces = self.forces();
        let p = &mut self.particles;
        for (i, force) in forces.iter().enumerate() {
            if !p.pinned[i] {
                p.v[i] += h / p.network.masses[i] * *force;
                p.x[i] += h * p.v[i];
            }
        }
    }

    /// The largest step at which a small disturbance stays small for 400 steps: a lower bound of
    /// it, within 1 %.
    fn largest_step(&self, start: f64) -> f64 {
        let stable = |h: f64| {
            let mut body = Filled {
                particles: self.particles.clone(),
                tets: self.tets.clone(),
                volumes: self.volumes.clone(),
                bulk: self.bulk,
            };
            let mut noise = Noise(3);
            for x in &mut body.particles.x {
                *x += 1e-7 * noise.vector();
            }
            for _ in 0..400 {
                body.step(h);
            }
            let rest = &body.particles.network.rest;
            // Not a number is not near.
            let mut moved = body.particles.x.iter().zip(rest);
            moved.all(|(x, r)| x.distance(*r) < 1e-4)
        };
        let mut low = start;
        while !stable(low) {
            low *= 0.5;
        }
        let mut high = low;
        while stable(high) {
            (low, high) = (high, 2.0 * high);
        }
        while high > 1.01 * low {
            let middle = (low * high).sqrt();
            match stable(middle) {
                true => low = middle,
                false => high = middle,
            }
        }
        low
    }

    /// Steps until nothing moves, or 10,000 times.
    fn settle(&mut self, h: f64) {
        for step in 0..10_000 {
            self.step(h);
            let fastest = self.particles.v.iter().map(|v| v.length());
            if step % 50 == 49 && fastest.fold(0.0, f64::max) * h < 1e-9 {
                return;
            }
        }
    }
}

/// A repeatable stream of numbers in −1..1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// What the force of this strength does to a bar drawn out and to a bar scrambled.
fn measure(bulk_over_young: f64) -> Result<Vec<Cell>> {
    let mesh = generate::paper_bar()?;
    let bulk = bulk_over_young * YOUNG;
    let largest = Filled::new(&mesh, bulk, 0.0)?.largest_step(1e-3);
    let (h, damping_time) = (0.3 * largest, 1e-3);
    // Lagging damping asks for a smaller step of its own.
    let h = h.min(0.5 * largest * largest / (4.0 * damping_time));

    let mut drawn = Filled::new(&mesh, bulk, damping_time)?;
    let length = drawn.particles.network.rest.iter().map(|x| x.x);
    let (low, high) = length.fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)));
    for (i, x) in drawn.particles.x.iter_mut().enumerate() {
        let along = (x.x - low) / (high - low);
        x.x += STRETCH * (high - low) * along;
        drawn.particles.pinned[i] = !(1e-6..=1.0 - 1e-6).contains(&along);
    }
    drawn.settle(h);
    let before: f64 = drawn.volumes.iter().sum();
    let after: f64 = drawn.volumes_now().iter().sum();
    let forces = drawn.forces();
    let pull: f64 = (0..forces.len())
        .filter(|i| drawn.particles.x[*i].x > high)
        .map(|i| -forces[i].x)
        .sum();

    let mut scrambled = Filled::new(&mesh, bulk, damping_time)?;
    let mut noise = Noise(11);
    for x in &mut scrambled.particles.x {
        *x += 0.02 * noise.vector();
    }
    let inverted = |body: &Filled| body.volumes_now().iter().filter(|v| **v < 0.0).count();
    let at_start = inverted(&scrambled);
    scrambled.settle(0.5 * h);
    Ok(vec![
        (100.0 * (after / before - 1.0)).into(),
        pull.into(),
        largest.into(),
        at_start.into(),
        inverted(&scrambled).into(),
    ])
}

/// Charts the force over its strength.
pub fn run(run: &Run) -> Result<()> {
    let strengths: &[f64] = match run.quick {
        true => &[0.0, 10.0],
        false => &[0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0],
    };
    let points: Vec<Vec<Cell>> = strengths.iter().map(|s| vec![(*s).into()]).collect();
    let rows = run.measure("stability_volume", &SETTINGS, &RESULTS, &points, |point| {
        measure(point[0].number())
    })?;
    let Some(without) = rows.iter().find(|r| r.number(SETTINGS[0]) == 0.0) else {
        return Ok(());
    };
    let series = |name: &str, of: &dyn Fn(&crate::study::Row) -> f64| {
        let with = rows.iter().filter(|r| r.number(SETTINGS[0]) > 0.0);
        let points = with.map(|r| [r.number(SETTINGS[0]), of(r)]).collect();
        Series::new(name, Look::LineMarks, points)
    };
    let step =
        |r: &crate::study::Row| r.number("largest_step_s") / without.number("largest_step_s");
    Chart {
        title: "A force that keeps volume, over its strength".into(),
        x: Axis::log("its modulus over Young's modulus"),
        y: Axis::linear("of the value without it (%)"),
        series: vec![
            series("change of volume at 10 % stretch", &|r| {
                100.0 * r.number(RESULTS[0]) / without.number(RESULTS[0])
            }),
            series("largest stable step", &|r| 100.0 * step(r)),
            series("pull at 10 % stretch", &|r| {
                100.0 * r.number("pull_n") / without.number("pull_n")
            }),
        ],
    }
    .save(run.dir, "stability-volume")?;
    let lines: String = rows
        .iter()
        .map(|r| {
            format!(
                "| {} | {:.2} | {:.1} | {:.2e} | {} of {} |\n",
                r.number(SETTINGS[0]),
                r.number("volume_change_percent"),
                r.number("pull_n"),
                r.number("largest_step_s"),
                r.number("inverted_left"),
                r.number("inverted_at_start"),
            )
        })
        .collect();
    let strongest = rows.last().unwrap_or(without);
    let over = |name: &str| strongest.number(name) / without.number(name);
    let text = format!(
        "The paper tried a force that keeps the volume of each tet and dropped it. On the paper's bar of {:.0} kPa, in float64, with the energy ½ k V₀ (V/V₀ − 1)² a tet: drawn out by 10 %, and scrambled by up to 20 mm a node and left to settle.\n\n| k over Young's modulus | change of volume (%) | pull (N) | largest step (s) | tets left inside out |\n| --- | --- | --- | --- | --- |\n{lines}\nIt keeps volume: at {} times Young's modulus {:.0} % of the change is left. But the largest step of an explicit scheme falls to {:.0} %, and the bar pulls {:.1} times as hard as the modulus asked for. It is left out.",
        YOUNG / 1e3,
        strongest.number(SETTINGS[0]),
        100.0 * over("volume_change_percent"),
        100.0 * over("largest_step_s"),
        over("pull_n"),
    );
    run.tell(
        "stability_volume",
        "A force that keeps volume",
        &text,
        &["stability-volume"],
    )
}
