//! The editor of transfer functions: the opacity of each scalar over how often it occurs.

use crate::app::App;
use crate::document::set;
use crate::histogram::Histogram;
use eframe::egui::{self, Color32, EventFilter, Key, Pos2, Rect, Sense, Stroke as Line, Vec2};
use palpate::render::TransferFunction;
use toml_edit::{DocumentMut, Value};

/// Height of the editor of transfer functions.
const EDITOR: f32 = 110.0;
/// How near the pointer takes a point.
const NEAR: f32 = 9.0;
/// The way through the body whose opacity the editor shows, over the body's extent.
const WAY: f64 = 0.1;
/// Opacities are not dragged beyond this.
const DENSE: f64 = 0.995;
/// How far an arrow moves a point, in points of the screen; with Shift, so many times as far.
const STEP: f32 = 2.0;
const STRIDE: f32 = 5.0;

/// What is done to a point by keys.
enum Keyed {
    /// It goes elsewhere, by points of the screen.
    Moved(Vec2),
    /// Another is added after it.
    Added,
    Removed,
}

/// What is done by keys to the point of this id, which has the focus.
fn by_keys(ui: &egui::Ui, id: egui::Id) -> Option<Keyed> {
    let arrows = EventFilter {
        horizontal_arrows: true,
        vertical_arrows: true,
        ..EventFilter::default()
    };
    ui.memory_mut(|m| m.set_focus_lock_filter(id, arrows));
    ui.input(|i| {
        let hits = |key| i.num_presses(key) as f32;
        let by = Vec2::new(
            hits(Key::ArrowRight) - hits(Key::ArrowLeft),
            hits(Key::ArrowDown) - hits(Key::ArrowUp),
        );
        let step = if i.modifiers.shift {
            STRIDE * STEP
        } else {
            STEP
        };
        match by {
            _ if i.key_pressed(Key::Enter) => Some(Keyed::Added),
            _ if i.key_pressed(Key::Delete) => Some(Keyed::Removed),
            by => (by != Vec2::ZERO).then_some(Keyed::Moved(step * by)),
        }
    })
}

