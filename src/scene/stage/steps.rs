//! Steps of a stage's simulation, with the cuts that its blades make between them.

use super::Stage;
use crate::Result;
use crate::mesh::Blade;
use crate::scene::Motion;

impl Stage {
    /// Returns the scene's number of steps before a picture; 0 for a static body.
    pub fn steps(&self) -> u32 {
        self.motion().map_or(0, |_| self.steps)
    }

    /// Returns the simulated time, s.
    pub fn time(&self) -> f64 {
        self.motion().map_or(0.0, Motion::time)
    }

    /// Runs `steps` steps of the solver and reports the number done to `progress`.
    ///
    /// # Errors
    /// [`Error::Solver`](crate::Error::Solver) if the simulation failed; the last valid state is
    /// kept and can be drawn.
    pub fn run(&mut self, steps: u32, progress: &mut dyn FnMut(u32)) -> Result<()> {
        let mut done = 0;
        while done < steps {
            let Some(some) = self.steps_until_cut(steps - done) else {
                return Ok(());
            };
            if let Some(motion) = self.motion_mut() {
                motion.run(some, &mut |n| progress(done + n))?;
            }
            done += some;
            self.cut_as_swept()?;
        }
        Ok(())
    }

    /// Starts up to `steps` more steps without waiting, for interactive use; call it again once
    /// [`Stage::poll_steps`] returns false.
    ///
    /// # Errors
    /// As [`Stage::run`].
    pub fn request_steps(&mut self, steps: u32) -> Result<()> {
        let some = self.steps_until_cut(steps);
        match (some, self.motion_mut()) {
            (Some(some), Some(motion)) => motion.request_steps(some),
            _ => Ok(()),
        }
    }

    /// Whether steps started by [`Stage::request_steps`] are still being computed; does not wait.
    /// Makes the cuts of the scene once the steps are done.
    ///
    /// # Errors
    /// As [`Stage::run`].
    pub fn poll_steps(&mut self) -> Result<bool> {
        let under_way = match self.motion_mut() {
            Some(motion) => motion.poll_steps()?,
            None => false,
        };
        if !under_way {
            self.cut_as_swept()?;
        }
        Ok(under_way)
    }

    /// Returns the number of steps, at most `steps`, until the next cut of the scene; `None` for a
    /// static body.
    fn steps_until_cut(&self, steps: u32) -> Option<u32> {
        let motion = self.motion()?;
        let time = motion.time();
        let pace = self.cutters.iter().filter_map(|k| k.cut_interval(time));
        Some(match pace.min_by(f64::total_cmp) {
            None => steps,
            Some(pace) => ((pace / motion.dt).ceil() as u32)
                .clamp(1, steps.max(1))
                .min(steps),
        })
    }

    /// Makes the cuts that the scene's blades have swept since the last call.
    fn cut_as_swept(&mut self) -> Result<()> {
        let time = self.time();
        let swept = self.cutters.iter_mut().filter_map(|k| k.next_sweep(time));
        let blades: Vec<Blade> = swept.collect();
        for blade in &blades {
            self.cut(blade)?;
        }
        Ok(())
    }
}
