//! Steps in real time.

use super::BodySession;
use eframe::egui;
use palpate::physics::{Engine, StepCallback};
use palpate::press::PressSession;
use palpate::scene::Motion;
use palpate::{Error, Result};
use std::time::Duration;
use web_time::Instant;

/// Maximum real time to catch up, for a body that is slower than real time.
const MAX_TIME_DEBT: Duration = Duration::from_millis(100);
/// Polling interval for a body on the GPU.
const POLL_INTERVAL: Duration = Duration::from_millis(15);
/// Averaging time of the step rate.
const RATE_WINDOW: Duration = Duration::from_secs(1);

impl BodySession {
    /// Returns the displayed time, s.
    pub fn time(&self) -> f64 {
        match &self.player {
            Some(player) => player.series().time(player.shown()),
            None => {
                let fingertip = self.fingertip.as_ref();
                self.stage.time() - fingertip.map_or(0.0, PressSession::static_time)
            }
        }
    }

    /// Returns the interval between steps at normal speed, s; `None` for a static body.
    fn step_interval(&self) -> Option<f64> {
        let motion = self.stage.motion()?;
        let fingertip = self.fingertip.as_ref();
        Some(fingertip.map_or(motion.dt, PressSession::idle_step))
    }

    /// Sets the callback for completed steps.
    pub fn set_waker(&mut self, waker: StepCallback, context: &egui::Context) {
        if let Some(player) = &mut self.player {
            player.wake(context);
        }
        if let Some(motion) = self.stage.motion_mut() {
            motion.simulator.set_waker(waker);
        }
    }

    /// Whether the state changes without further input.
    fn is_busy(&self) -> bool {
        let goes = self.finger_moves();
        let awake = |m: &Motion| !m.asleep() || self.stirred || self.timed;
        let steps = self.playing || self.touched();
        let awake = steps && self.stage.motion().is_some_and(awake);
        !self.failed && (goes || awake)
    }

    /// Whether a step is running or pending.
    pub fn is_going(&self) -> bool {
        self.under_way || self.blade.is_some() || self.is_busy()
    }

    /// Returns when to poll the body, if no callback comes first.
    pub fn next_poll(&self) -> Option<Duration> {
        if self.blade.is_some() && !self.under_way {
            return Some(Duration::ZERO);
        }
        if self.player.is_some() {
            return self.next_frame();
        }
        let motion = self.stage.motion().filter(|_| self.is_busy())?;
        match (self.under_way, motion.engine()) {
            (true, Engine::Gpu) => Some(POLL_INTERVAL),
            (true, _) => None,
            (false, _) => {
                let left = (self.step_interval()? - self.owed).max(0.0) / self.speed;
                Some(Duration::from_secs_f64(left.clamp(1e-3, 1.0)))
            }
        }
    }

    /// Whether a step is running; waits for one on the CPU until `until`.
    fn under_way_until(&mut self, until: Option<Instant>) -> Result<bool> {
        let on_cpu = |motion: &Motion| motion.engine() == Engine::Cpu;
        // In a browser, steps complete synchronously.
        let waits = !cfg!(target_arch = "wasm32") && self.stage.motion().is_some_and(on_cpu);
        loop {
            let under_way = self.stage.poll_steps()?;
            if !(under_way && waits && until.is_some_and(|until| Instant::now() < until)) {
                return Ok(under_way);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Advances the body to the current time: collects completed steps and requests more. Waits for
    /// a running step until `until`, if given.
    pub fn advance_to_now(&mut self, until: Option<Instant>) {
        let under_way = self.under_way_until(until);
        let now = Instant::now();
        let passed = now.duration_since(self.last);
        self.last = now;
        self.count(now);
        if self.player.is_some() {
            return self.play_series(passed.as_secs_f64());
        }
        // Also while a step is running, so that a body slower than real time starts its next step
        // immediately.
        match self.playing || self.touched() {
            true => self.owed += self.speed * passed.min(MAX_TIME_DEBT).as_secs_f64(),
            false => self.owed = 0.0,
        }
        match under_way {
            Ok(true) => return,
            // The result of the step is visible now.
            Ok(false) if std::mem::take(&mut self.under_way) => {
                self.version += 1;
                let done = self.asked[1].take();
                self.shown = self.shown.or(done);
            }
            Ok(false) => {}
            Err(Error::Solver { .. }) if self.backs_off() => {
                self.remark = Some("finger stopped: the contact step failed here".into());
                return;
            }
            Err(why) => return self.fail(&why),
        }
        if let Err(why) = self.cut_asked() {
            self.remark = Some(format!("cut failed: {why}"));
        }
        let Some(interval) = self.step_interval() else {
            return;
        };
        if let Err(why) = self.settle() {
            return self.fail(&why);
        }
        // A body without the field of the isolines is simulated all the same.
        if let Err(why) = self.take_section() {
            self.remark = Some(format!("no section: {why}"));
        }
        if self.is_busy() && self.owed >= interval {
            self.owed = (self.owed - interval).min(interval);
            if let Err(why) = self.step() {
                self.fail(&why);
            }
        }
    }

    fn fail(&mut self, why: &Error) {
        self.failure = Some(why.to_string());
        self.failed = true;
        self.grab = None;
        self.under_way = false;
        self.playing = false;
        self.owed = 0.0;
        self.remove_finger();
    }

    fn count(&mut self, now: Instant) {
        let (since, before) = self.counted;
        let passed = now.duration_since(since);
        if passed >= RATE_WINDOW {
            self.rate = (self.steps - before) as f64 / passed.as_secs_f64();
            self.counted = (now, self.steps);
        }
    }

    /// Requests one step, with the finger moved towards its target depth.
    pub fn step(&mut self) -> Result<()> {
        self.advance_finger()?;
        self.stage.request_steps(1)?;
        self.stirred = false;
        self.under_way = true;
        self.steps += 1;
        self.version += 1;
        Ok(())
    }
}
