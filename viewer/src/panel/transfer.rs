//! Editor of the transfer function: opacity over scalar, on a histogram.

use crate::app::App;
use crate::document::set;
use crate::histogram::Histogram;
use eframe::egui::{self, Color32, EventFilter, Key, Pos2, Rect, Sense, Stroke as Line, Vec2};
use palpate::render::{AbsoluteTransferFunction, TransferFunction};
use toml_edit::{DocumentMut, Value};

/// Height of the editor, in points.
const EDITOR: f32 = 110.0;
/// Picking distance of a point, in points.
const POINT_RADIUS: f32 = 9.0;
/// Path length for which the editor shows the opacity, relative to the body's extent.
const REFERENCE_DEPTH: f64 = 0.1;
/// Maximum opacity of a dragged point.
const MAX_OPACITY: f64 = 0.995;
/// Step of an arrow key in screen points; with Shift, multiplied by the factor below.
const STEP: f32 = 2.0;
const LARGE_STEP: f32 = 5.0;

/// A control point: scalar and extinction.
type Point = [f64; 2];

/// Coordinates of the plot: scalars from left to right, and upwards the opacity of a reference path
/// length.
struct Plot {
    rect: Rect,
    range: (f64, f64),
    way: f64,
}

impl Plot {
    fn span(&self) -> f64 {
        (self.range.1 - self.range.0).max(f64::MIN_POSITIVE)
    }

    fn opacity(&self, density: f64) -> f64 {
        -(-density * self.way).exp_m1()
    }

    fn density(&self, opacity: f64) -> f64 {
        -(-opacity.clamp(0.0, MAX_OPACITY)).ln_1p() / self.way
    }

    /// Returns the screen position of a point.
    fn place(&self, [s, density]: Point) -> Pos2 {
        let share = ((s - self.range.0) / self.span()).clamp(0.0, 1.0);
        let rect = self.rect;
        Pos2::new(
            rect.left() + rect.width() * share as f32,
            rect.bottom() - rect.height() * self.opacity(density) as f32,
        )
    }

    /// Returns the control point at a screen position.
    fn point(&self, at: Pos2) -> Point {
        let rect = self.rect;
        let share = f64::from((at.x - rect.left()) / rect.width()).clamp(0.0, 1.0);
        let opacity = f64::from((rect.bottom() - at.y) / rect.height());
        [self.range.0 + share * self.span(), self.density(opacity)]
    }

    /// Returns a point shifted on the screen. An unchanged coordinate is kept, as it may be outside
    /// the plot.
    fn shifted(&self, [s, density]: Point, by: Vec2) -> Point {
        let x = f64::from(by.x) / f64::from(self.rect.width()) * self.span();
        let opacity = self.opacity(density) - f64::from(by.y) / f64::from(self.rect.height());
        [
            (s + x).clamp(self.range.0.min(s), self.range.1.max(s)),
            match by.y == 0.0 {
                true => density,
                false => self.density(opacity),
            },
        ]
    }

    /// Moves a point, without passing its neighbours.
    fn put(&self, points: &mut [Point], n: usize, [s, mut density]: Point) {
        // Extinctions above the plotted maximum are kept while a point is moved sideways.
        if density >= self.density(MAX_OPACITY) {
            density = density.max(points[n][1]);
        }
        let before = n.checked_sub(1).map_or(f64::NEG_INFINITY, |n| points[n][0]);
        let after = points.get(n + 1).map_or(f64::INFINITY, |p| p[0]);
        points[n] = [s.clamp(before, after), density];
    }

    /// Draws the bars of a histogram in the colours of `transfer`.
    fn draw_histogram(
        &self,
        painter: &egui::Painter,
        histogram: &Histogram,
        transfer: &AbsoluteTransferFunction,
    ) {
        let bar = self.rect.width() / histogram.bars.len() as f32;
        for (n, share) in histogram.bars.iter().enumerate() {
            let s = self.range.0 + self.span() * (n as f64 + 0.5) / histogram.bars.len() as f64;
            let [r, g, b] = transfer
                .colour(s)
                .map(|c| (255.0 * c.clamp(0.0, 1.0)) as u8);
            let left = self.rect.left() + bar * n as f32;
            let top = self.rect.bottom() - self.rect.height() * share;
            let bar = Rect::from_min_max(
                Pos2::new(left, top),
                Pos2::new(left + bar, self.rect.bottom()),
            );
            painter.rect_filled(bar, 0.0, Color32::from_rgb(r, g, b).gamma_multiply(0.75));
        }
    }
}

