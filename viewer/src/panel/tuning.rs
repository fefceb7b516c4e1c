//! Panel that finds and applies the cheapest settings that meet an error bound.

use crate::app::App;
use crate::document::set;
use crate::loading::BackgroundTask;
use eframe::egui;
use palpate::tune::{EntryValue, TuneTarget, Tuned, tune};
use toml_edit::{DocumentMut, Value};

/// Requirements and results of tuning.
pub(crate) struct Tuning {
    /// Maximum error, in per cent.
    error: f64,
    /// Required pictures per second; 0 for no requirement.
    fps: f64,
    /// Simulated seconds that are compared with the reference.
    seconds: f64,
    work: Option<BackgroundTask<Tuned>>,
    found: Option<Box<Tuned>>,
}

impl Default for Tuning {
    fn default() -> Tuning {
        Tuning {
            error: 1.0,
            fps: 0.0,
            seconds: 0.5,
            work: None,
            found: None,
        }
    }
}

impl App {
    /// Runs tuning on a thread, shows the results and applies them.
    pub(super) fn tuning(&mut self, ui: &mut egui::Ui, context: &egui::Context) {
        let Some(scene) = self.scene() else { return };
        let field = |value, range, suffix| {
            egui::DragValue::new(value)
                .range(range)
                .speed(0.05)
                .suffix(suffix)
        };
        let own = &mut self.tuning;
        egui::Grid::new("tuning").num_columns(2).show(ui, |ui| {
            ui.label("Maximum error");
            ui.add(field(&mut own.error, 0.01..=50.0, " %"));
            ui.end_row();
            ui.label("Frames per second");
            let any = if own.fps == 0.0 { " (any)" } else { "" };
            ui.add(field(&mut own.fps, 0.0..=240.0, any));
            ui.end_row();
            ui.label("Compared duration");
            ui.add(field(&mut own.seconds, 0.02..=60.0, " s"));
            ui.end_row();
        });
        if scene.solver.name.is_none() {
            ui.weak("No [solver] name in the scene: only rendering is tuned");
        }
        let done = own.work.as_ref().and_then(BackgroundTask::try_take);
        let mut said = None;
        if let Some(done) = done {
            own.work = None;
            match done {
                Ok(tuned) => own.found = Some(Box::new(tuned)),
                Err(why) => said = Some(why.to_string()),
            }
        }
        let (mut begins, mut ends, mut applies) = (false, false, false);
        match &own.work {
            Some(work) => {
                let (what, share, seconds) = work.progress();
                let told = format!("{what}, {seconds:.0} s");
                ui.add(egui::ProgressBar::new(share as f32).text(told));
                ends = ui.button("Cancel").clicked();
                context.request_repaint_after(std::time::Duration::from_millis(200));
            }
            None => begins = ui.button("Find settings").clicked(),
        }
        if let Some(found) = &own.found {
            applies = show_found(ui, found);
        }
        if ends {
            own.work = None;
        }
        if begins {
            let wanted = TuneTarget {
                error: 0.01 * own.error,
                fps: Some(own.fps).filter(|fps| *fps > 0.0),
                seconds: own.seconds,
            };
            own.found = None;
            let gpu = self.gpu.clone();
            own.work = Some(BackgroundTask::spawn(
                "starting",
                context,
                move |progress| tune(&gpu, &scene, &wanted, progress),
            ));
            // Pause the simulation, so that it does not disturb the timing.
            if let Some(show) = &mut self.show {
                show.playing = false;
            }
        }
        if let Some(why) = said {
            self.status = (format!("tuning failed: {why}"), true);
        }
        if applies && let Some(found) = self.tuning.found.take() {
            self.edit_body("what was found", context, |t| apply(t, &found));
            if let Some(size) = found.scene.picture.size {
                self.picture = size;
            }
        }
    }
}

/// Shows what was found. Returns whether it is to be applied.
fn show_found(ui: &mut egui::Ui, found: &Tuned) -> bool {
    for note in &found.notes {
        ui.label(note);
    }
    if !found.target_met {
        ui.weak("No settings meet the requirements; these come closest");
    }
    ui.button("Apply").clicked()
}

/// Writes the tuned settings into the text of a scene.
fn apply(text: &mut DocumentMut, tuned: &Tuned) {
    for change in tuned.changes() {
        let Some(key) = change.key else {
            text.remove(change.table);
            continue;
        };
        let value = change.value.map(|value| match value {
            EntryValue::Text(text) => Value::from(text),
            EntryValue::Number(number) => Value::from(number),
            EntryValue::Count(count) => Value::from(count),
            EntryValue::Counts(counts) => Value::Array(counts.into_iter().collect()),
        });
        set(text, change.table, key, value);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use palpate::gpu::Gpu;
    use palpate::scene::Scene;
    use palpate::tune::Body;

    #[test]
    fn tuned_settings_are_written_to_scene() {
        let text = "# A bar.\n[mesh]\ngenerate = \"bar\"\n[material]\nstiffness = 3e4\n[solver]\nname = \"implicit\"\n\
            dt = 0.01\niterations = 40\n[cage]\nnodes = 60\n[[pin]]\naxis = \"x\"\nbelow = 0.0\n[picture]\nsize = [64, 48]\n";
        let scene = Scene::parse(text).unwrap();
        let wanted = TuneTarget {
            error: 0.2,
            fps: None,
            seconds: 0.1,
        };
        let gpu = Gpu::new().unwrap();
        let tuned = tune(&gpu, &scene, &wanted, &palpate::no_progress).unwrap();
        let mut document: DocumentMut = text.parse().unwrap();
        apply(&mut document, &tuned);
        let applied = Scene::parse(&document.to_string()).unwrap();
        let (own, found) = (&applied.solver, &tuned.scene.solver);
        assert_eq!(
            (&own.name, own.dt, own.tolerance),
            (&found.name, found.dt, found.tolerance)
        );
        let body = tuned.motion.map(|motion| motion.point.body);
        let nodes = document.get("cage").map(|cage| &cage["nodes"]);
        let nodes = nodes.and_then(|n| n.as_integer());
        match body {
            Some(Body::Cage(count)) => assert_eq!(nodes, i64::try_from(count).ok()),
            _ => assert_eq!(nodes, None),
        }
        assert_eq!(applied.picture.accuracy, tuned.scene.picture.accuracy);
        assert!(document.to_string().starts_with("# A bar.\n"));
        assert!(!document.to_string().contains("iterations"));
        let stopped = tune(&gpu, &scene, &wanted, &|_, _| {
            std::ops::ControlFlow::Break(())
        });
        assert!(matches!(stopped, Err(palpate::Error::Cancelled)));
    }
}
