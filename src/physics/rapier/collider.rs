//! Conversion of tool shapes to rapier's colliders.

use crate::physics::Shape;
use crate::{Error, Result};
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::prelude::{ColliderBuilder, TriMeshFlags};

/// The collider of `shape`, in rapier's units.
///
/// # Errors
/// [`Error::Input`] if rapier rejects the surface.
pub(super) fn collider(shape: &Shape) -> Result<ColliderBuilder> {
    let single = |x: f64| x as f32;
    Ok(match shape {
        Shape::Sphere { radius } => ColliderBuilder::ball(single(*radius)),
        Shape::Capsule { radius, length } => {
            ColliderBuilder::capsule_z(single(0.5 * length), single(*radius))
        }
        Shape::Box { half } => {
            ColliderBuilder::cuboid(single(half.x), single(half.y), single(half.z))
        }
        Shape::Plane => ColliderBuilder::new(rapier3d::prelude::SharedShape::halfspace(Vector::Z)),
        Shape::Sdf(field) => {
            let (vertices, triangles) = field.surface();
            let vertices = vertices.map(|p: DVec3| {
                let [x, y, z] = p.as_vec3().to_array();
                Vector::new(x, y, z)
            });
            ColliderBuilder::trimesh_with_flags(
                vertices.collect(),
                triangles.to_vec(),
                TriMeshFlags::FIX_INTERNAL_EDGES | TriMeshFlags::ORIENTED,
            )
            .map_err(|e| {
                Error::Input(format!(
                    "rapier cannot build a mesh from the surface of a tool: {e}; repair the surface, or use --engine cpu"
                ))
            })?
        }
    })
}