/// Keyboard actions on a point.
enum KeyAction {
    /// Moves it, in screen points.
    Moved(Vec2),
    /// Adds a point halfway to the next, or, for the last one, to the previous.
    Added,
    Removed,
}

impl KeyAction {
    /// Applies the action, if possible. Returns the point that gets the focus.
    fn done(self, plot: &Plot, points: &mut Vec<Point>, n: usize) -> Option<usize> {
        let last = points.len() - 1;
        match self {
            KeyAction::Moved(by) => {
                let to = plot.shifted(points[n], by);
                plot.put(points, n, to);
            }
            _ if last == 0 => return None,
            KeyAction::Added => {
                let k = n.min(last - 1);
                let (a, b) = (points[k], points[k + 1]);
                points.insert(k + 1, [0, 1].map(|c| 0.5 * (a[c] + b[c])));
            }
            KeyAction::Removed => {
                points.remove(n);
            }
        }
        Some(n.min(points.len() - 1))
    }
}

/// Returns the keyboard action for the focused point of this id.
fn by_keys(ui: &egui::Ui, id: egui::Id) -> Option<KeyAction> {
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
            LARGE_STEP * STEP
        } else {
            STEP
        };
        match by {
            _ if i.key_pressed(Key::Enter) => Some(KeyAction::Added),
            _ if i.key_pressed(Key::Delete) => Some(KeyAction::Removed),
            by => (by != Vec2::ZERO).then_some(KeyAction::Moved(step * by)),
        }
    })
}

/// Applies the keys to the point that has the focus, if any. Returns whether it changed `points`.
fn edit_focused(
    ui: &egui::Ui,
    painter: &egui::Painter,
    plot: &Plot,
    editor: egui::Id,
    points: &mut Vec<Point>,
) -> bool {
    let mut changed = false;
    for n in 0..points.len() {
        let at = plot.place(points[n]);
        let around = Rect::from_center_size(at, Vec2::splat(2.0 * POINT_RADIUS));
        // Not `with(n)` alone: the tooltip of the editor takes these ids.
        let id = |n: usize| editor.with(("point", n));
        let own = ui.interact(around, id(n), Sense::focusable_noninteractive());
        if !own.has_focus() {
            continue;
        }
        painter.circle_stroke(at, POINT_RADIUS, ui.visuals().selection.stroke);
        let keyed = by_keys(ui, own.id);
        if let Some(next) = keyed.and_then(|keyed| keyed.done(plot, points, n)) {
            changed = true;
            if next != n {
                ui.memory_mut(|m| m.request_focus(id(next)));
            }
        }
        break;
    }
    changed
}

