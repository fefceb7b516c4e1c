//! Shapes of tools by their signed distances.

use super::DistanceField;
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// A shape, in a frame of its own.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A ball around the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// All within `radius` of a piece of the z axis, whose middle is the origin.
    Capsule {
        /// Its radius.
        radius: f64,
        /// The length of the piece: that of the capsule without its caps.
        length: f64,
    },
    /// A box around the origin.
    Box {
        /// Half of its edges.
        half: DVec3,
    },
    /// All below the plane z = 0.
    Plane,
    /// Any closed surface.
    Sdf(Arc<DistanceField>),
}

/// Where a point stands to a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceDistance {
    /// Signed distance, negative inside.
    pub distance: f64,
    /// Its gradient: away from the shape, of length 1 (of fields: about 1).
    pub normal: DVec3,
    /// Its second derivatives.
    pub curvature: DMat3,
}

impl Shape {
    /// Where `p` stands to it.
    pub fn surface_distance(&self, p: DVec3) -> SurfaceDistance {
        match self {
            Shape::Sphere { radius } => offset_distance(p, *radius, DMat3::IDENTITY),
            Shape::Capsule { radius, length } => {
                let along = p.z.clamp(-0.5 * length, 0.5 * length);
                // Beside the piece it bends around the axis only.
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

    /// The signed distance of `p`, negative inside.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Shape::Sphere { radius } => p.length() - radius,
            Shape::Sdf(field) => field.distance(p),
            other => other.surface_distance(p).distance,
        }
    }

    /// Half of how thick it is where it is thin: what is moved by less than that at a time comes
    /// out on the side on which it went in. Infinite of a plane.
    pub fn half_thickness(&self) -> f64 {
        match self {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => *radius,
            Shape::Box { half } => half.min_element(),
            Shape::Plane => f64::INFINITY,
            Shape::Sdf(field) => field.spacing(),
        }
    }

    /// How large its features are: a sphere's radius, half of a box's shortest edge. Infinite of a
    /// plane.
    pub fn feature_size(&self) -> f64 {
        match self {
            Shape::Sdf(field) => field.size(),
            other => other.half_thickness(),
        }
    }

    /// The radius of a ball around the origin that has it inside; infinite of a plane.
    pub fn bounding_radius(&self) -> f64 {
        match self {
            Shape::Sphere { radius } => *radius,
            Shape::Capsule { radius, length } => radius + 0.5 * length,
            Shape::Box { half } => half.length(),
            Shape::Plane => f64::INFINITY,
            Shape::Sdf(field) => field.radius(),
        }
    }

    /// The same, so many times as large.
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

/// Of all within `radius` of a place from which the point is `off`; it bends in `across`.
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

    /// The distance by which gradients and second derivatives differ from differences of it.
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
    fn derivatives_are_those_of_the_distance() {
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
                // On the surface there is no distance left.
                let on = p - touch.distance * touch.normal;
                assert!(shape.distance(on).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn inside_is_negative_and_the_way_out_the_shortest() {
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
