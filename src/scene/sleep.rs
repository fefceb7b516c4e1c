//! Bodies at rest fall asleep: they are not stepped until something touches them.

/// A body whose mean speed is below so many of its sizes a second …
const SLEEP_SPEED: f64 = 1e-4;
/// … for so many seconds and steps falls asleep.
const SLEEP_DELAY: f64 = 0.2;
const STEPS: u32 = 20;

/// Whether a body sleeps, decided from what a run of its solver tells anyway.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Sleep {
    allowed: bool,
    asleep: bool,
    /// For how long it has been slow.
    slow: (f64, u32),
    /// Steps and seconds that were not simulated.
    pub slept: (u64, f64),
    /// Of the body, when it was last left.
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

    /// Whether it sleeps, where the body counts `touched` changes from outside.
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

    /// Takes note of `steps` of `dt` seconds that were not simulated.
    pub fn skip(&mut self, steps: u32, dt: f64) {
        self.slept.0 += u64::from(steps);
        self.slept.1 += f64::from(steps) * dt;
    }

    /// Takes note of `steps` of `dt` seconds, after which the body, which counts `touched`
    /// changes from outside, moves at `speed`, in its sizes a second.
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
