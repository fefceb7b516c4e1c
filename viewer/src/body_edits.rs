//! Undo history of manual edits of the body: cuts and pins.

use palpate::mesh::Blade;
use palpate::scene::Checkpoint;
use std::sync::Arc;

/// A manual edit of the body.
pub enum BodyEdit {
    /// A cut, with the state before it.
    Cut(Blade, Box<BodySnapshot>),
    /// Pinned nodes.
    Pins(Vec<u32>),
}

/// State of a body before a cut.
pub struct BodySnapshot {
    /// Simulation state, including earlier cuts.
    pub checkpoint: Checkpoint,
    /// Pinned nodes.
    pub pinned: Vec<u32>,
}

/// Undo and redo stacks; each entry stores the number of scene edits before it, so that both kinds
/// of edits are undone in one order.
#[derive(Clone, Default)]
pub struct BodyEditHistory {
    done: Vec<(usize, Arc<BodyEdit>)>,
    undone: Vec<(usize, Arc<BodyEdit>)>,
}

impl BodyEditHistory {
    /// Records an edit after `edits` scene edits; `again` marks a redo.
    pub fn push(&mut self, edits: usize, touch: BodyEdit, again: bool) {
        if !again {
            self.undone.clear();
        }
        self.done.push((edits, Arc::new(touch)));
    }

    /// Adds nodes to the last pin edit.
    pub fn extend(&mut self, edits: usize, nodes: &[u32]) {
        let last = self.done.last_mut().map(|(_, touch)| touch);
        match last.and_then(Arc::get_mut) {
            Some(BodyEdit::Pins(own)) => own.extend_from_slice(nodes),
            _ => self.push(edits, BodyEdit::Pins(nodes.to_vec()), false),
        }
    }

    /// Whether the next undo, and the next redo, is in this history if there are `edits` scene
    /// edits.
    pub fn can(&self, edits: usize) -> [bool; 2] {
        let done = self.done.last().is_some_and(|(own, _)| *own >= edits);
        let undone = self.undone.last().is_some_and(|(own, _)| *own == edits);
        [done, undone]
    }

    /// Pops the next edit to undo.
    pub fn undo(&mut self) -> Option<Arc<BodyEdit>> {
        let (edits, touch) = self.done.pop()?;
        self.undone.push((edits, touch.clone()));
        Some(touch)
    }

    /// Pops the next edit to redo.
    pub fn redo(&mut self) -> Option<Arc<BodyEdit>> {
        self.undone.pop().map(|(_, touch)| touch)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::body_session::{BodySession, RebuildRequest};
    use glam::DVec3;
    use palpate::generate::bar_of_about;
    use palpate::gpu::Gpu;
    use palpate::scene::Scene;
    use std::time::{Duration, Instant};

    /// Advances the body until its pending work and `count` steps are done.
    fn steps(show: &mut BodySession, count: u32) {
        let until = Instant::now() + Duration::from_secs(600);
        let first = show.steps;
        while show.steps < first + u64::from(count) || show.stage_mut().poll_steps().unwrap() {
            show.advance_to_now(None);
            assert!(show.failure.is_none(), "{:?}", show.failure);
            assert!(Instant::now() < until);
            std::thread::sleep(Duration::from_millis(2));
        }
        show.playing = false;
        show.advance_to_now(None);
    }

    #[test]
    fn cuts_and_pins_undo_and_redo() {
        let gpu = Gpu::new().unwrap();
        let text = "[solver]\nname = \"implicit\"\nengine = \"cpu\"\ndt = 0.01\n[material]\nyoung = 3e4\n\
            [[pin]]\naxis = \"x\"\nbelow = 0.02\n";
        let scene = Scene::parse(text).unwrap();
        let mesh = bar_of_about(400, DVec3::new(0.12, 0.06, 0.06));
        let mesh = Arc::new(mesh.unwrap());
        let mut show = BodySession::new(&gpu, &scene, mesh.clone(), None).unwrap();
        steps(&mut show, 4);
        let place = show.stage().motion().unwrap().positions().unwrap();
        let pinned = |show: &BodySession| {
            let loads = show.stage().motion().unwrap().simulator.loads();
            loads.pinned().iter().filter(|p| **p).count()
        };
        let held = pinned(&show);
        let loads = show.stage().motion().unwrap().simulator.loads();
        let free = loads.pinned().iter().enumerate();
        let free: Vec<u32> = free.filter_map(|(v, p)| (!p).then_some(v as u32)).collect();
        assert_eq!(show.hold(&free[..2], 0, true).unwrap(), 2);
        assert_eq!(show.hold(&free[1..3], 0, false).unwrap(), 1);
        assert_eq!(pinned(&show), held + 3);
        let (low, high) = mesh.bounds();
        let x = 0.5 * (low.x + high.x);
        let edge = |z: f64| {
            [
                DVec3::new(x, low.y - 1.0, z),
                DVec3::new(x, high.y + 1.0, z),
            ]
        };
        let blade = Blade::from_sweep(&[edge(low.z - 1.0), edge(high.z + 1.0)]).unwrap();
        show.cut(blade, 0);
        show.advance_to_now(None);
        assert!(show.stage().mesh().nodes.len() > mesh.nodes.len());
        assert_eq!(show.edits.can(0), [true, false]);
        assert_eq!(
            show.edits.can(1),
            [false, false],
            "a scene edit after the cut is undone first"
        );
        let touch = show.edits.clone().undo().unwrap();
        let BodyEdit::Cut(_, before) = touch.as_ref() else {
            panic!("the last edit must be the cut");
        };
        let mut back = RebuildRequest::of(&show).rebuild(&gpu, before).unwrap();
        assert_eq!(back.stage().mesh().nodes.len(), mesh.nodes.len());
        let there = back.stage().motion().unwrap().positions().unwrap();
        assert!(there == place, "positions must equal those before the cut");
        assert!(
            place != mesh.nodes,
            "positions before the cut must differ from the rest positions"
        );
        assert_eq!(pinned(&back), held + 3);
        assert_eq!(back.edits.can(0), [true, true]);
        // Then the pins, without resetting the body.
        back.undo_pins().unwrap();
        assert_eq!(pinned(&back), held);
        assert_eq!(back.edits.can(0), [false, true]);
        back.redo(0).unwrap();
        assert_eq!(pinned(&back), held + 3);
        back.redo(0).unwrap();
        back.advance_to_now(None);
        assert_eq!(
            back.stage().mesh().nodes.len(),
            show.stage().mesh().nodes.len()
        );
        assert_eq!(back.edits.can(0), [true, false]);
    }
}
