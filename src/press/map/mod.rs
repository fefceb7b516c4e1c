//! Stiffness map: presses a body from above at the points of a grid, to find stiff inclusions.

mod finger;
mod grid;
mod picture;

use super::DEPTH;
use super::setup::PressSetup;
use super::site::{Boundary, PressSite};
use super::support_table::Table;
use crate::accuracy::{ErrorParts, first_mesh};
use crate::gpu::Gpu;
use crate::mesh::Topology;
use crate::number_format::significant;
use crate::progress::ProgressScope;
use crate::scene::{AccuracyEntry, Scene, scene_hash};
use crate::{Error, ProgressFn, Result, no_progress};
use finger::Bench;
#[cfg(feature = "identify")]
pub(crate) use finger::step_depths;
use flate2::Crc;
use glam::DVec3;
use grid::MapGrid;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};

/// Number of the next point after an error: there is none.
const ENDED: usize = usize::MAX / 2;
/// Maximum number of points along a side.
const MOST: u32 = 1_000;
/// A point is skipped if the body is thinner there than this multiple of the press depth.
const MIN_THICKNESS_RATIO: f64 = 3.0;

/// Points and settings of a map; unset values are chosen from the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapOptions {
    /// Number of points along the two sides of the map, seen from above.
    pub points: [u32; 2],
    /// Centre of the map, in file units; only with a side. By default the centre of the body.
    pub at: Option<DVec3>,
    /// Length of the sides of the map, a square, in file units; by default it covers the body.
    pub side: Option<f64>,
    /// Radius of the fingertip, in file units.
    pub radius: Option<f64>,
    /// Press depth, in file units; by default a tenth of the body's median thickness.
    pub depth: Option<f64>,
}

/// A point of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPoint {
    /// On the boundary, in file units.
    pub point: DVec3,
    /// Its result; `None` until it is measured.
    pub pressed: Option<PointResult>,
}

/// Result of a press of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointResult {
    /// Slope of force over depth in the deeper half of the loading path.
    Stiffness {
        /// The slope, N/m.
        n_per_m: f64,
        /// Its error, N/m, if the mesh was refined for it.
        error: Option<f64>,
    },
    /// A simulation step failed, or the force is not that of an elastic body in contact with the
    /// fingertip.
    Failed,
}

impl MapOptions {
    /// Checks the numbers.
    fn check(&self) -> Result<()> {
        let [n, m] = self.points;
        if !([n, m].into_iter().all(|n| (1..=MOST).contains(&n))) {
            return Err(Error::Input(format!(
                "map size must be 1 to {MOST} points per side, got {n}x{m}"
            )));
        }
        let lengths = [
            ("press radius", self.radius),
            ("press depth", self.depth),
            ("side of the map", self.side),
        ];
        for (what, given) in lengths {
            if let Some(x) = given.filter(|x| !(x.is_finite() && *x > 0.0)) {
                return Err(Error::Input(format!(
                    "{what} must be positive and finite, got {x}"
                )));
            }
        }
        match self.at {
            Some(_) if self.side.is_none() => Err(Error::Input(
                "a map with a centre (--at) needs the length of its sides (--side)".into(),
            )),
            Some(at) if !at.is_finite() => Err(Error::Input(format!(
                "centre of the map must be finite, got {at}"
            ))),
            _ => Ok(()),
        }
    }
}

impl MapPoint {
    /// Returns the measured stiffness, N/m.
    pub fn stiffness(&self) -> Option<f64> {
        match self.pressed {
            Some(PointResult::Stiffness { n_per_m, .. }) => Some(n_per_m),
            _ => None,
        }
    }
}

/// A map of a body's stiffness.
pub struct PressMap {
    /// Shared with the threads that press.
    bench: Arc<Bench>,
    /// Direction away from the table.
    up: DVec3,
    /// Metres per file unit.
    unit: f64,
    /// Grid of the map.
    grid: MapGrid,
    sites: Vec<PressSite>,
    points: Vec<MapPoint>,
    /// Grid cell of each point.
    cells: Vec<usize>,
    notes: Vec<String>,
    /// Numbers of points, with the errors of their stiffnesses.
    errors: Vec<(usize, ErrorParts)>,
    /// How exact the force at each point has to be.
    accuracy: AccuracyEntry,
}

