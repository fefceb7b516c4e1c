//! Recorded series: frames and playback.

use crate::body_session::BodySession;
use crate::loading::BackgroundTask;
use eframe::egui;
use glam::DVec3;
use palpate::annotate::FrameTime;
use palpate::mesh::{Field, TetMesh};
use palpate::scene::{FieldRanges, Scene};
use palpate::{Error, ProgressFn, Result, io};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Maximum bytes of cached frames; others are read again when they are shown.
const CACHE_BYTES: usize = 1 << 30;
/// Frames per second of a series without valid times.
const FPS: f64 = 12.0;
/// Maximum time step of playback, s.
const MAX_FRAME_INTERVAL: f64 = 0.5;

/// A frame of a series.
pub struct Frame {
    nodes: Vec<DVec3>,
    fields: Vec<Field>,
}

/// Metadata of a frame.
struct Entry {
    /// Time since the first frame, s.
    time: f64,
    files: io::Frame,
    kept: Option<Arc<Frame>>,
}

/// A recorded series of one mesh.
pub struct Series {
    entries: Vec<Entry>,
    /// Range of each field over all frames, by name; for vectors, of their length.
    ranges: FieldRanges,
    /// Bounds over all frames.
    bounds: (DVec3, DVec3),
    /// Time of the first frame, s; `None` without valid times.
    began: Option<f64>,
}

impl Series {
    /// Reads all frames of a `.pvd`, reporting progress, and the mesh of the first.
    ///
    /// # Errors
    /// Read errors; [`Error::Format`] for a series without frames or with frames of different
    /// meshes; [`Error::Cancelled`].
    pub fn read(file: &Path, progress: ProgressFn) -> Result<(Series, TetMesh)> {
        Series::read_keeping(file, CACHE_BYTES, progress)
    }

    fn read_keeping(file: &Path, most: usize, progress: ProgressFn) -> Result<(Series, TetMesh)> {
        let listed = io::read_pvd(file)?;
        let Some(first) = listed.first() else {
            return Err(Error::format(file, "the series has no frames"));
        };
        let began = first.time;
        let rises = listed.windows(2).all(|two| two[0].time < two[1].time);
        let mut mesh: Option<TetMesh> = None;
        let mut series = Series {
            entries: Vec::new(),
            ranges: FieldRanges::default(),
            bounds: (DVec3::INFINITY, DVec3::NEG_INFINITY),
            began: rises.then_some(began),
        };
        let (count, mut bytes) = (listed.len(), 0);
        for (n, listed) in listed.into_iter().enumerate() {
            let told = format!("frame {} of {count}", n + 1);
            if progress(&told, n as f64 / count as f64).is_break() {
                return Err(Error::Cancelled);
            }
            let read = listed.read()?;
            if let Some(mesh) = &mesh {
                check_same(mesh, &read, listed.file())?;
            }
            let (low, high) = read.bounds();
            series.bounds = (series.bounds.0.min(low), series.bounds.1.max(high));
            series.ranges.add(&read.fields);
            mesh.get_or_insert_with(|| read.clone());
            let frame = Frame::of(read);
            bytes += frame.bytes();
            series.entries.push(Entry {
                time: match rises {
                    true => listed.time - began,
                    false => n as f64 / FPS,
                },
                files: listed,
                kept: (bytes <= most).then(|| Arc::new(frame)),
            });
        }
        Ok((series, mesh.unwrap_or_default()))
    }

    /// Returns the number of frames.
    pub fn count(&self) -> usize {
        self.entries.len()
    }

    /// Returns the time of a frame, s.
    pub fn time(&self, frame: usize) -> f64 {
        let time = self.entries.get(frame).map_or(0.0, |e| e.time);
        time + self.began.unwrap_or(0.0)
    }

    /// Returns the file of a frame; `None` for a frame of several parts.
    pub fn file(&self, frame: usize) -> Option<&Path> {
        self.entries.get(frame)?.files.single_file()
    }

    /// Returns the range of a field over all frames.
    pub fn range(&self, field: &str) -> Option<(f64, f64)> {
        self.ranges.get(field)
    }

