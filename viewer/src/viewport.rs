//! The rectangle of the picture: pixels, rays and projection.

use eframe::egui::{self, Pos2, Rect};
use glam::{DVec2, DVec3};
use palpate::render::{Camera, Ray};

/// The picture within the window.
#[derive(Clone, Copy, Debug)]
pub struct Viewport {
    /// Rectangle in points.
    pub rect: Rect,
    /// Size in pixels.
    pub size: [u32; 2],
}

impl Viewport {
    /// Returns the pixel at a point of the interface.
    pub fn pixel(&self, at: Pos2) -> DVec2 {
        let share = (at - self.rect.min) / self.rect.size();
        DVec2::new(f64::from(share.x), f64::from(share.y))
            * DVec2::new(f64::from(self.size[0]), f64::from(self.size[1]))
    }

    /// Returns the ray through a point of the interface.
    pub fn ray(&self, camera: &Camera, at: Pos2) -> Ray {
        camera.ray(self.pixel(at), self.size)
    }

    /// Projects a point, if it is in front of the eye.
    pub fn project(&self, camera: &Camera, place: DVec3) -> Option<Pos2> {
        let middle = camera.ray(0.5 * DVec2::from(self.size.map(f64::from)), self.size);
        let away = (place - middle.origin).dot(middle.direction);
        if away <= 0.0 {
            return None;
        }
        // The camera's plane at that distance is spanned by the rays through three points of it.
        let at = |x: f64, y: f64| {
            let ray = camera.ray(DVec2::new(x, y), self.size);
            let deep = (ray.origin - middle.origin).dot(middle.direction);
            ray.origin + ray.direction * ((away - deep) / ray.direction.dot(middle.direction))
        };
        let [width, height] = self.size.map(f64::from);
        let (corner, right, down) = (at(0.0, 0.0), at(width, 0.0), at(0.0, height));
        let (u, v) = (right - corner, down - corner);
        let q = place - corner;
        let share = egui::vec2(
            (q.dot(u) / u.length_squared()) as f32,
            (q.dot(v) / v.length_squared()) as f32,
        );
        Some(self.rect.min + share * self.rect.size())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_inverts_rays() {
        let area = Viewport {
            rect: Rect::from_min_size(Pos2::new(100.0, 50.0), egui::vec2(400.0, 300.0)),
            size: [800, 600],
        };
        let (eye, to) = (DVec3::new(1.0, -5.0, 2.0), DVec3::new(0.2, 0.1, 0.0));
        for camera in [
            Camera::perspective(eye, to, DVec3::Z, 35.0),
            Camera::orthographic(eye, to, DVec3::Z, 3.0),
        ] {
            for at in [Pos2::new(120.0, 60.0), Pos2::new(333.0, 290.0)] {
                let ray = camera.ray(area.pixel(at), area.size);
                let place = ray.origin + 4.0 * ray.direction;
                let seen = area.project(&camera, place);
                assert!(
                    seen.is_some_and(|seen| seen.distance(at) < 0.01),
                    "{seen:?}"
                );
            }
            assert!(area.project(&camera, eye - (to - eye)).is_none());
        }
    }
}
