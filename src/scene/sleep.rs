//! Sleeping of bodies at rest: they are not stepped until they are disturbed.

/// A body whose mean speed is below this many of its sizes per second …
const SLEEP_SPEED: f64 = 1e-4;
/// … for this time, s, and number of steps falls asleep.
const SLEEP_DELAY: f64 = 0.2;
const STEPS: u32 = 20;

/// Sleep state of a body, updated from the progress of its solver.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Sleep {
    allowed: bool,
    asleep: bool,
    /// Time, s, and number of steps for which it has been slow.
    slow: (f64, u32),
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
            slow: (0.0, 0),
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
        self.asleep = false;
        self.slow = (0.0, 0);
    }

    /// Records `steps` of `dt` seconds that were not simulated.
    pub fn skip(&mut self, steps: u32, dt: f64) {
        self.slept.0 += u64::from(steps);
        self.slept.1 += f64::from(steps) * dt;
    }

    /// Records `steps` of `dt` seconds; the body then moves at `speed`, in its sizes per second,
    /// and its counter of external changes is `touched`.
    pub fn update(&mut self, speed: f64, steps: u32, dt: f64, touched: u64) {
        self.touched = touched;
        if speed >= SLEEP_SPEED || speed.is_nan() {
            self.slow = (0.0, 0);
            return;
        }
        self.slow.0 += f64::from(steps) * dt;
        self.slow.1 += steps;
        self.asleep = self.allowed && self.slow.0 >= SLEEP_DELAY && self.slow.1 >= STEPS;
    }

    pub fn allowed(&self) -> bool {
        self.allowed
    }

    pub fn asleep(&self) -> bool {
        self.asleep
    }
}
