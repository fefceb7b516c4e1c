//! Plane handles in the picture: a square that moves the plane along its normal, and an arrow that
//! tilts it.

use crate::app::App;
use crate::document::set_all;
use crate::panel::plane_table;
use crate::pointer_tool::PointerGesture;
use crate::viewport::Viewport;
use eframe::egui::{self, Color32, Pos2, Shape, Stroke as Line};
use glam::DVec3;
use palpate::render::{Camera, Ray};
use palpate::scene::PlaneEntry;

/// Length of the arrow of a handle, relative to the body's diagonal.
const ARROW: f64 = 0.3;
/// Picking distance of the ends of the arrow, and of its shaft, in points.
const GRAB_RADIUS: f32 = 11.0;
const NEAR_SHAFT: f32 = 6.0;
/// Radius of the knobs at the ends of the arrow, in points.
const KNOB_RADIUS: f32 = 6.5;
/// Minimum angle between a ray and a normal at which the position on the normal is defined.
const MIN_NORMAL_ANGLE: f64 = 0.02;

/// A plane and its handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Handle {
    /// A point on the plane, near the centre of the body.
    pub middle: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Length of the arrow, in file units.
    length: f64,
}

/// The dragged part of a handle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HandlePart {
    /// Moves the plane along its normal; the grabbed position on the normal, from the centre.
    Move(f64),
    /// Tilts the plane about its centre.
    Tilt,
}

impl Handle {
    /// Returns the handle of a plane; `None` for a box.
    fn of(plane: &PlaneEntry, (low, high): (DVec3, DVec3)) -> Option<Handle> {
        let [a, b, c, x, y, z] = plane.clip.or(plane.slice)?;
        let normal = DVec3::new(x, y, z).try_normalize()?;
        let body = 0.5 * (low + high);
        let off = (DVec3::new(a, b, c) - body).dot(normal);
        Some(Handle {
            middle: body + off * normal,
            normal,
            length: ARROW * low.distance(high),
        })
    }

    /// Returns the end of the arrow.
    fn tip(&self) -> DVec3 {
        self.middle + self.length * self.normal
    }

    /// Returns the position on the normal, from the centre, that is nearest to a ray.
    fn along(&self, ray: &Ray) -> Option<f64> {
        let (d, n) = (ray.direction.normalize(), self.normal);
        let across = d.dot(n);
        let apart = 1.0 - across * across;
        if apart < MIN_NORMAL_ANGLE * MIN_NORMAL_ANGLE {
            return None;
        }
        let w = self.middle - ray.origin;
        Some((across * w.dot(d) - w.dot(n)) / apart)
    }

    /// Returns the handle moved so that the position `from` is under a ray; limited to the body's
    /// bounds.
    fn moved(&self, ray: &Ray, from: f64, (low, high): (DVec3, DVec3)) -> Option<Handle> {
        let by = self.along(ray)? - from;
        let body = 0.5 * (low + high);
        let most = 0.5 * (high - low).dot(self.normal.abs());
        let off = (self.middle + by * self.normal - body).dot(self.normal);
        Some(Handle {
            middle: body + off.clamp(-most, most) * self.normal,
            ..*self
        })
    }

    /// Returns the handle tilted about its centre so that the arrow ends under a ray: at the ray's
    /// intersection with the sphere of the arrow, on the same side; at the sphere's rim if the ray
    /// misses it.
    fn tilted(&self, ray: &Ray) -> Option<Handle> {
        let d = ray.direction.normalize();
        let w = self.middle - ray.origin;
        let nearest = ray.origin + w.dot(d) * d;
        let off = nearest - self.middle;
        let deep = self.length * self.length - off.length_squared();
        let to = match deep > 0.0 {
            true if self.normal.dot(d) > 0.0 => off + deep.sqrt() * d,
            true => off - deep.sqrt() * d,
            false => off,
        };
        let normal = to.try_normalize()?;
        Some(Handle { normal, ..*self })
    }

    /// Returns the part at a point of the picture, and its distance.
    fn at(&self, at: Pos2, area: Viewport, camera: &Camera) -> Option<(f32, HandlePart)> {
        let middle = area.project(camera, self.middle)?;
        let tip = area.project(camera, self.tip());
        let from = self.along(&area.ray(camera, at)).unwrap_or(0.0);
        if let Some(away) = tip
            .map(|tip| tip.distance(at))
            .filter(|away| *away <= GRAB_RADIUS)
        {
            return Some((away, HandlePart::Tilt));
        }
        let away = middle.distance(at);
        if away <= GRAB_RADIUS {
            return Some((away, HandlePart::Move(from)));
        }
        let away = distance_to(at, middle, tip?);
        (away <= NEAR_SHAFT).then_some((away, HandlePart::Move(from)))
    }

    /// Returns the values of the scene entry.
    fn values(&self) -> [f64; 6] {
        let ([a, b, c], [x, y, z]) = (self.middle.to_array(), self.normal.to_array());
        [a, b, c, x, y, z]
    }