/// Sites of a map, with the depth.
struct Sites {
    /// Grid cells and sites.
    fit: Vec<(usize, PressSite)>,
    depth: f64,
    notes: Vec<String>,
}

impl Sites {
    /// Selects the sites of `grid` that can be pressed from above `table` with a fingertip of
    /// `radius`.
    fn new(
        boundary: &Boundary,
        grid: &MapGrid,
        (table, radius): (&Table, f64),
        wanted: &MapOptions,
    ) -> Result<Sites> {
        let above = |cell: usize| boundary.first_from_above(table.up(), grid.middle(cell), radius);
        let found: Vec<(usize, PressSite)> = (0..grid.len())
            .filter_map(|cell| Some((cell, above(cell)?)))
            .collect();
        let typical = median(found.iter().map(|(_, spot)| spot.thickness).collect());
        let Some(typical) = typical else {
            return Err(Error::Input(
                "no grid point is above a part of the body with a slope below 60°; increase the number of points (--map NxM), or move the map (--at)".into(),
            ));
        };
        let depth = wanted.depth.unwrap_or(DEPTH * typical);
        let fits = |spot: &PressSite| {
            !table.reaches(spot.point) && spot.thickness >= MIN_THICKNESS_RATIO * depth
        };
        let (fit, thin): (Vec<_>, Vec<_>) = found.into_iter().partition(|(_, spot)| fits(spot));
        if fit.is_empty() {
            return Err(Error::Input(format!(
                "body thickness at every press point must be at least {MIN_THICKNESS_RATIO} times the press depth {depth}; reduce --depth"
            )));
        }
        let (fit, coarse): (Vec<_>, Vec<_>) = fit
            .into_iter()
            .partition(|(_, spot)| radius >= boundary.edge_near(spot.point, radius));
        if fit.is_empty() {
            return Err(Error::Input(format!(
                "the fingertip of radius {} is smaller than the faces beneath it at every press point; use a larger --radius, or a finer mesh (--tets)",
                significant(radius)
            )));
        }
        let mut notes = vec![format!(
            "pressing {} points from above to depth {} with a fingertip of radius {}",
            fit.len(),
            significant(depth),
            significant(radius)
        )];
        notes.extend(table.note());
        let left = grid.len() - fit.len();
        if left > 0 {
            notes.push(format!(
                "{left} grid points are skipped: beside the body, slope above 60°, or thickness below {MIN_THICKNESS_RATIO} times the press depth ({} of them), or faces larger than the fingertip ({})",
                thin.len(),
                coarse.len()
            ));
        }
        Ok(Sites { fit, depth, notes })
    }
}

impl PressMap {
    /// Places the body of `scene` on a table, as [`Press::new`](super::Press::new), and selects the
    /// points to press.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene of several bodies, a grid or a cage, invalid numbers, or a body
    /// without a suitable point; otherwise as loading the mesh.
    pub fn new(scene: &Scene, wanted: &MapOptions) -> Result<PressMap> {
        wanted.check()?;
        let accuracy = scene.accuracy.clone();
        let (scene, mesh, may_raise) = match accuracy.within {
            Some(_) => first_mesh(scene)?,
            None => (
                scene.clone(),
                scene.load_simulated_mesh(&no_progress)?,
                false,
            ),
        };
        let setup = PressSetup::on_table(&scene, &mesh, wanted.radius)?;
        if let Some(pieces) = setup.pieces_warning(&mesh) {
            return Err(Error::Input(pieces));
        }
        let table = setup.table.as_ref().ok_or_else(|| {
            Error::Input("a map needs a body on a table, which this scene does not allow".into())
        })?;
        let grid = MapGrid::new(&mesh, table.up(), wanted);
        let boundary = Boundary::new(&mesh, &Topology::new(&mesh), &mesh.nodes);
        let found = Sites::new(&boundary, &grid, (table, setup.radius), wanted)?;
        let notes = found.notes.into_iter().chain(setup.order_note()).collect();
        let point = |(_, site): &(usize, PressSite)| MapPoint {
            point: site.point,
            pressed: None,
        };
        Ok(PressMap {
            up: table.up(),
            unit: scene.length_unit(&mesh)?.unwrap_or(1.0),
            points: found.fit.iter().map(point).collect(),
            cells: found.fit.iter().map(|(cell, _)| *cell).collect(),
            sites: found.fit.iter().map(|(_, site)| *site).collect(),
            bench: Arc::new(Bench {
                setup,
                mesh,
                depth: found.depth,
                may_raise,
            }),
            grid,
            notes,
            errors: Vec::new(),
            accuracy,
        })
    }

