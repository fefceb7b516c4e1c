//! Background loading, meshing and preparation of bodies.

use crate::body_edits::BodyEdit;
use crate::body_session::{BodySession, RebuildRequest};
use crate::document::Document;
use crate::platform;
use crate::series::Series;
use eframe::egui;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use palpate::scene::{ScanEntry, Scene};
use palpate::{Error, ProgressFn, Result, io};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use web_time::Instant;

/// Sets the session's callback to repaint the window after steps.
fn with_repaint_callback(mut show: BodySession, context: &egui::Context) -> BodySession {
    let woken = context.clone();
    show.set_waker(Arc::new(move || woken.request_repaint()), context);
    show
}

/// Tasks whose threads have not ended.
static LIVE: AtomicUsize = AtomicUsize::new(0);

/// Returns the number of background tasks whose threads have not ended, cancelled ones included.
pub(crate) fn live_tasks() -> usize {
    LIVE.load(Ordering::Relaxed)
}

/// Counts a task as live until it is dropped.
struct LiveTask;

impl LiveTask {
    fn begin() -> LiveTask {
        LIVE.fetch_add(1, Ordering::Relaxed);
        LiveTask
    }
}

impl Drop for LiveTask {
    fn drop(&mut self) {
        LIVE.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A task on a background thread with progress and result. Dropping it cancels the work.
pub(crate) struct BackgroundTask<T> {
    since: Instant,
    told: Arc<Mutex<(String, f64)>>,
    /// Number of progress reports.
    reports: Arc<AtomicU64>,
    ends: Arc<AtomicBool>,
    made: Receiver<Result<T>>,
}

impl<T> Drop for BackgroundTask<T> {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
    }
}

impl<T: Send + 'static> BackgroundTask<T> {
    /// Starts `work`, with the initial progress text `what`; repaints the window at its end.
    pub fn spawn(
        what: &str,
        context: &egui::Context,
        work: impl FnOnce(ProgressFn) -> Result<T> + Send + 'static,
    ) -> BackgroundTask<T> {
        let (send, made) = channel();
        let told = Arc::new(Mutex::new((what.to_owned(), 0.0)));
        let ends = Arc::new(AtomicBool::new(false));
        let reports = Arc::new(AtomicU64::new(0));
        let (context, tell, ended) = (context.clone(), told.clone(), ends.clone());
        let (counted, live) = (reports.clone(), LiveTask::begin());
        platform::spawn(move || {
            let progress = |what: &str, share: f64| {
                counted.fetch_add(1, Ordering::Relaxed);
                *tell.lock().unwrap_or_else(PoisonError::into_inner) = (what.to_owned(), share);
                match ended.load(Ordering::Relaxed) {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            };
            // The receiver may be gone after cancellation.
            let _ = send.send(work(&progress));
            drop(live);
            context.request_repaint();
        });
        BackgroundTask {
            since: Instant::now(),
            told,
            reports,
            ends,
            made,
        }
    }
}

impl<T> BackgroundTask<T> {
    /// Returns the result, once the task has ended.
    pub fn try_take(&self) -> Option<Result<T>> {
        match self.made.try_recv() {
            Ok(made) => Some(made),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(Error::Input(
                "internal error: the background task ended without a result; please report it"
                    .into(),
            ))),
        }
    }

    /// Returns the current activity, its completed fraction, and the elapsed time, s.
    pub fn progress(&self) -> (String, f64, f64) {
        let told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        let (what, share) = told.clone();
        (what, share, self.since.elapsed().as_secs_f64())
    }
}

/// A body that is being prepared.
pub struct Loading {
    /// Name of the document.
    pub name: String,
    /// The document to install with the body; none if the current body is rebuilt.
    pub document: Option<Document>,
    /// The scene text that the body is built from.
    pub text: String,
    /// The document before the edit that caused the rebuild.
    pub before: Option<Document>,
    work: BackgroundTask<BodySession>,
}

/// Data of an existing body that a rebuild reuses.
pub struct ReusableBody {
    /// Its mesh at rest.
    pub mesh: Arc<TetMesh>,
    /// Finger radius.
    pub radius: f64,
    /// Its recorded series.
    pub series: Option<Arc<Series>>,
}

