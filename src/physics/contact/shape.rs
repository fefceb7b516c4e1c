//! Shapes of tools, given by their signed distances.

use super::DistanceField;
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// A tool shape in its own frame.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A sphere around the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// All points within `radius` of a segment of the z axis centred at the origin.
    Capsule {
        /// Its radius.
        radius: f64,
        /// Length of the segment: the capsule's length without its caps.
        length: f64,
    },
    /// A box centred at the origin.
    Box {
        /// Half of its edge lengths.
        half: DVec3,
    },
    /// The half-space below the plane z = 0.
    Plane,
    /// A closed surface, given by its distance field.
    Sdf(Arc<DistanceField>),
}

/// The signed distance of a point from a shape, with two derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SurfaceDistance {
    /// Signed distance, negative inside.
    pub distance: f64,
    /// Gradient of the distance, pointing away from the shape: a unit vector (for distance fields
    /// approximately).
    pub normal: DVec3,
    /// Second derivatives of the distance.
    pub curvature: DMat3,
}

impl Shape {
    /// Returns the signed distance of `p` with its gradient and second derivatives.
    pub(crate) fn surface_distance(&self, p: DVec3) -> SurfaceDistance {
        match self {
            Shape::Sphere { radius } => offset_distance(p, *radius, DMat3::IDENTITY),
            Shape::Capsule { radius, length } => {
                let along = p.z.clamp(-0.5 * length, 0.5 * length);
                // Beside the segment the surface curves around the axis only.
                let across = match along == p.z {
                    true => DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)),
                    false => DMat3::IDENTITY,
                };
                offset_distance(p - DVec3::new(0.0, 0.0, along), *radius, across)
            }
            Shape::Box { half } => {
                let sign = DVec3::select(p.cmplt(DVec3::ZERO), DVec3::NEG_ONE, DVec3::ONE);
                let out = p.abs() - *half;
                if out.max_element() <= 0.0 {
                    let k = out.max_position();
                    let mut normal = DVec3::ZERO;
                    normal[k] = sign[k];
                    return plane_distance(out[k], normal);
                }
                let beyond = out.max(DVec3::ZERO);
                let axes = DVec3::select(out.cmpgt(DVec3::ZERO), DVec3::ONE, DVec3::ZERO);
                offset_distance(sign * beyond, 0.0, DMat3::from_diagonal(axes))
            }
            Shape::Plane => plane_distance(p.z, DVec3::Z),
            Shape::Sdf(field) => field.evaluate(p),
        }
    }

    /// Returns the signed distance of `p`, negative inside.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Shape::Sphere { radius } => p.length() - radius,
            Shape::Sdf(field) => field.distance(p),
            other => other.surface_distance(p).distance,
        }
    }

    /// Half of the thickness at the thinnest part; infinite for a plane. A point that moves less
    /// than this in a step leaves on the side on which it entered.
    pub fn half_thickness(&self) -> f64 {
        match self {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => *radius,
            Shape::Box { half } => half.min_element(),
            Shape::Plane => f64::INFINITY,
            Shape::Sdf(field) => field.spacing(),
        }
    }

    /// Characteristic size: a sphere's radius, half of a box's shortest edge. Infinite for a plane.
    pub fn feature_size(&self) -> f64 {
        match self {
            Shape::Sdf(field) => field.size(),
            other => other.half_thickness(),
        }
    }

    /// Radius of the bounding sphere centred at the origin; infinite for a plane.
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Shape::Sphere { radius } => *radius,
            Shape::Capsule { radius, length } => radius + 0.5 * length,
            Shape::Box { half } => half.length(),
            Shape::Plane => f64::INFINITY,
            Shape::Sdf(field) => field.radius(),
        }
    }

    /// Returns the shape scaled by the factor `by`.
    #[must_use]
    pub fn with_scale(&self, by: f64) -> Shape {
        match self {
            Shape::Sphere { radius } => Shape::Sphere {
                radius: by * radius,
            },
            Shape::Capsule { radius, length } => Shape::Capsule {
                radius: by * radius,
                length: by * length,
            },
            Shape::Box { half } => Shape::Box { half: by * *half },
            Shape::Plane => Shape::Plane,
            Shape::Sdf(field) => Shape::Sdf(Arc::new(field.with_scale(by))),
        }
    }
}

