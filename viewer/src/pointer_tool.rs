//! Pointer interaction in the picture: camera motion and manipulation of the body.

use crate::app::App;
use crate::handles::HandlePart;
use crate::settings::MouseBindings;
use crate::viewport::Viewport;
use eframe::egui::{self, Modifiers, PointerButton, Pos2, Response};
use glam::{DVec2, DVec3};
use palpate::Result;
use palpate::mesh::Blade;
use palpate::render::Pick;
use std::time::Duration;
use web_time::Instant;

/// Maximum time since the last frame that a frame waits for the running step during an interaction.
const MAX_STEP_WAIT: Duration = Duration::from_millis(50);

/// Tool of the left button.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointerTool {
    /// Orbits the body.
    #[default]
    Look,
    /// Presses with the finger.
    Press,
    /// Grabs and pulls.
    Grab,
    /// Cuts along a stroke.
    Cut,
    /// Pins the nodes under the stroke.
    Pin,
    /// Shows values at a point.
    Probe,
    /// Measures the distance between two points.
    Ruler,
}

impl PointerTool {
    /// All tools: name, key and instructions.
    pub const ALL: [(PointerTool, &'static str, egui::Key, &'static str); 7] = [
        (
            PointerTool::Look,
            "Look",
            egui::Key::Num1,
            "Drag to orbit the body",
        ),
        (
            PointerTool::Press,
            "Press",
            egui::Key::Num2,
            "Press the button on the body, then drag away or turn the wheel to increase the depth",
        ),
        (
            PointerTool::Grab,
            "Grab",
            egui::Key::Num3,
            "Drag to grab and pull the body",
        ),
        (
            PointerTool::Cut,
            "Cut",
            egui::Key::Num4,
            "Draw a stroke across the body, starting on it",
        ),
        (
            PointerTool::Pin,
            "Pin",
            egui::Key::Num5,
            "Paint the nodes to pin",
        ),
        (
            PointerTool::Probe,
            "Probe",
            egui::Key::Num6,
            "Click on the body to show its values there",
        ),
        (
            PointerTool::Ruler,
            "Ruler",
            egui::Key::Num7,
            "Drag between two points of the body to measure their distance",
        ),
    ];
}

/// The active pointer gesture.
#[derive(Clone, Debug, Default)]
pub enum PointerGesture {
    /// Nothing.
    #[default]
    Idle,
    /// Moves the camera.
    View(CameraMotion),
    /// Presses: start point and depth set by the wheel, in file units.
    Press(Pos2, f64),
    /// Pulls: start point, and file units per interface point.
    Grab(Pos2, f64),
    /// Cuts along a stroke from a point on the surface.
    Cut(Vec<Pos2>, DVec3),
    /// Pins nodes.
    Pin,
    /// Measures a distance.
    Ruler,
    /// Moves or tilts the plane of this index by its handle.
    Plane(usize, HandlePart),
}

/// Camera motions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraMotion {
    /// Orbits the body.
    Orbit,
    /// Pans.
    Pan,
    /// Zooms.
    Zoom,
    /// Rolls about the line of sight.
    Roll,
}

/// Returns the camera motion of a button.
fn move_of(habit: MouseBindings, button: PointerButton, held: Modifiers) -> Option<CameraMotion> {
    Some(match (habit, button) {
        (MouseBindings::ParaView, PointerButton::Primary) if held.shift => CameraMotion::Roll,
        (MouseBindings::Slicer, PointerButton::Primary) if held.shift => CameraMotion::Pan,
        (MouseBindings::ParaView, PointerButton::Primary) if held.command => CameraMotion::Zoom,
        (MouseBindings::Slicer, PointerButton::Primary) if held.command => CameraMotion::Roll,
        (_, PointerButton::Primary) => CameraMotion::Orbit,
        (_, PointerButton::Middle) => CameraMotion::Pan,
        (_, PointerButton::Secondary) => CameraMotion::Zoom,
        _ => return None,
    })
}