impl Loading {
    /// Starts to prepare the body of `document`.
    ///
    /// # Errors
    /// An error if the document is invalid.
    pub fn open(gpu: &Gpu, document: Document, context: &egui::Context) -> Result<Loading> {
        let loading = Loading::begin(gpu, &document, None, context)?;
        Ok(Loading {
            document: Some(document),
            ..loading
        })
    }

    /// Starts to rebuild the open body of `document` from the data `kept` of it. `before` is the
    /// document to restore if the rebuild fails.
    ///
    /// # Errors
    /// The errors of [`Loading::open`].
    pub fn rebuild(
        gpu: &Gpu,
        document: &Document,
        kept: ReusableBody,
        before: Option<Document>,
        context: &egui::Context,
    ) -> Result<Loading> {
        let loading = Loading::begin(gpu, document, Some(kept), context)?;
        Ok(Loading { before, ..loading })
    }

    /// Starts to rebuild the body in the state before the cut `touch`.
    pub fn rebuild_before_cut(
        gpu: &Gpu,
        name: String,
        anew: RebuildRequest,
        touch: Arc<BodyEdit>,
        context: &egui::Context,
    ) -> Loading {
        let (gpu, woken) = (gpu.clone(), context.clone());
        let work = BackgroundTask::spawn("undoing the cut", context, move |_| {
            let BodyEdit::Cut(_, before) = touch.as_ref() else {
                return Err(Error::Input(
                    "internal error: the edit to undo is not a cut; please report it".into(),
                ));
            };
            Ok(with_repaint_callback(anew.rebuild(&gpu, before)?, &woken))
        });
        Loading {
            name,
            document: None,
            // An empty text differs from the document's, so its appearance is applied afterwards.
            text: String::new(),
            before: None,
            work,
        }
    }

    /// Whether this opens another document instead of rebuilding the current body.
    pub fn opens(&self) -> bool {
        self.document.is_some()
    }

    fn begin(
        gpu: &Gpu,
        document: &Document,
        kept: Option<ReusableBody>,
        context: &egui::Context,
    ) -> Result<Loading> {
        let (scene, series) = (document.scene()?, document.series.clone());
        let (gpu, woken) = (gpu.clone(), context.clone());
        let work = BackgroundTask::spawn("reading", context, move |progress| {
            let mut scene = scene;
            let kept = match (kept, series) {
                (Some(kept), _) => kept,
                (None, Some(file)) => {
                    let (series, mesh) = Series::read(&file, progress)?;
                    ReusableBody {
                        mesh: Arc::new(mesh),
                        radius: 0.0,
                        series: Some(Arc::new(series)),
                    }
                }
                // Scenes with several bodies or a grid create their own meshes.
                (None, None) => ReusableBody {
                    mesh: match scene.creates_meshes() {
                        true => Arc::default(),
                        false => Arc::new(scene.load_mesh(progress)?),
                    },
                    radius: 0.0,
                    series: None,
                },
            };
            let scans = read_carried(&mut scene, progress)?;
            if progress("preparing", 1.0).is_break() {
                return Err(Error::Cancelled);
            }
            let radius = Some(kept.radius).filter(|radius| *radius > 0.0);
            let mut show = match kept.series {
                Some(series) => BodySession::of_series(&gpu, &scene, kept.mesh, series)?,
                None => BodySession::new(&gpu, &scene, kept.mesh, radius)?,
            };
            show.keep_read(scans, Vec::new());
            // Saves no time on a single thread. Errors are reported by the first picture.
            if cfg!(not(target_arch = "wasm32")) {
                let _ = show.prepare_pictures();
            }
            Ok(with_repaint_callback(show, &woken))
        });
        Ok(Loading {
            name: document.name.clone(),
            document: None,
            text: document.text(),
            before: None,
            work,
        })
    }

    /// Returns the body, once it is ready.
    pub fn ready(&self) -> Option<Result<BodySession>> {
        self.work.try_take()
    }

    /// Returns the current activity, its completed fraction, and the elapsed time, s.
    pub fn progress(&self) -> (String, f64, f64) {
        self.work.progress()
    }