    /// Returns the assumptions, as text.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the points, in rows of the grid, with the results so far.
    pub fn points(&self) -> &[MapPoint] {
        &self.points
    }

    /// Returns the radius of the fingertip and the press depth, in file units.
    pub fn radius_and_depth(&self) -> [f64; 2] {
        [self.bench.setup.radius, self.bench.depth]
    }

    /// Returns the unit vector along which the fingertip advances.
    pub fn direction(&self) -> DVec3 {
        -self.up
    }

    /// Returns metres per file unit.
    pub fn length_unit(&self) -> f64 {
        self.unit
    }

    /// Returns a hash of the body, scene, grid and press settings: results with another fingerprint
    /// do not belong to this map.
    pub fn fingerprint(&self) -> u64 {
        let mut crc = Crc::new();
        let MapGrid {
            axes,
            count,
            low,
            step,
        } = self.grid;
        // The text is part of the format: a partial map can be resumed only with the same
        // fingerprint.
        let mut settings = format!(
            "Grid {{ axes: {axes:?}, count: {count:?}, low: {low:?}, step: {step:?} }} {} {}",
            self.bench.setup.radius, self.bench.depth
        );
        let AccuracyEntry {
            within, max_tets, ..
        } = self.accuracy;
        if within.is_some() {
            settings += &format!(" {within:?} {max_tets:?}");
        }
        crc.update(settings.as_bytes());
        for p in &self.bench.mesh.nodes {
            p.to_array()
                .iter()
                .for_each(|x| crc.update(&x.to_le_bytes()));
        }
        (u64::from(scene_hash(&self.bench.setup.scene)) << 32) | u64::from(crc.sum())
    }

    /// Returns the number of measured points whose stiffness is not as exact as [`Scene::accuracy`] asks
    /// for.
    pub fn missed(&self) -> usize {
        let Some(within) = self.accuracy.within else {
            return 0;
        };
        let is_missed = |point: &&MapPoint| match point.pressed {
            Some(PointResult::Stiffness { n_per_m, error }) => {
                error.is_none_or(|error| error > within * n_per_m.abs())
            }
            _ => false,
        };
        self.points.iter().filter(is_missed).count()
    }

    /// Restores earlier results, in the order of the points.
    ///
    /// # Errors
    /// [`Error::Input`] for a different number of points.
    pub fn restore(&mut self, found: &[Option<PointResult>]) -> Result<()> {
        if found.len() != self.points.len() {
            return Err(Error::Input(format!(
                "number of results must equal the number of map points, got {} for {}",
                found.len(),
                self.points.len()
            )));
        }
        for (point, found) in self.points.iter_mut().zip(found) {
            point.pressed = *found;
        }
        self.errors.clear();
        Ok(())
    }