impl App {
    /// Draws the editor: opacity over scalar, on the histogram. Points are dragged, added by a double
    /// click and removed by a right click; keys edit the focused point.
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
        let way = REFERENCE_DEPTH * (high - low).max_element();
        let transfer = stage.transfer();
        let mut points = transfer.extinction_nodes().to_vec();
        let width = ui.available_width();
        let (rect, response) =
            ui.allocate_exact_size(egui::vec2(width, EDITOR), Sense::click_and_drag());
        let plot = Plot { rect, range, way };
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
        if let Some(histogram) = &self.histogram {
            plot.draw_histogram(&painter, histogram, &transfer);
        }
        let line = Line::new(1.5, ui.visuals().strong_text_color());
        painter.line(points.iter().map(|p| plot.place(*p)).collect(), line);
        for p in &points {
            painter.circle(plot.place(*p), 4.0, ui.visuals().window_fill, line);
        }
        let near = |at: Pos2, points: &[Point]| {
            let away = |p: &Point| plot.place(*p).distance(at);
            let all = points.iter().enumerate().map(|(n, p)| (n, away(p)));
            let nearest = all.min_by(|a, b| a.1.total_cmp(&b.1));
            nearest
                .filter(|(_, away)| *away <= POINT_RADIUS)
                .map(|(n, _)| n)
        };
        let mut changed = edit_focused(ui, &painter, &plot, response.id, &mut points);
        match response.interact_pointer_pos() {
            None => self.dragged = None,
            Some(at) if response.double_clicked() => {
                points.push(plot.point(at));
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
                let drags = |n: &usize| response.dragged() && *n < points.len();
                if let Some(n) = self.dragged.filter(drags) {
                    plot.put(&mut points, n, plot.point(at));
                    changed = true;
                }
            }
        }
        response.on_hover_text(
            "Drag a point to move it, double-click to add one, right-click to remove one. Keys: Tab selects the next point, arrows move it (Shift: larger steps), Enter adds one after it, Delete removes it",
        );
        if changed {
            let json = serde_json::json!({
                "colour": transfer.colour_nodes(),
                "extinction": points,
            });
            self.edit_transfer(&json.to_string());
        }
    }

    /// Applies a transfer function. If it affects only volume rendering, this avoids a full update of
    /// the appearance.
    fn edit_transfer(&mut self, json: &str) {
        let change = |t: &mut DocumentMut| set(t, "picture", "transfer", Some(Value::from(json)));
        let alone = self.scene().is_some_and(|scene| {
            let picture = &scene.picture;
            let inside = !matches!(picture.mode.as_deref(), Some("surface" | "skin"));
            inside && picture.region.is_empty() && picture.hide.is_empty()
        });
        if !alone {
            return self.edit_appearance("transfer", change);
        }
        let result = TransferFunction::from_json(json).and_then(|transfer| {
            let (Some(document), Some(show)) = (&mut self.document, &mut self.show) else {
                return Ok(());
            };
            document.edit("transfer", change)?;
            show.stage_mut().set_transfer(&transfer)
        });
        self.show_error(result);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const AXIS: [f64; 3] = [-10.0, 20.0, 50.0];

    fn plot() -> Plot {
        Plot {
            rect: Rect::from_min_size(Pos2::new(5.0, 7.0), Vec2::new(200.0, 100.0)),
            range: (-20.0, 80.0),
            way: 0.1,
        }
    }

    fn keyed(
        keys: impl IntoIterator<Item = KeyAction>,
        points: &mut Vec<Point>,
        n: usize,
    ) -> usize {
        let on = |n, keyed: KeyAction| keyed.done(&plot(), points, n).unwrap_or(n);
        keys.into_iter().fold(n, on)
    }

    #[test]
    fn arrow_keys_move_point_between_neighbours() {
        let start: Vec<Point> = AXIS.iter().map(|s| [*s, 3.0]).collect();
        let mut points = start.clone();
        keyed([KeyAction::Moved(Vec2::new(10.0, -10.0))], &mut points, 1);
        assert!((points[1][0] - 25.0).abs() < 1e-9, "{points:?}");
        let gained = plot().opacity(points[1][1]) - plot().opacity(3.0);
        assert!((gained - 0.1).abs() < 1e-6, "{gained}");
        // The point does not pass the next one or leave the plot; the others are unchanged.
        let far = || KeyAction::Moved(Vec2::new(500.0, 500.0));
        keyed([far()], &mut points, 1);
        assert_eq!(points, [start[0], [50.0, 0.0], start[2]]);
        keyed([far()], &mut points, 2);
        assert_eq!(points[2], [80.0, 0.0]);
    }

    #[test]
    fn arrow_keys_preserve_unchanged_coordinate_outside_plot() {
        let dense = 1e4;
        let mut points = vec![[-10.0, 1.0], [200.0, dense]];
        keyed([KeyAction::Moved(Vec2::new(0.0, -2.0))], &mut points, 1);
        assert_eq!(points[1], [200.0, dense]);
        keyed([KeyAction::Moved(Vec2::new(-20.0, 0.0))], &mut points, 1);
        assert_eq!(points[1], [190.0, dense]);
        keyed([KeyAction::Moved(Vec2::new(0.0, 2.0))], &mut points, 1);
        assert_eq!(points[1][0], 190.0);
        assert!(points[1][1] < dense, "{points:?}");
    }

    #[test]
    fn keys_add_and_remove_points() {
        let mut points = vec![[0.0, 1.0], [40.0, 3.0]];
        assert_eq!(keyed([KeyAction::Added], &mut points, 0), 0);
        assert_eq!(points, [[0.0, 1.0], [20.0, 2.0], [40.0, 3.0]]);
        // At the last point, the new one is inserted before it, so the order is preserved.
        assert_eq!(keyed([KeyAction::Added], &mut points, 2), 2);
        assert_eq!(points[2], [30.0, 2.5]);
        assert_eq!(keyed([KeyAction::Removed], &mut points, 3), 2);
        assert_eq!(
            keyed([KeyAction::Removed, KeyAction::Removed], &mut points, 2),
            0
        );
        // The last remaining point cannot be removed.
        assert!(KeyAction::Removed.done(&plot(), &mut points, 0).is_none());
        assert_eq!(points, [[0.0, 1.0]]);
    }
}