fn plane_distance(distance: f64, normal: DVec3) -> SurfaceDistance {
    SurfaceDistance {
        distance,
        normal,
        curvature: DMat3::ZERO,
    }
}

/// Distance from a sphere of `radius`, `off` being the point's offset from its centre; `across`
/// projects onto the directions in which the surface curves.
fn offset_distance(off: DVec3, radius: f64, across: DMat3) -> SurfaceDistance {
    let length = off.length();
    if length <= f64::MIN_POSITIVE {
        return plane_distance(-radius, DVec3::X);
    }
    let normal = off / length;
    let outer = DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
    SurfaceDistance {
        distance: length - radius,
        normal,
        curvature: (across - outer) * (1.0 / length),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest errors of the gradient and of the second derivatives against finite differences.
    pub(crate) fn off(shape: &Shape, p: DVec3) -> (f64, f64) {
        let h = 1e-5;
        let touch = shape.surface_distance(p);
        let (mut slope, mut bend) = (0.0f64, 0.0f64);
        for (axis, column) in DVec3::AXES.into_iter().zip([0, 1, 2]) {
            let (a, b) = (
                shape.surface_distance(p - h * axis),
                shape.surface_distance(p + h * axis),
            );
            let by_value = (b.distance - a.distance) / (2.0 * h);
            let by_slope = (b.normal - a.normal) / (2.0 * h);
            slope = slope.max((by_value - touch.normal[column]).abs());
            bend = bend.max((by_slope - touch.curvature.col(column)).length());
        }
        (slope, bend)
    }

    #[test]
    fn shape_derivatives_match_finite_differences() {
        let shapes = [
            Shape::Sphere { radius: 0.7 },
            Shape::Capsule {
                radius: 0.3,
                length: 0.8,
            },
            Shape::Box {
                half: DVec3::new(0.3, 0.5, 0.2),
            },
            Shape::Plane,
        ];
        for shape in &shapes {
            for p in [
                DVec3::new(0.8, -0.1, 0.15),
                DVec3::new(-0.7, 0.9, 0.6),
                DVec3::new(0.1, 0.2, -1.3),
            ] {
                let (slope, bend) = off(shape, p);
                assert!(slope < 1e-8 && bend < 1e-8, "{shape:?} {p}: {slope} {bend}");
                let touch = shape.surface_distance(p);
                assert!((touch.normal.length() - 1.0).abs() < 1e-12);
                assert!((touch.distance - shape.distance(p)).abs() < 1e-14);
                let twice = shape.with_scale(2.0).surface_distance(2.0 * p);
                assert!((twice.distance - 2.0 * touch.distance).abs() < 1e-12);
                // The projection onto the surface has distance 0.
                let on = p - touch.distance * touch.normal;
                assert!(shape.distance(on).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn distance_inside_is_negative_and_normal_points_to_nearest_face() {
        let block = Shape::Box {
            half: DVec3::new(1.0, 2.0, 3.0),
        };
        let touch = block.surface_distance(DVec3::new(-0.8, 0.5, 1.0));
        assert!((touch.distance + 0.2).abs() < 1e-15);
        assert_eq!(touch.normal, DVec3::NEG_X);
        assert_eq!(
            Shape::Plane
                .surface_distance(DVec3::new(5.0, 6.0, -2.0))
                .distance,
            -2.0
        );
        assert_eq!(
            Shape::Sphere { radius: 2.0 }
                .surface_distance(DVec3::ZERO)
                .distance,
            -2.0
        );
    }
}