    /// Returns the last frame at or before `time` seconds after the first.
    fn at(&self, time: f64) -> usize {
        let begun = self.entries.partition_point(|e| e.time <= time);
        begun.saturating_sub(1)
    }
}

/// Returns an error for a frame of another mesh.
fn check_same(mesh: &TetMesh, frame: &TetMesh, file: &Path) -> Result<()> {
    if frame.has_elements_of(mesh) && frame.nodes.len() == mesh.nodes.len() {
        return Ok(());
    }
    if frame.tets.len() == mesh.tets.len() && frame.nodes.len() == mesh.nodes.len() {
        return Err(Error::format(
            file,
            "the nodes or tets are numbered in another way than in the first frame; render the series with `palpate simulate`, which draws each frame as its own mesh",
        ));
    }
    Err(Error::format(
        file,
        format!(
            "the mesh differs from that of the first frame: {} tets and {} nodes instead of {} and {}; a cut changes the mesh, so open the frames after it as a separate series",
            frame.tets.len(),
            frame.nodes.len(),
            mesh.tets.len(),
            mesh.nodes.len()
        ),
    ))
}

impl Frame {
    fn of(mesh: TetMesh) -> Frame {
        Frame {
            nodes: mesh.nodes,
            fields: mesh.fields,
        }
    }

    fn bytes(&self) -> usize {
        let values: usize = self.fields.iter().map(|f| f.values.len()).sum();
        24 * self.nodes.len() + 8 * values
    }
}

/// Playback state of a series.
pub struct Player {
    series: Arc<Series>,
    /// The displayed frame, and the requested one.
    shown: usize,
    wanted: usize,
    /// Time since the first frame, s.
    clock: f64,
    reading: Option<(usize, BackgroundTask<Frame>)>,
    /// Interface to repaint when a frame has been read.
    context: egui::Context,
}

impl Player {
    pub(crate) fn new(series: Arc<Series>) -> Player {
        Player {
            series,
            shown: 0,
            wanted: 0,
            clock: 0.0,
            reading: None,
            context: egui::Context::default(),
        }
    }

    /// Returns the series.
    pub fn series(&self) -> &Arc<Series> {
        &self.series
    }

    /// Returns the displayed frame.
    pub fn shown(&self) -> usize {
        self.shown
    }

    /// Returns the requested frame.
    pub fn wanted(&self) -> usize {
        self.wanted
    }

    /// Requests a frame, clamped to the last one.
    pub fn seek(&mut self, frame: usize) {
        self.wanted = frame.min(self.series.count() - 1);
        self.clock = self.series.entries[self.wanted].time;
    }

    /// Whether the requested frame is the last.
    pub fn at_end(&self) -> bool {
        self.wanted + 1 == self.series.count()
    }

    /// Sets the interface to repaint when a frame has been read.
    pub(crate) fn wake(&mut self, context: &egui::Context) {
        self.context = context.clone();
    }

    /// Advances playback by seconds. Returns whether frames remain.
    fn pass(&mut self, seconds: f64) -> bool {
        self.clock += seconds.min(MAX_FRAME_INTERVAL);
        self.wanted = self.series.at(self.clock);
        !self.at_end()
    }

    /// Returns the time until the next frame, s.
    fn until_next(&self) -> Option<f64> {
        let next = self.series.entries.get(self.wanted + 1)?;
        Some((next.time - self.clock).max(0.0))
    }

