//! Sleeping of bodies in equilibrium: they are not stepped until they are disturbed.
//!
//! A body falls asleep when it has been slow for some steps, its kinetic energy is negligible
//! compared with its elastic energy, and its static forces are balanced relative to the loads. None
//! of these criteria depends on the size of the body, its time scale or the integration scheme.

use crate::Result;
use crate::physics::Simulator;

/// Speed below which a body is slow, in its sizes per second.
const SLOW_SPEED: f64 = 1e-4;
/// Speed below which a body is slow, over its largest speed since the last disturbance.
const SLOW_SPEED_RATIO: f64 = 1e-2;
/// Number of consecutive slow steps before the first check of the equilibrium.
const SLOW_STEPS_BEFORE_CHECK: u32 = 20;
/// Maximum of that number, which doubles with each check that fails.
const MAX_SLOW_STEPS_BEFORE_CHECK: u32 = 160;

/// Largest kinetic energy of a body at rest, over its elastic energy.
const MAX_KINETIC_RATIO: f64 = 1e-6;
/// Largest speed of a body at rest, over its largest speed since the last disturbance; decides for
/// bodies without elastic energy.
const MAX_SPEED_RATIO: f64 = 1e-6;

/// Sleep state of a body, updated from the progress of its solver.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Sleep {
    allowed: bool,
    asleep: bool,
    /// Number of steps for which it has been slow.
    slow_steps: u32,
    /// Number of slow steps before the next check.
    steps_until_check: u32,
    /// Largest speed, in sizes per second, and largest net force, N, since the last disturbance.
    peak_speed: f64,
    peak_force: f64,
    /// Number of steps and seconds that were not simulated.
    pub skipped: (u64, f64),
    /// The body's counter of external changes at the last update.
    change_count: u64,
}

impl Sleep {
    pub fn new(allowed: bool) -> Sleep {
        Sleep {
            allowed,
            asleep: false,
            slow_steps: 0,
            steps_until_check: SLOW_STEPS_BEFORE_CHECK,
            peak_speed: 0.0,
            peak_force: 0.0,
            skipped: (0, 0.0),
            change_count: 0,
        }
    }

    /// Whether it sleeps, given the body's counter `change_count` of external changes.
    pub fn is_asleep(&mut self, change_count: u64) -> bool {
        if change_count != self.change_count {
            self.change_count = change_count;
            self.wake();
        }
        self.asleep
    }

    pub fn wake(&mut self) {
        *self = Sleep {
            skipped: self.skipped,
            change_count: self.change_count,
            ..Sleep::new(self.allowed)
        };
    }

    /// Records `steps` of `dt` seconds that were not simulated.
    pub fn skip(&mut self, steps: u32, dt: f64) {
        self.skipped.0 += u64::from(steps);
        self.skipped.1 += f64::from(steps) * dt;
    }

    /// Records `steps` of `body`, whose counter of external changes was `change_count` before them,
    /// and checks whether it is in equilibrium if it has been slow for long enough.
    ///
    /// # Errors
    /// Errors of reading back.
    pub fn update(&mut self, body: &dyn Simulator, steps: u32, change_count: u64) -> Result<()> {
        self.change_count = change_count;
        let speed = body.rms_speed();
        if !self.allowed || speed.is_nan() {
            self.slow_steps = 0;
            return Ok(());
        }
        self.peak_speed = self.peak_speed.max(speed);
        if speed >= SLOW_SPEED.max(SLOW_SPEED_RATIO * self.peak_speed) {
            self.slow_steps = 0;
            return Ok(());
        }
        self.slow_steps += steps;
        if self.slow_steps < self.steps_until_check {
            return Ok(());
        }
        self.asleep = self.is_at_rest(body, speed)?;
        self.slow_steps = 0;
        self.steps_until_check = (2 * self.steps_until_check).min(MAX_SLOW_STEPS_BEFORE_CHECK);
        Ok(())
    }

    fn is_at_rest(&mut self, body: &dyn Simulator, speed: f64) -> Result<bool> {
        let Some(balance) = body.force_balance()? else {
            return Ok(false);
        };
        self.peak_force = self.peak_force.max(balance.residual);
        if !balance.is_equilibrium(self.peak_force) {
            return Ok(false);
        }
        if speed <= MAX_SPEED_RATIO * self.peak_speed {
            return Ok(true);
        }
        let energy = body.report()?.energy;
        Ok(energy.kinetic <= MAX_KINETIC_RATIO * energy.elastic)
    }

    pub fn allowed(&self) -> bool {
        self.allowed
    }

    pub fn asleep(&self) -> bool {
        self.asleep
    }
}
