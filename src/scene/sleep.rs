//! Sleeping of bodies in equilibrium: they are not stepped until they are disturbed.
//!
//! A body falls asleep when it has been slow for some steps, its kinetic energy is negligible
//! beside its elastic energy, and its static forces are balanced relative to the loads. None of
//! these criteria depends on the size of the body, its time scale or the integration scheme.

use crate::Result;
use crate::physics::Simulator;

/// A body is slow below this speed in its sizes per second, or below this fraction of its largest
/// speed since it was last disturbed …
const SLOW_SPEED: f64 = 1e-4;
const SLOW_SPEED_RATIO: f64 = 1e-2;
/// … for this number of steps, which doubles up to a limit with each check that finds it out of
/// equilibrium.
const STEPS: u32 = 20;
const MAX_STEPS: u32 = 160;

/// Largest kinetic energy of a body at rest, over its elastic energy …
const MAX_KINETIC_RATIO: f64 = 1e-6;
/// … or, without elastic energy, largest speed over the largest one since the last disturbance.
const MAX_SPEED_RATIO: f64 = 1e-6;

/// Sleep state of a body, updated from the progress of its solver.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Sleep {
    allowed: bool,
    asleep: bool,
    /// Number of steps for which it has been slow.
    slow: u32,
    /// Number of slow steps before the next check.
    wait: u32,
    /// Largest speed, in sizes per second, and largest net force, N, since the last disturbance.
    peak_speed: f64,
    peak_force: f64,
    /// Number of steps and seconds that were not simulated.
    pub slept: (u64, f64),
    /// The body's counter of external changes at the last update.
    touched: u64,
}

impl Sleep {
    pub fn new(allowed: bool) -> Sleep {
        Sleep {
            allowed,
            asleep: false,
            slow: 0,
            wait: STEPS,
            peak_speed: 0.0,
            peak_force: 0.0,
            slept: (0, 0.0),
            touched: 0,
        }
    }

    /// Whether it sleeps, given the body's counter `touched` of external changes.
    pub fn is_asleep(&mut self, touched: u64) -> bool {
        if touched != self.touched {
            self.touched = touched;
            self.wake();
        }
        self.asleep
    }

    pub fn wake(&mut self) {
        *self = Sleep {
            slept: self.slept,
            touched: self.touched,
            ..Sleep::new(self.allowed)
        };
    }

    /// Records `steps` of `dt` seconds that were not simulated.
    pub fn skip(&mut self, steps: u32, dt: f64) {
        self.slept.0 += u64::from(steps);
        self.slept.1 += f64::from(steps) * dt;
    }

    /// Records `steps` of `body`, whose counter of external changes was `touched` before them, and
    /// checks whether it is in equilibrium if it has been slow for long enough.
    ///
    /// # Errors
    /// Errors of reading back.
    pub fn update(&mut self, body: &dyn Simulator, steps: u32, touched: u64) -> Result<()> {
        self.touched = touched;
        let speed = body.rms_speed();
        if !self.allowed || speed.is_nan() {
            self.slow = 0;
            return Ok(());
        }
        self.peak_speed = self.peak_speed.max(speed);
        if speed >= SLOW_SPEED.max(SLOW_SPEED_RATIO * self.peak_speed) {
            self.slow = 0;
            return Ok(());
        }
        self.slow += steps;
        if self.slow < self.wait {
            return Ok(());
        }
        self.asleep = self.is_at_rest(body, speed)?;
        self.slow = 0;
        self.wait = (2 * self.wait).min(MAX_STEPS);
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