impl App {
    /// The opacity of each scalar over how often it occurs: points that can be dragged, added by a
    /// double click, and taken away by a click of the right button; or, of the point that has the
    /// focus, by keys.
    pub(super) fn transfer_editor(&mut self, ui: &mut egui::Ui, range: (f64, f64)) {
        let Some(show) = &self.show else { return };
        let stage = show.stage();
        let field = stage.scalar_field();
        let of = (field.name.clone(), show.version);
        let fresh = |h: &&Histogram| h.of == of && h.range == range;
        if self.histogram.as_ref().filter(fresh).is_none() {
            let values = field.cells.as_ref().unwrap_or(&field.values);
            self.histogram = Some(Histogram::of(values, range, of));
        }
        let (low, high) = show.bounds;
        let way = WAY * (high - low).max_element();
        let transfer = stage.transfer();
        let mut points = transfer.extinction_nodes().to_vec();
        let width = ui.available_width();
        let (rect, response) =
            ui.allocate_exact_size(egui::vec2(width, EDITOR), Sense::click_and_drag());
        let span = (range.1 - range.0).max(f64::MIN_POSITIVE);
        let place = |[s, density]: [f64; 2]| {
            let opacity = -(-density * way).exp_m1();
            Pos2::new(
                rect.left() + rect.width() * ((s - range.0) / span).clamp(0.0, 1.0) as f32,
                rect.bottom() - rect.height() * opacity as f32,
            )
        };
        let point = |at: Pos2| {
            let x = f64::from((at.x - rect.left()) / rect.width()).clamp(0.0, 1.0);
            let y = f64::from((rect.bottom() - at.y) / rect.height()).clamp(0.0, DENSE);
            [range.0 + x * span, -(-y).ln_1p() / way]
        };
        // Only what is changed of it, for others may be beyond what is shown.
        let shifted = |[s, density]: [f64; 2], by: Vec2| {
            let x = f64::from(by.x / rect.width()) * span;
            let y = -(-density * way).exp_m1() - f64::from(by.y / rect.height());
            [
                (s + x).clamp(range.0.min(s), range.1.max(s)),
                match by.y == 0.0 {
                    true => density,
                    false => -(-y.clamp(0.0, DENSE)).ln_1p() / way,
                },
            ]
        };
        let densest = -(-DENSE).ln_1p() / way;
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
        if let Some(histogram) = &self.histogram {
            let bar = rect.width() / histogram.bars.len() as f32;
            for (n, share) in histogram.bars.iter().enumerate() {
                let s = range.0 + span * (n as f64 + 0.5) / histogram.bars.len() as f64;
                let [r, g, b] = transfer
                    .colour(s)
                    .map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8);
                let left = rect.left() + bar * n as f32;
                let top = rect.bottom() - rect.height() * share;
                let bar =
                    Rect::from_min_max(Pos2::new(left, top), Pos2::new(left + bar, rect.bottom()));
                painter.rect_filled(bar, 0.0, Color32::from_rgb(r, g, b).gamma_multiply(0.75));
            }
        }
        let line = Line::new(1.5, ui.visuals().strong_text_color());
        painter.line(points.iter().map(|p| place(*p)).collect(), line);
        for p in &points {
            painter.circle(place(*p), 4.0, ui.visuals().window_fill, line);
        }
        let near = |at: Pos2, points: &[[f64; 2]]| {
            let away = |p: &[f64; 2]| place(*p).distance(at);
            let all = points.iter().enumerate().map(|(n, p)| (n, away(p)));
            let nearest = all.min_by(|a, b| a.1.total_cmp(&b.1));
            nearest.filter(|(_, away)| *away <= NEAR).map(|(n, _)| n)
        };
        let mut changed = false;
        // The point that goes elsewhere, and where to.
        let mut moved = None;
        for n in 0..points.len() {
            let at = place(points[n]);
            let around = Rect::from_center_size(at, Vec2::splat(2.0 * NEAR));
            let own = ui.interact(
                around,
                response.id.with(n),
                Sense::focusable_noninteractive(),
            );
            if !own.has_focus() {
                continue;
            }
            painter.circle_stroke(at, NEAR, ui.visuals().selection.stroke);
            let last = points.len() - 1;
            match by_keys(ui, own.id) {
                Some(Keyed::Moved(by)) => moved = Some((n, shifted(points[n], by))),
                Some(Keyed::Removed) if last > 0 => {
                    points.remove(n);
                    if n == last {
                        ui.memory_mut(|m| m.request_focus(response.id.with(n - 1)));
                    }
                    changed = true;
                }
                // Halfway to the next, or to the one before.
                Some(Keyed::Added) if last > 0 => {
                    let k = n.min(last - 1);
                    let (a, b) = (points[k], points[k + 1]);
                    points.insert(k + 1, [0, 1].map(|c| 0.5 * (a[c] + b[c])));
                    changed = true;
                }
                _ => {}
            }
            break;
        }
        match response.interact_pointer_pos() {
            None => self.dragged = None,
            Some(at) if response.double_clicked() => {
                points.push(point(at));
                points.sort_by(|a, b| a[0].total_cmp(&b[0]));
                changed = true;
            }
            Some(at) if response.secondary_clicked() => {
                if let Some(n) = near(at, &points).filter(|_| points.len() > 1) {
                    points.remove(n);
                    changed = true;
                }
            }
            Some(at) => {
                if response.drag_started() {
                    let begun = ui.input(|i| i.pointer.press_origin()).unwrap_or(at);
                    self.dragged = near(begun, &points);
                }
                let drags = response.dragged();
                let dragged = self.dragged.filter(|_| drags);
                moved = dragged.map(|n| (n, point(at))).or(moved);
            }
        }
        response.on_hover_text(
            "Drag points; double-click to add one, right-click to take one away. By keys: Tab goes from point to point, arrows move it (with Shift, far), Enter adds one after it, Delete takes it away",
        );
        if let Some((n, [s, mut density])) = moved.filter(|(n, _)| *n < points.len()) {
            // What is denser than can be shown stays so while it is dragged aside.
            if density >= densest {
                density = density.max(points[n][1]);
            }
            let before = n.checked_sub(1).map_or(f64::NEG_INFINITY, |n| points[n][0]);
            let after = points.get(n + 1).map_or(f64::INFINITY, |p| p[0]);
            points[n] = [s.clamp(before, after), density];
            changed = true;
        }
        if changed {
            let json = serde_json::json!({
                "colour": transfer.colour_nodes(),
                "extinction": points,
            });
            self.edit_transfer(&json.to_string());
        }
    }

    /// Takes a transfer function over, which is quicker than all looks are where nothing but the inside
    /// goes by it.
    fn edit_transfer(&mut self, json: &str) {
        let change = |t: &mut DocumentMut| set(t, "picture", "transfer", Some(Value::from(json)));
        let alone = self.scene().is_some_and(|scene| {
            let picture = &scene.picture;
            let inside = !matches!(picture.mode.as_deref(), Some("surface" | "skin"));
            inside && picture.region.is_empty() && picture.hide.is_empty()
        });
        if !alone {
            return self.edit_looks("transfer", change);
        }
        let result = TransferFunction::from_json(json).and_then(|transfer| {
            let (Some(document), Some(show)) = (&mut self.document, &mut self.show) else {
                return Ok(());
            };
            document.edit("transfer", change)?;
            show.stage_mut().set_transfer(&transfer)
        });
        self.tell_error(result);
    }
}
