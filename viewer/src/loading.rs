//! Bodies are read, meshed and made ready while the interface goes on.

use crate::document::Document;
use crate::show::{Anew, Show};
use crate::system;
use crate::touches::Touch;
use eframe::egui;
use palpate::Result;
use palpate::gpu::Gpu;
use palpate::mesh::TetMesh;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use web_time::Instant;

/// The body, whose steps wake the window.
fn waking(mut show: Show, context: &egui::Context) -> Show {
    let context = context.clone();
    show.set_waker(Arc::new(move || context.request_repaint()));
    show
}

/// A body that is being made ready.
pub struct Loading {
    /// What is opened.
    pub name: String,
    /// What is open once the body is ready; none where the same body is made anew.
    pub document: Option<Document>,
    /// The text that it is made of.
    pub text: String,
    /// The scene that there was before it was edited so.
    pub before: Option<Document>,
    since: Instant,
    told: Arc<Mutex<(String, f64)>>,
    made: Receiver<Result<Show>>,
}

impl Loading {
    /// Begins to make the body of `document` ready.
    ///
    /// # Errors
    /// What the document has that makes no sense.
    pub fn open(gpu: &Gpu, document: Document, context: &egui::Context) -> Result<Loading> {
        let loading = Loading::begin(gpu, &document, None, context)?;
        Ok(Loading {
            document: Some(document),
            ..loading
        })
    }

    /// The same for the body of a mesh that is there already, with a finger of a radius; the scene was
    /// another one `before`.
    ///
    /// # Errors
    /// As [`Loading::open`].
    pub fn again(
        gpu: &Gpu,
        document: &Document,
        body: (Arc<TetMesh>, f64),
        before: Option<Document>,
        context: &egui::Context,
    ) -> Result<Loading> {
        let loading = Loading::begin(gpu, document, Some(body), context)?;
        Ok(Loading { before, ..loading })
    }

    /// Has the body as it was before the cut that `touch` is.
    pub fn back(
        gpu: &Gpu,
        name: String,
        anew: Anew,
        touch: Arc<Touch>,
        context: &egui::Context,
    ) -> Loading {
        let (send, made) = channel();
        let (gpu, context) = (gpu.clone(), context.clone());
        system::later(move || {
            let Touch::Cut(_, before) = touch.as_ref() else {
                return;
            };
            let show = anew.back(&gpu, before).map(|show| waking(show, &context));
            let _ = send.send(show);
            context.request_repaint();
        });
        Loading {
            name,
            document: None,
            // It looks as it was made, and is to look as the scene has it now.
            text: String::new(),
            before: None,
            since: Instant::now(),
            told: Arc::new(Mutex::new(("undoing the cut".to_owned(), 1.0))),
            made,
        }
    }

    /// Whether something else is opened, and not the same body made anew.
    pub fn opens(&self) -> bool {
        self.document.is_some()
    }

    fn begin(
        gpu: &Gpu,
        document: &Document,
        body: Option<(Arc<TetMesh>, f64)>,
        context: &egui::Context,
    ) -> Result<Loading> {
        let scene = document.scene()?;
        let (mesh, radius) = body.unzip();
        let (send, made) = channel();
        let told = Arc::new(Mutex::new(("reading".to_owned(), 0.0)));
        let (gpu, context, tell) = (gpu.clone(), context.clone(), told.clone());
        system::later(move || {
            let progress = |what: &str, share: f64| {
                *tell.lock().unwrap_or_else(PoisonError::into_inner) = (what.to_owned(), share);
            };
            let mesh = match mesh {
                Some(mesh) => Ok(mesh),
                // Scenes of several bodies and of grids make their own.
                None if !scene.body.is_empty() || scene.grid.is_some() => Ok(Arc::default()),
                None => scene.mesh.load_telling(&progress).map(Arc::new),
            };
            progress("making it ready", 1.0);
            let show = mesh.and_then(|mesh| Show::new(&gpu, &scene, mesh, radius));
            let show = show.map(|show| waking(show, &context));
            // Who cancelled it waits for nothing.
            let _ = send.send(show);
            context.request_repaint();
        });
        Ok(Loading {
            name: document.name.clone(),
            document: None,
            text: document.text(),
            before: None,
            since: Instant::now(),
            told,
            made,
        })
    }

    /// The body, once it is ready.
    pub fn ready(&self) -> Option<Result<Show>> {
        match self.made.try_recv() {
            Ok(made) => Some(made),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(palpate::Error::Input(
                "opening it ended without a word; this is a mistake in the program".into(),
            ))),
        }
    }

    /// What is being done, the part of it that is done, and for how long, s.
    pub fn progress(&self) -> (String, f64, f64) {
        let (what, share) = self
            .told
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        (what, share, self.since.elapsed().as_secs_f64())
    }
}