    /// Returns the requested frame once it is loaded, if it is not displayed yet.
    fn next(&mut self) -> Result<Option<(usize, Arc<Frame>)>> {
        if let Some((frame, work)) = &self.reading
            && let Some(read) = work.try_take()
        {
            let frame = *frame;
            self.reading = None;
            return Ok(Some((frame, Arc::new(read?))));
        }
        if self.wanted == self.shown {
            return Ok(None);
        }
        let entry = &self.series.entries[self.wanted];
        if let Some(kept) = &entry.kept {
            return Ok(Some((self.wanted, kept.clone())));
        }
        if self.reading.is_none() {
            let (files, series) = (entry.files.clone(), self.series.clone());
            let first = series.entries[0].kept.clone();
            let work = BackgroundTask::spawn("reading", &self.context, move |_| {
                let frame = Frame::of(files.read()?);
                match first.is_none_or(|first| first.nodes.len() == frame.nodes.len()) {
                    true => Ok(frame),
                    false => Err(Error::format(
                        files.file(),
                        "the file has changed since the series was opened; open the series again",
                    )),
                }
            });
            self.reading = Some((self.wanted, work));
        }
        Ok(None)
    }
}

impl BodySession {
    /// Creates the session of the first frame of a series whose mesh is `mesh`.
    ///
    /// # Errors
    /// The errors of [`Stage::with_mesh`](palpate::scene::Stage::with_mesh).
    pub fn of_series(
        gpu: &palpate::gpu::Gpu,
        scene: &Scene,
        mesh: Arc<TetMesh>,
        series: Arc<Series>,
    ) -> Result<BodySession> {
        let mut show = BodySession::static_body(gpu, scene, mesh)?;
        show.bounds = series.bounds;
        show.player = Some(Player::new(series));
        show.use_series_range(scene)?;
        let (low, high) = show.bounds;
        let corners = (0..8).map(|k| {
            let pick = |axis: usize| [low, high][k >> axis & 1][axis];
            DVec3::new(pick(0), pick(1), pick(2))
        });
        show.stage_mut().fit_view(&corners.collect::<Vec<_>>())?;
        Ok(show)
    }

    /// Returns the scene with the scalar range of the whole series, if it sets none.
    pub(crate) fn with_series_range(&self, scene: &Scene) -> Option<Scene> {
        let series = &self.player.as_ref()?.series;
        self.stage().with_series_range(scene, &series.ranges)
    }

    /// Advances the series by `seconds` and shows the current frame.
    pub(crate) fn play_series(&mut self, seconds: f64) {
        let (playing, seconds) = (self.playing, self.speed * seconds);
        let Some(player) = &mut self.player else {
            return;
        };
        if playing && player.reading.is_none() {
            self.playing = player.pass(seconds);
        }
        let shown = player.next();
        let series = player.series.clone();
        match shown {
            Ok(Some((frame, what))) => {
                player.shown = frame;
                let (seconds, before) = (series.time(frame), series.time(frame.saturating_sub(1)));
                let resolution = (seconds - before).abs();
                self.steps += 1;
                let stage = self.stage_mut();
                if let Err(why) = stage.show_frame(&what.nodes, &what.fields) {
                    self.playing = false;
                    self.remark = Some(format!("frame {}: {why}", frame + 1));
                    return;
                }
                stage.set_displayed_time(FrameTime {
                    seconds,
                    resolution,
                });
            }
            Ok(None) => {}
            Err(why) => {
                player.wanted = player.shown;
                self.playing = false;
                self.remark = Some(why.to_string());
            }
        }
    }

