//! The section through the body under the finger, drawn on a background thread.

use super::{BodySession, PressError};
use crate::loading::BackgroundTask;
use eframe::egui;
use palpate::Result;
use palpate::physics::BodyField;
use palpate::press::PressPicture;
use palpate::render::Background;
use std::time::Duration;
use web_time::Instant;

/// Time between two sections of a press that moves, over the time that one takes: the steps of the press
/// need the cores.
const PAUSE: u32 = 3;

/// The picture of a section.
pub struct SectionPixels {
    /// Red, green, blue and opacity of each pixel.
    pub rgba: Vec<u8>,
    /// Width and height.
    pub size: [u32; 2],
}

/// What a section is drawn with.
#[derive(Clone, Copy, PartialEq)]
pub struct SectionOptions {
    /// Width and height, in pixels.
    pub size: [u32; 2],
    /// Field of the isolines on the cut.
    pub lines: Option<BodyField>,
}

/// The section of the present press.
#[derive(Default)]
pub(super) struct PressSection {
    /// `None` while no section is shown.
    options: Option<SectionOptions>,
    /// The last state that was drawn, for what its successors share with it.
    picture: Option<PressPicture>,
    /// What the last drawn section shows.
    drawn: Option<(
        SectionOptions,
        Option<palpate::press::PressSample>,
        Option<f64>,
    )>,
    /// A state to be drawn.
    fresh: Option<PressPicture>,
    task: Option<BackgroundTask<SectionPixels>>,
    /// When the last drawing began, and how long it took.
    began: Option<Instant>,
    took: Duration,
    pixels: Option<SectionPixels>,
}

impl BodySession {
    /// Draws the section of the press with `options` in the background, if it has changed; `None` shows
    /// none. Returns it, if it is new.
    ///
    /// # Errors
    /// As [`PressPicture::new`], and [`PressPicture::draw`].
    pub fn update_section(
        &mut self,
        options: Option<SectionOptions>,
        context: &egui::Context,
    ) -> Result<Option<SectionPixels>> {
        let pressed = self.force().is_some();
        self.section.options = options.filter(|_| pressed);
        let Some(options) = self.section.options else {
            // What the next press shares with this one is kept.
            self.section = PressSection {
                picture: self.section.picture.take(),
                ..PressSection::default()
            };
            return Ok(None);
        };
        if let Some(task) = &self.section.task {
            let Some(done) = task.try_take() else {
                return Ok(None);
            };
            self.section.task = None;
            self.section.took = self.section.began.map_or(Duration::ZERO, |b| b.elapsed());
            self.section.pixels = Some(done?);
        }
        if !self.under_way {
            self.take_section()?;
        }
        if let Some(picture) = self.section.fresh.take() {
            self.draw_section(picture, options, context);
        }
        Ok(self.section.pixels.take())
    }

    /// Takes the present state for the section; call between two steps.
    pub(super) fn take_section(&mut self) -> Result<()> {
        let idle = self.press.is_some() && self.section.task.is_none();
        let Some(options) = self.section.options.filter(|_| idle) else {
            return Ok(());
        };
        let now = Some((
            options,
            self.samples().last().copied(),
            self.section_error(),
        ));
        let moves = self.finger_moves();
        let own = &self.section;
        let early = own
            .began
            .is_some_and(|began| began.elapsed() < own.took * (1 + PAUSE));
        // In a browser, the drawing would delay the next step.
        let waits = moves && (early || cfg!(target_arch = "wasm32"));
        if own.drawn == now || own.fresh.is_some() || waits {
            return Ok(());
        }
        if let Ok(session) = &self.fingertip {
            let earlier = self.section.picture.as_ref();
            let picture = PressPicture::new(&mut self.stage, session, options.lines, earlier)?;
            self.section.fresh = Some(picture);
            self.section.drawn = now;
        }
        Ok(())
    }

    fn draw_section(
        &mut self,
        picture: PressPicture,
        options: SectionOptions,
        context: &egui::Context,
    ) {
        let error = self.section_error();
        self.section.picture = Some(picture.clone());
        self.section.began = Some(Instant::now());
        let work = move |_: palpate::ProgressFn<'_>| {
            let image = picture.draw(options.size, Background::Gradient, error)?;
            Ok(SectionPixels {
                rgba: image.rgba8(Background::Gradient),
                size: options.size,
            })
        };
        self.section.task = Some(BackgroundTask::spawn("drawing the section", context, work));
    }

    /// Returns the error of the force at the present depth, N, if it is known.
    fn section_error(&self) -> Option<f64> {
        match self.press_error() {
            Some(Ok(PressError {
                parts,
                is_of_another_depth: false,
                ..
            })) => Some(parts.total()),
            _ => None,
        }
    }
}