impl App {
    /// Handles pointer input in the picture.
    pub(crate) fn handle_pointer(&mut self, ui: &egui::Ui, response: &Response, area: Viewport) {
        let (held, scroll, zoom, turned) = ui.input(|i| {
            (
                i.modifiers,
                i.smooth_scroll_delta().y,
                i.zoom_delta(),
                i.multi_touch()
                    .map(|t| (t.translation_delta, t.rotation_delta)),
            )
        });
        let height = f64::from(area.rect.height().max(1.0));
        if response.hovered() || response.dragged() {
            if let (PointerGesture::Press(_, wheel), Some(show)) = (&mut self.stroke, &self.show)
                && scroll != 0.0
            {
                *wheel += 0.004 * f64::from(scroll) * show.radius;
            } else if scroll != 0.0 {
                self.orbit.zoom((0.002 * f64::from(scroll)).exp());
            }
            if zoom != 1.0 {
                self.orbit.zoom(f64::from(zoom));
            }
            if let Some((moved, angle)) = turned {
                self.orbit
                    .pan(DVec2::new(f64::from(moved.x), f64::from(moved.y)) / height);
                self.orbit.roll(-f64::from(angle));
            }
        }
        let Some(at) = response.interact_pointer_pos() else {
            self.end_gesture();
            return;
        };
        let begun = [
            PointerButton::Primary,
            PointerButton::Middle,
            PointerButton::Secondary,
        ]
        .into_iter()
        .find(|b| ui.input(|i| i.pointer.button_pressed(*b)));
        if let Some(button) = begun
            && matches!(self.stroke, PointerGesture::Idle)
        {
            let handle = match button {
                PointerButton::Primary => self.handle_at(at, area),
                _ => None,
            };
            let touches = button == PointerButton::Primary
                && self.pointer_tool != PointerTool::Look
                && !held.shift
                && !held.command;
            let result = match (handle, touches) {
                (Some((number, hold)), _) => {
                    self.stroke = PointerGesture::Plane(number, hold);
                    Ok(())
                }
                (None, true) => self.touch(at, area),
                (None, false) => {
                    let moves = move_of(self.settings.mouse_bindings, button, held);
                    self.stroke = moves.map_or(PointerGesture::Idle, PointerGesture::View);
                    Ok(())
                }
            };
            self.show_error(result);
        }
        if response.drag_delta() != egui::Vec2::ZERO || scroll != 0.0 {
            let moved = response.drag_delta();
            let moved = DVec2::new(f64::from(moved.x), f64::from(moved.y)) / height;
            let result = self.draw_on(at, moved, area);
            self.show_error(result);
        }
        if ui.input(|i| i.pointer.any_released()) {
            self.end_gesture();
        }
    }

    /// Picks the body at a point of the picture.
    fn picked(&mut self, at: Pos2, area: Viewport) -> Result<Option<Pick>> {
        let (camera, pixel) = (self.orbit.camera(), area.pixel(at));
        match &mut self.show {
            Some(show) => show.pick(&camera, pixel, area.size),
            None => Ok(None),
        }
    }

    /// Starts the tool's gesture at a point of the picture; outside the body the camera orbits.
    fn touch(&mut self, at: Pos2, area: Viewport) -> Result<()> {
        let Some(pick) = self.picked(at, area)? else {
            self.stroke = PointerGesture::View(CameraMotion::Orbit);
            return Ok(());
        };
        let edits = self.edits();
        let eye = self.orbit.camera().eye;
        let back = self.orbit.turn * DVec3::Z;
        let away = match self.orbit.orthographic {
            true => 1.0,
            false => (eye - pick.point).dot(back) / self.orbit.distance,
        };
        let point = self.orbit.height() * away / f64::from(area.rect.height().max(1.0));
        let Some(show) = &mut self.show else {
            return Ok(());
        };
        match self.pointer_tool {
            PointerTool::Look => {}
            PointerTool::Press => {
                show.press(&pick)?;
                self.stroke = PointerGesture::Press(at, 0.0);
            }
            PointerTool::Grab => {
                show.grab(&pick)?;
                self.stroke = PointerGesture::Grab(at, point);
            }
            PointerTool::Cut => self.stroke = PointerGesture::Cut(vec![at], pick.point),
            PointerTool::Pin => {
                let count = show.pin(&pick, edits, true)?;
                self.set_status(format!("{count} nodes pinned"));
                self.stroke = PointerGesture::Pin;
            }
            PointerTool::Probe => self.probe(&pick),
            PointerTool::Ruler => {
                self.ruler = Some([pick.point; 2]);
                self.stroke = PointerGesture::Ruler;
            }
        }
        Ok(())
    }

    /// Presses the finger on the body at a point of the picture (both coordinates from 0 to 1), to
    /// `depth` metres; an active press continues at its point.
    ///
    /// # Errors
    /// [`Error::Input`] if there is no body at this point; the errors of [`BodySession::press`](crate::body_session::BodySession::press).
    #[cfg(target_arch = "wasm32")]
    pub(crate) fn press_at(&mut self, [x, y]: [f64; 2], depth: f64) -> Result<()> {
        let nothing =
            || palpate::Error::Input("no body at this point of the picture to press on".into());
        let area = self.area.ok_or_else(nothing)?;
        if self.show.as_ref().is_some_and(|s| s.depth().is_none()) {
            let at = area.rect.min + area.rect.size() * egui::vec2(x as f32, y as f32);
            let pick = self.picked(at, area)?.ok_or_else(nothing)?;
            if let Some(show) = &mut self.show {
                show.press(&pick)?;
            }
        }
        if let Some(show) = &mut self.show {
            show.press_to(depth / show.unit);
        }
        Ok(())
    }

    /// Retracts the finger.
    #[cfg(target_arch = "wasm32")]
    pub(crate) fn release_press(&mut self) {
        if let Some(show) = &mut self.show {
            show.retract();
        }
    }

    /// Requests a frame.
    #[cfg(target_arch = "wasm32")]
    pub(crate) fn repaint(&self) {
        self.context.request_repaint();
    }