    /// Returns the polygon in which the plane intersects the body's bounds.
    fn outline(&self, (low, high): (DVec3, DVec3)) -> Vec<DVec3> {
        let corner = |k: usize| {
            let pick = |axis: usize| [low, high][k >> axis & 1][axis];
            DVec3::new(pick(0), pick(1), pick(2))
        };
        let side = |p: DVec3| (p - self.middle).dot(self.normal);
        let mut met = Vec::new();
        for k in 0..8usize {
            for axis in 0..3 {
                let other = k | 1 << axis;
                if other == k {
                    continue;
                }
                let (a, b) = (corner(k), corner(other));
                let (p, q) = (side(a), side(b));
                if (p < 0.0) != (q < 0.0) {
                    met.push(a.lerp(b, p / (p - q)));
                }
            }
        }
        let middle = met.iter().sum::<DVec3>() / met.len().max(1) as f64;
        let (u, v) = self.normal.any_orthonormal_pair();
        let angle = |p: &DVec3| (*p - middle).dot(v).atan2((*p - middle).dot(u));
        met.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        met
    }
}

/// Returns the distance of a point from a segment.
fn distance_to(at: Pos2, from: Pos2, to: Pos2) -> f32 {
    let segment = to - from;
    let share = (at - from).dot(segment) / segment.length_sq().max(f32::MIN_POSITIVE);
    at.distance(from + share.clamp(0.0, 1.0) * segment)
}

impl App {
    /// Returns a point and the normal of each plane, in scene order; for a box its corners.
    pub(crate) fn plane_values(&self) -> Vec<[f64; 6]> {
        let planes = self.scene().map(|scene| scene.plane).unwrap_or_default();
        let values = |p: &PlaneEntry| p.clip.or(p.slice).or(p.around);
        planes.iter().filter_map(values).collect()
    }

    /// Returns the handles of all planes that have one, with the plane's index.
    fn handles(&self) -> Vec<(usize, Handle)> {
        let (Some(show), Some(scene), true) = (&self.show, self.scene(), self.handles_shown) else {
            return Vec::new();
        };
        let planes = scene.plane.iter().enumerate();
        let of = |(n, plane): (usize, &PlaneEntry)| Some((n, Handle::of(plane, show.bounds)?));
        planes.filter_map(of).collect()
    }

    /// Returns the plane whose handle is at a point of the picture, and the part of it.
    pub(crate) fn handle_at(&self, at: Pos2, area: Viewport) -> Option<(usize, HandlePart)> {
        let camera = self.orbit.camera();
        let all = self.handles().into_iter();
        let near = all.filter_map(|(n, handle)| Some((n, handle.at(at, area, &camera)?)));
        let nearest = near.min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        nearest.map(|(n, (_, hold))| (n, hold))
    }

    /// Drags a plane by a part of its handle.
    pub(crate) fn drag_handle(
        &mut self,
        number: usize,
        hold: HandlePart,
        at: Pos2,
        area: Viewport,
    ) {
        let ray = area.ray(&self.orbit.camera(), at);
        let (Some(show), Some(scene)) = (&self.show, self.scene()) else {
            return;
        };
        let mut planes = scene.plane;
        let Some(plane) = planes.get_mut(number) else {
            return;
        };
        let Some(handle) = Handle::of(plane, show.bounds) else {
            return;
        };
        let moved = match hold {
            HandlePart::Move(from) => handle.moved(&ray, from, show.bounds),
            HandlePart::Tilt => handle.tilted(&ray),
        };
        let Some(moved) = moved.filter(|moved| *moved != handle) else {
            return;
        };
        if let Some(values) = plane.clip.as_mut().or(plane.slice.as_mut()) {
            *values = moved.values();
        }
        self.edit_planes("a plane's handle", |t| {
            set_all(t, "plane", planes.iter().map(plane_table).collect());
        });
    }