    /// Returns when to poll the series, if no callback comes first.
    pub(crate) fn next_frame(&self) -> Option<Duration> {
        let player = self.player.as_ref()?;
        if player.reading.is_some() {
            return None;
        }
        if player.wanted != player.shown {
            return Some(Duration::ZERO);
        }
        let left = player.until_next().filter(|_| self.playing)?;
        Some(Duration::from_secs_f64(
            (left / self.speed).clamp(1e-3, 1.0),
        ))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use palpate::generate::bar_of_about;
    use palpate::gpu::Gpu;
    use palpate::io::PvdSeries;
    use palpate::mesh::Location;
    use std::path::PathBuf;
    use std::time::Instant;

    /// Records a bar that moves upwards, with different nodal values in each frame.
    fn recorded(folder: &Path) -> (PathBuf, TetMesh) {
        let mesh = bar_of_about(100, DVec3::new(0.12, 0.06, 0.06)).unwrap();
        let mut series = PvdSeries::create(folder, "bar").unwrap();
        for k in 0..4 {
            let nodes: Vec<DVec3> = mesh
                .nodes
                .iter()
                .map(|p| *p + 0.01 * f64::from(k) * DVec3::Z)
                .collect();
            let values = nodes.iter().map(|p| f64::from(k) + p.x).collect();
            let field = Field::scalar("heat", Location::Node, values);
            series
                .push_deformed(0.1 * f64::from(k), &mesh, &nodes, &[field])
                .unwrap();
        }
        (series.path(), mesh)
    }

    fn shown(show: &mut BodySession, frame: usize) {
        show.player.as_mut().unwrap().seek(frame);
        let until = Instant::now() + Duration::from_secs(600);
        while show.player.as_ref().unwrap().shown() != frame {
            show.advance_to_now(None);
            assert!(Instant::now() < until, "{:?}", show.remark);
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(show.remark.is_none(), "{:?}", show.remark);
    }

    #[test]
    fn frames_have_their_own_positions_and_fields() {
        let folder = tempfile::tempdir().unwrap();
        let (file, mesh) = recorded(folder.path());
        let gpu = Gpu::new().unwrap();
        // With all frames cached, and with none.
        for most in [CACHE_BYTES, 0] {
            let (series, first) = Series::read_keeping(&file, most, &palpate::no_progress).unwrap();
            assert_eq!(series.count(), 4);
            let (low, high) = series.range("heat").unwrap();
            assert!(
                low.abs() < 1e-9 && (high - 3.12).abs() < 1e-6,
                "{low} {high}"
            );
            let scene =
                Scene::parse("[picture]\nfield = \"heat\"\ntransfer = \"viridis\"\n").unwrap();
            let mut show =
                BodySession::of_series(&gpu, &scene, Arc::new(first), Arc::new(series)).unwrap();
            assert_eq!(show.stage().scalar_field().range, (low, high));
            for frame in [2, 0, 3, 1] {
                shown(&mut show, frame);
                let x = show.stage().drawn_positions().unwrap();
                let up = x[0].z - mesh.nodes[0].z;
                assert!((up - 0.01 * frame as f64).abs() < 1e-6, "{frame}: {up}");
                let heat = &show.stage().scalar_field().values;
                assert!((heat[0] - frame as f64 - mesh.nodes[0].x).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn playback_follows_recorded_times_and_stops_at_end() {
        let folder = tempfile::tempdir().unwrap();
        let (file, _) = recorded(folder.path());
        let (series, _) = Series::read(&file, &palpate::no_progress).unwrap();
        let mut player = Player::new(Arc::new(series));
        assert!(player.pass(0.15));
        assert_eq!(player.wanted(), 1);
        assert!((player.until_next().unwrap() - 0.05).abs() < 1e-9);
        assert!(player.pass(0.1) && player.wanted() == 2);
        assert!(!player.pass(0.1) && player.at_end());
        player.seek(1);
        assert!((player.clock - 0.1).abs() < 1e-9);
        player.seek(99);
        assert_eq!(player.wanted(), 3);
    }

    #[test]
    fn rejects_frames_of_different_mesh_and_empty_series() {
        let folder = tempfile::tempdir().unwrap();
        let (file, _) = recorded(folder.path());
        let other = bar_of_about(300, DVec3::new(0.12, 0.06, 0.06)).unwrap();
        io::write(folder.path().join("bar_00002.vtu"), &other).unwrap();
        let said = Series::read(&file, &palpate::no_progress)
            .map(|_| ())
            .unwrap_err();
        assert!(
            said.to_string()
                .contains("bar_00002.vtu: the mesh differs from that of the first frame"),
            "{said}"
        );
        PvdSeries::create(folder.path(), "none").unwrap();
        let none = Series::read(&folder.path().join("none.pvd"), &palpate::no_progress);
        assert!(
            none.map(|_| ())
                .unwrap_err()
                .to_string()
                .contains("no frames")
        );
        let stopped = Series::read(&file, &|_, _| std::ops::ControlFlow::Break(()));
        assert!(matches!(stopped, Err(Error::Cancelled)));
    }
}