    /// Updates the press or pull to the pointer position. Returns until when this frame may wait for
    /// the running step: frames that show no new state take computing time from the step.
    pub(crate) fn update_interaction(&mut self, context: &egui::Context) -> Option<Instant> {
        if !matches!(
            self.stroke,
            PointerGesture::Press(..) | PointerGesture::Grab(..)
        ) {
            return None;
        }
        let at = context.input(|i| i.pointer.latest_pos());
        if let (Some(at), Some(area)) = (at, self.area) {
            let done = self.draw_on(at, DVec2::ZERO, area);
            self.show_error(done);
        }
        Some(self.frames.done + MAX_STEP_WAIT)
    }

    /// Continues the gesture: `moved` is in fractions of the picture's height.
    fn draw_on(&mut self, at: Pos2, moved: DVec2, area: Viewport) -> Result<()> {
        if matches!(self.stroke, PointerGesture::View(_)) {
            self.frames.moved.get_or_insert_with(Instant::now);
        }
        match &mut self.stroke {
            PointerGesture::Idle => {}
            PointerGesture::View(CameraMotion::Orbit) => self.orbit.orbit(moved),
            PointerGesture::View(CameraMotion::Pan) => self.orbit.pan(moved),
            PointerGesture::View(CameraMotion::Zoom) => self.orbit.zoom((-3.0 * moved.y).exp()),
            PointerGesture::View(CameraMotion::Roll) => self.orbit.roll(3.0 * (moved.y - moved.x)),
            PointerGesture::Press(from, wheel) => {
                let point = self.orbit.height() / f64::from(area.rect.height().max(1.0));
                let depth = f64::from(from.distance(at)) * point + *wheel;
                if let Some(show) = &mut self.show {
                    show.press_to(depth);
                }
            }
            PointerGesture::Grab(from, point) => {
                let (way, point) = (at - *from, *point);
                let aside = DVec3::new(f64::from(way.x), -f64::from(way.y), 0.0) * point;
                let aside = self.orbit.turn * aside;
                if let Some(show) = &mut self.show {
                    show.pull(aside)?;
                }
            }
            PointerGesture::Cut(way, _) => {
                if way.last().is_none_or(|last| last.distance(at) > 4.0) {
                    way.push(at);
                }
            }
            PointerGesture::Plane(number, hold) => {
                let (number, hold) = (*number, *hold);
                self.drag_handle(number, hold, at, area);
            }
            PointerGesture::Pin => {
                let edits = self.edits();
                if let Some(pick) = self.picked(at, area)?
                    && let Some(show) = &mut self.show
                {
                    show.pin(&pick, edits, false)?;
                }
            }
            PointerGesture::Ruler => {
                if let Some(pick) = self.picked(at, area)?
                    && let Some([_, end]) = &mut self.ruler
                {
                    *end = pick.point;
                }
            }
        }
        Ok(())
    }

    /// Ends the gesture.
    pub(crate) fn end_gesture(&mut self) {
        let stroke = std::mem::take(&mut self.stroke);
        let result = match stroke {
            PointerGesture::Press(..) => {
                if let Some(show) = &mut self.show {
                    show.retract();
                }
                Ok(())
            }
            PointerGesture::Grab(..) => self.show.as_mut().map_or(Ok(()), |show| show.release()),
            PointerGesture::Cut(way, place) => self.cut(&way, place),
            _ => Ok(()),
        };
        self.show_error(result);
    }

    /// Cuts along a stroke, to the selected depth below the surface point where it began.
    fn cut(&mut self, way: &[Pos2], place: DVec3) -> Result<()> {
        let edits = self.edits();
        let (Some(area), Some(show)) = (self.area, &mut self.show) else {
            return Ok(());
        };
        if way.len() < 2 {
            return Ok(());
        }
        let camera = self.orbit.camera();
        let back = self.orbit.turn * DVec3::Z;
        let (above, below) = (show.radius, self.cut_depth * show.diagonal());
        let edges: Vec<[DVec3; 2]> = way
            .iter()
            .map(|at| {
                let ray = camera.ray(area.pixel(*at), area.size);
                let along = (place - ray.origin).dot(back) / ray.direction.dot(back);
                let on = ray.origin + along * ray.direction;
                [on - above * ray.direction, on + below * ray.direction]
            })
            .collect();
        show.cut(Blade::from_sweep(&edges)?, edits);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mouse_bindings_match_paraview_and_slicer() {
        let left = |habit, held| move_of(habit, PointerButton::Primary, held);
        let none = Modifiers::NONE;
        assert_eq!(
            left(MouseBindings::ParaView, none),
            Some(CameraMotion::Orbit)
        );
        assert_eq!(
            left(MouseBindings::Slicer, Modifiers::SHIFT),
            Some(CameraMotion::Pan)
        );
        assert_eq!(
            left(MouseBindings::ParaView, Modifiers::SHIFT),
            Some(CameraMotion::Roll)
        );
        assert_eq!(
            move_of(MouseBindings::Slicer, PointerButton::Middle, none),
            Some(CameraMotion::Pan)
        );
    }
}