    /// Measures the remaining points on all cores and calls `each` with the map after every point;
    /// after an error of `each` or of creating a simulator, starts no further point.
    ///
    /// # Errors
    /// As `each` and as creating a simulator. A press with a failed step is
    /// [`PointResult::Failed`].
    pub fn measure(
        &mut self,
        gpu: &Gpu,
        each: &mut dyn FnMut(&PressMap) -> Result<()>,
    ) -> Result<()> {
        let left: Vec<usize> = (0..self.points.len())
            .filter(|k| self.points[*k].pressed.is_none())
            .collect();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let next = AtomicUsize::new(0);
        let (sender, receiver) = mpsc::channel::<Result<(usize, PointResult)>>();
        let (bench, sites) = (self.bench.clone(), self.sites.clone());
        let accuracy = &self.accuracy.clone();
        let goes_on = |_: &str, _: f64| match next.load(Ordering::Relaxed) < ENDED {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        };
        std::thread::scope(|scope| {
            for _ in 0..threads.min(left.len()) {
                let (sender, left, next, sites) = (sender.clone(), &left, &next, &sites);
                let (bench, goes_on) = (&bench, &goes_on);
                scope.spawn(move || {
                    let mut made = bench.finger(gpu);
                    while let Some(k) = left.get(next.fetch_add(1, Ordering::Relaxed)) {
                        let found = match &mut made {
                            Ok(finger) if accuracy.within.is_some() => {
                                finger.press_refined(gpu, (sites[*k], accuracy), goes_on)
                            }
                            Ok(finger) => finger.press(sites[*k]),
                            Err(why) => Err(Error::Input(why.to_string())),
                        };
                        // The receiver is dropped after an error.
                        if sender.send(found.map(|found| (*k, found))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(sender);
            let mut receiver = receiver;
            let mut ended = Ok(());
            while let Ok(found) = receiver.recv() {
                let kept = found.and_then(|(k, found)| {
                    self.points[k].pressed = Some(found);
                    each(self)
                });
                if kept.is_err() {
                    ended = kept;
                    next.store(ENDED, Ordering::Relaxed);
                    receiver = mpsc::channel().1;
                }
            }
            ended
        })
    }

    /// Estimates the errors of the median and of the largest stiffness: presses again where they were
    /// measured, and in the finer space; errors on refined meshes are known already. A body whose errors
    /// cannot be estimated has none.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and errors of the device.
    pub fn estimate_errors(&mut self, gpu: &Gpu, progress: ProgressFn) -> Result<()> {
        if self.accuracy.within.is_some() {
            return Ok(());
        }
        let report =
            |share: f64| ProgressScope::begin(progress, "estimating errors", share).map(drop);
        report(0.0)?;
        let mut chosen: Vec<usize> = [self.median_point(), self.stiffest_point()]
            .into_iter()
            .flatten()
            .collect();
        chosen.dedup();
        let bench = Arc::clone(&self.bench);
        let mut finger = bench.finger(gpu)?;
        let mut errors = Vec::new();
        for (done, k) in chosen.iter().enumerate() {
            let error = finger.stiffness_error(gpu, self.sites[*k])?;
            errors.extend(error.map(|error| (*k, error)));
            report((done + 1) as f64 / chosen.len() as f64)?;
        }
        self.errors = errors;
        Ok(())
    }

    /// Returns the median of the measured stiffnesses, N/m.
    pub fn median(&self) -> Option<f64> {
        self.points[self.median_point()?].stiffness()
    }

    /// Returns the error of the median stiffness, N/m, if [`PressMap::estimate_errors`] found it.
    pub fn median_error(&self) -> Option<ErrorParts> {
        self.error_at(self.median_point()?)
    }

    /// Returns the stiffest point.
    pub fn stiffest(&self) -> Option<MapPoint> {
        Some(self.points[self.stiffest_point()?])
    }

    /// Returns the error of the largest stiffness, N/m, if [`PressMap::estimate_errors`] found it.
    pub fn stiffest_error(&self) -> Option<ErrorParts> {
        self.error_at(self.stiffest_point()?)
    }

    fn error_at(&self, point: usize) -> Option<ErrorParts> {
        if let Some(PointResult::Stiffness {
            error: Some(mesh), ..
        }) = self.points[point].pressed
        {
            return Some(ErrorParts {
                mesh,
                ..ErrorParts::default()
            });
        }
        let mut errors = self.errors.iter();
        errors.find(|(k, _)| *k == point).map(|(_, error)| *error)
    }

    /// Returns the numbers of the measured points, from the softest to the stiffest.
    fn by_stiffness(&self) -> Vec<usize> {
        let stiffness = |k: &usize| self.points[*k].stiffness();
        let mut measured: Vec<usize> = (0..self.points.len())
            .filter(|k| stiffness(k).is_some())
            .collect();
        measured.sort_by(|a, b| {
            let of = |k: &usize| stiffness(k).unwrap_or(f64::NEG_INFINITY);
            of(a).total_cmp(&of(b))
        });
        measured
    }

    /// Returns the point of the median stiffness, the lower one of an even number.
    fn median_point(&self) -> Option<usize> {
        let measured = self.by_stiffness();
        measured.get(measured.len().saturating_sub(1) / 2).copied()
    }

    fn stiffest_point(&self) -> Option<usize> {
        self.by_stiffness().last().copied()
    }
}

/// Returns the median, the lower one for an even count; `None` for an empty list.
fn median(mut numbers: Vec<f64>) -> Option<f64> {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len().saturating_sub(1) / 2).copied()
}