    /// Returns the number of progress reports.
    pub(crate) fn reports(&self) -> u64 {
        self.work.reports.load(Ordering::Relaxed)
    }
}

/// Reads the scans and skins of a scene once, so that appearance edits reuse them.
fn read_carried(scene: &mut Scene, progress: ProgressFn) -> Result<Vec<ReadScan>> {
    let mut scans = Vec::new();
    for scan in &mut scene.scan {
        let read = read_scan(scan, progress)?;
        *scan = read.0.clone();
        scans.push(read);
    }
    for skin in &mut scene.skin {
        skin.surface.0 = Some(Arc::new(skin.read(progress)?));
    }
    Ok(scans)
}

/// Maximum number of labels that are listed.
const MAX_LISTED_LABELS: usize = 64;

/// A scan with its volume, and its labels (number and name) if there are at most
/// [`MAX_LISTED_LABELS`].
pub(crate) type ReadScan = (ScanEntry, Option<Vec<(i64, String)>>);

/// Reads a scan.
///
/// # Errors
/// An error if reading fails; [`Error::Cancelled`].
pub(crate) fn read_scan(scan: &ScanEntry, progress: ProgressFn) -> Result<ReadScan> {
    let report = |what| match progress(what, 0.0).is_break() {
        true => Err(Error::Cancelled),
        false => Ok(()),
    };
    report("reading the scan")?;
    let volume = io::read_volume_number(&scan.file, scan.number)?;
    report("searching for labels")?;
    let labels = volume.labels().filter(|all| all.len() <= MAX_LISTED_LABELS);
    let labels = labels.map(|all| {
        let shown = all.into_keys().filter(|label| *label != 0);
        let named = shown.map(|label| {
            let name = volume.label_names.get(&label).cloned();
            (label, name.unwrap_or_else(|| format!("label {label}")))
        });
        named.collect()
    });
    let mut read = scan.clone();
    read.volume.0 = Some(Arc::new(volume));
    report("preparing")?;
    Ok((read, labels))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// A guard against hangs.
    const HANG: Duration = Duration::from_secs(600);

    #[test]
    fn cancelled_task_ends_at_next_progress_report() {
        let (send, messages) = channel();
        let task = BackgroundTask::spawn("counting", &egui::Context::default(), move |progress| {
            // Reports once per message, and ends when the channel closes.
            loop {
                if progress("counting", 0.5).is_break() {
                    return Err(Error::Cancelled);
                }
                if messages.recv().is_err() {
                    return Ok(());
                }
            }
        });
        for _ in 0..3 {
            send.send(()).unwrap();
        }
        assert!(
            task.try_take().is_none(),
            "the task must wait for the next message"
        );
        task.ends.store(true, Ordering::Relaxed);
        send.send(()).unwrap();
        drop(send);
        let made = task.made.recv_timeout(HANG).unwrap();
        assert!(matches!(made, Err(Error::Cancelled)));
        let reports = task.reports.load(Ordering::Relaxed);
        assert!((1..=5).contains(&reports), "{reports}");
    }

    #[test]
    fn meshing_cancels_at_every_progress_point() {
        let text = "[mesh]\ngenerate = \"limb\"\ntets = 4000\n";
        let scene = Scene::parse(text).unwrap();
        let until = |stop: usize| {
            let calls = AtomicUsize::new(0);
            let made = scene.mesh.load_with_progress(&|_: &str, _: f64| match calls
                .fetch_add(1, Ordering::Relaxed)
                + 1
                >= stop
            {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            });
            (made, calls.into_inner())
        };
        let (made, all) = until(usize::MAX);
        assert!(made.is_ok() && all > 20, "{all}");
        // Each thread may make one more report after the cancellation.
        let threads = std::thread::available_parallelism().unwrap().get();
        for stop in (1..all).step_by(all.div_ceil(12)) {
            let (made, calls) = until(stop);
            assert!(matches!(made, Err(Error::Cancelled)), "at {stop} of {all}");
            assert!(
                calls <= stop + 1 + threads,
                "{calls} calls, {stop} of {all}"
            );
        }
    }
}
