//! Time-dependent cuts of a scene.

use super::CutEntry;
use super::trajectory::{check, position_at};
use crate::Result;
use crate::mesh::Blade;
use glam::DVec3;

/// Number of incremental cuts along a blade's path.
const STEPS_PER_PATH: f64 = 16.0;

/// A moving blade of a scene.
#[derive(Debug)]
pub(super) struct ActiveBlade {
    entry: CutEntry,
    /// Time up to which it has cut, s.
    pub(super) cut: Option<f64>,
}

impl ActiveBlade {
    pub fn new(entry: &CutEntry) -> Result<ActiveBlade> {
        check(&entry.path, 2, "cut")?;
        let cutter = ActiveBlade {
            entry: entry.clone(),
            cut: None,
        };
        // Reject a blade that sweeps no area here rather than during the simulation.
        let [begin, end] = cutter.span();
        Blade::from_sweep(&[cutter.edge(begin), cutter.edge(end)])?;
        Ok(cutter)
    }

    fn span(&self) -> [f64; 2] {
        let times = |p: Option<&[f64; 4]>| p.map_or(0.0, |p| p[0]);
        [
            times(self.entry.path.first()),
            times(self.entry.path.last()),
        ]
    }

    /// Returns the time between two incremental cuts, or up to the first one if it is later; `None`
    /// after its path.
    pub fn cut_interval(&self, time: f64) -> Option<f64> {
        let [begin, end] = self.span();
        (self.cut.is_none_or(|cut| cut < end) && time <= end).then(|| {
            let pace = (end - begin) / STEPS_PER_PATH;
            if time < begin {
                pace.max(begin - time)
            } else {
                pace
            }
        })
    }

    /// Returns the surface swept since the previous call; `None` if it is empty.
    pub fn next_sweep(&mut self, time: f64) -> Option<Blade> {
        let [begin, end] = self.span();
        let from = self.cut.unwrap_or(begin);
        let to = time.min(end);
        if to <= from {
            return None;
        }
        self.cut = Some(to);
        let path = self.entry.path.iter().map(|p| p[0]);
        let between = path.filter(|t| *t > from && *t < to);
        let times: Vec<f64> = [from].into_iter().chain(between).chain([to]).collect();
        let edges: Vec<[DVec3; 2]> = times.iter().map(|t| self.edge(*t)).collect();
        // A blade at rest sweeps nothing.
        Blade::from_sweep(&edges).ok()
    }

    fn edge(&self, time: f64) -> [DVec3; 2] {
        let moved = position_at(&self.entry.path, time);
        self.entry.edge.map(|end| DVec3::from(end) + moved)
    }
}