    /// Draws the handles over the picture.
    pub(crate) fn draw_handles(&self, ui: &egui::Ui, area: Viewport, camera: &Camera) {
        let Some(show) = &self.show else { return };
        let painter = ui.painter_at(area.rect);
        let pointer = ui.input(|i| i.pointer.latest_pos());
        let held = match self.stroke {
            PointerGesture::Plane(number, hold) => Some((number, hold)),
            PointerGesture::Idle => pointer.and_then(|at| self.handle_at(at, area)),
            _ => None,
        };
        for (number, handle) in self.handles() {
            let own = held.filter(|(n, _)| *n == number).map(|(_, hold)| hold);
            let strong = own.is_some();
            let colour = match strong {
                true => ui.visuals().selection.stroke.color,
                false => Color32::from_rgb(230, 159, 0),
            };
            let line = Line::new(if strong { 2.5 } else { 1.5 }, colour);
            let around = handle.outline(show.bounds);
            let around: Option<Vec<Pos2>> =
                around.iter().map(|p| area.project(camera, *p)).collect();
            if let Some(around) = around.filter(|around| around.len() > 2) {
                painter.add(Shape::closed_line(around, Line::new(1.0, colour)));
            }
            let Some(middle) = area.project(camera, handle.middle) else {
                continue;
            };
            let fill = ui.visuals().extreme_bg_color;
            if let Some(tip) = area.project(camera, handle.tip()) {
                painter.line_segment([middle, tip], line);
                let filled = if own == Some(HandlePart::Tilt) {
                    colour
                } else {
                    fill
                };
                painter.circle(tip, KNOB_RADIUS, filled, line);
            }
            let moves = matches!(own, Some(HandlePart::Move(_)));
            let filled = if moves { colour } else { fill };
            let square = egui::Rect::from_center_size(middle, egui::Vec2::splat(2.0 * KNOB_RADIUS));
            painter.rect(square, 2.0, filled, line, egui::StrokeKind::Middle);
        }
        if let Some((_, hold)) = held {
            ui.ctx().set_cursor_icon(match hold {
                HandlePart::Move(_) => egui::CursorIcon::Grab,
                HandlePart::Tilt => egui::CursorIcon::Crosshair,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: (DVec3, DVec3) = (DVec3::new(-1.0, -2.0, -3.0), DVec3::new(1.0, 2.0, 3.0));

    fn handle() -> Handle {
        let plane = PlaneEntry {
            clip: Some([0.5, 7.0, 1.0, 0.0, 0.0, 2.0]),
            ..PlaneEntry::default()
        };
        match Handle::of(&plane, BOUNDS) {
            Some(handle) => handle,
            None => panic!("a clip plane must have a handle"),
        }
    }

    fn ray(origin: DVec3, to: DVec3) -> Ray {
        Ray {
            origin,
            direction: to - origin,
        }
    }

    #[test]
    fn handle_centre_is_body_centre_projected_onto_plane() {
        let handle = handle();
        assert_eq!(handle.middle, DVec3::new(0.0, 0.0, 1.0));
        assert_eq!(handle.normal, DVec3::Z);
        let boxed = PlaneEntry {
            around: Some([0.0; 6]),
            ..PlaneEntry::default()
        };
        assert!(Handle::of(&boxed, BOUNDS).is_none());
    }

    #[test]
    fn dragged_handle_moves_along_normal_within_bounds() {
        let handle = handle();
        let eye = DVec3::new(9.0, 4.0, 2.0);
        let held = DVec3::new(0.0, 0.0, 1.4);
        let Some(from) = handle.along(&ray(eye, held)) else {
            panic!("a ray across the normal must give a position");
        };
        assert!((from - 0.4).abs() < 1e-12);
        let to = |z: f64| handle.moved(&ray(eye, DVec3::new(0.0, 0.0, z)), from, BOUNDS);
        let moved = to(-0.6).map(|m| (m.middle, m.normal));
        let Some((middle, normal)) = moved else {
            panic!("the handle must move");
        };
        assert!(middle.distance(DVec3::new(0.0, 0.0, -1.0)) < 1e-12 && normal == DVec3::Z);
        assert!(to(99.0).is_some_and(|m| (m.middle.z - 3.0).abs() < 1e-12));
        // A ray along the normal has no position.
        assert!(
            handle
                .along(&ray(DVec3::new(0.0, 0.0, 9.0), DVec3::ZERO))
                .is_none()
        );
    }

    #[test]
    fn tilted_arrow_ends_under_pointer() {
        let handle = handle();
        let eye = DVec3::new(9.0, 0.0, 1.0);
        // A position on the sphere of the arrow, on the side of the eye.
        let wanted = DVec3::new(1.0, 1.0, 1.0).normalize();
        let place = handle.middle + handle.length * wanted;
        let towards = Handle {
            normal: DVec3::X,
            ..handle
        };
        let tilted = towards.tilted(&ray(eye, place));
        assert!(
            tilted.is_some_and(|t| t.normal.distance(wanted) < 1e-9),
            "{tilted:?}"
        );
        assert!(tilted.is_some_and(|t| t.middle == handle.middle));
        // A ray outside the sphere tilts the arrow to the silhouette.
        let aside = ray(eye, DVec3::new(0.0, 5.0, 1.0));
        let beside = towards.tilted(&aside);
        let across = |t: Handle| t.normal.y > 0.8 && t.normal.dot(aside.direction).abs() < 1e-9;
        assert!(beside.is_some_and(across), "{beside:?}");
    }

    #[test]
    fn outline_is_plane_section_of_bounds() {
        let around = handle().outline(BOUNDS);
        assert_eq!(around.len(), 4);
        let length: f64 = (0..4)
            .map(|k| around[k].distance(around[(k + 1) % 4]))
            .sum();
        assert!((length - 12.0).abs() < 1e-12, "{around:?}");
        let tilted = Handle {
            normal: DVec3::new(6.0, 3.0, 2.0).normalize(),
            middle: DVec3::ZERO,
            ..handle()
        };
        assert_eq!(tilted.outline(BOUNDS).len(), 6);
    }
}
