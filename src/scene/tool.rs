//! Tools of a scene: shapes, trajectories and surfaces for drawing.

use super::trajectory::RigidTrajectory;
use super::{Scene, ToolEntry};
use crate::mesh::{TetMesh, TriMesh};
use crate::meshing::MeshingConfig;
use crate::number_format::significant;
use crate::physics::{Capability, DistanceField, Shape, Simulator, Tool, ToolId, ToolPose};
use crate::skin::{Skin, SkinColouring};
use crate::{Error, Result};
use glam::{DQuat, DVec3};
use std::path::Path;
use std::sync::Arc;

/// Number of vertices around the circumference of round tools.
const ROUND_SEGMENTS: usize = 48;

/// Default colour of tools.
pub(super) const GREY: [f32; 3] = [0.62, 0.66, 0.7];

/// Width of a drawn plane, over the diagonal of the body.
const PLANE: f64 = 2.0;

/// A tool with its trajectory.
#[derive(Clone, Debug)]
pub(super) struct ToolTrajectory {
    /// Name in reaction files.
    pub name: String,
    pub id: ToolId,
    trajectory: RigidTrajectory,
    at: DVec3,
    turn: DQuat,
}

impl ToolTrajectory {
    /// Returns its pose at `time`.
    pub fn pose(&self, time: f64) -> ToolPose {
        let (turned, moved) = self.trajectory.at(time);
        ToolPose::new(self.at + moved, turned * self.turn)
    }

    /// Removes its trajectory.
    pub fn stop(&mut self) {
        self.trajectory = RigidTrajectory::default();
    }

    /// Whether it moves at all.
    pub fn moves(&self) -> bool {
        self.trajectory.is_moving()
    }
}

impl ToolEntry {
    /// Adds the tool to `body`, and returns a note for the user.
    pub(super) fn add_to(
        &self,
        number: usize,
        body: &mut dyn Simulator,
    ) -> Result<(ToolTrajectory, Option<String>)> {
        let name = self
            .name
            .clone()
            .unwrap_or_else(|| format!("tool{}", number + 1));
        if self.is_dynamic() {
            return Err(Error::Input(format!(
                "the [[tool]] {name} has a mass or a spring, which requires a scene of one simulated tetrahedral body; give it a path instead"
            )));
        }
        let trajectory = RigidTrajectory::new(
            "tool",
            (self.path.as_deref(), self.file.as_deref()),
            (self.rotation.as_deref(), self.axis),
        )?;
        let (at, turn) = self.initial_pose()?;
        let (turned, moved) = trajectory.at(0.0);
        let tool = Tool {
            shape: self.shape()?,
            pose: ToolPose::new(at + moved, turned * turn),
            friction: self.friction.unwrap_or(0.0),
            gap: self.gap,
        };
        let overlap = tool.initial_penetration(body.mesh(), body.topology());
        let note = (overlap.nodes > 0).then(|| {
            format!(
                "{} boundary nodes lie initially up to {} inside the [[tool]] {name}; they are pushed out",
                overlap.nodes,
                significant(overlap.depth)
            )
        });
        let id = Capability::Tools.require(body.contact())?.add_tool(tool)?;
        let guided = ToolTrajectory {
            name,
            id,
            trajectory,
            at,
            turn,
        };
        Ok((guided, note))
    }

    /// Returns its initial position and orientation.
    pub(super) fn initial_pose(&self) -> Result<(DVec3, DQuat)> {
        let along = DVec3::from(self.orientation.unwrap_or([0.0, 0.0, 1.0])).normalize_or_zero();
        let at = DVec3::from(self.at);
        if along == DVec3::ZERO || !at.is_finite() {
            return Err(Error::Input(format!(
                "`at` of a [[tool]] must be a point and `orientation` a direction, got {at} and {:?}",
                self.orientation.unwrap_or_default()
            )));
        }
        Ok((at, DQuat::from_rotation_arc(DVec3::Z, along)))
    }

    pub(super) fn shape(&self) -> Result<Shape> {
        let given = [
            self.sphere.map(|s| Shape::Sphere { radius: s.radius }),
            self.capsule.map(|c| Shape::Capsule {
                radius: c.radius,
                length: c.length,
            }),
            self.cuboid.map(|b| Shape::Box {
                half: 0.5 * DVec3::from(b.size),
            }),
            self.plane.map(|_| Shape::Plane),
        ];
        let mut shapes = given.into_iter().flatten();
        match (shapes.next(), shapes.next(), &self.surface) {
            (Some(shape), None, None) => Ok(shape),
            (None, None, Some(file)) => {
                Ok(Shape::Sdf(Arc::new(DistanceField::new(&read(file)?)?)))
            }
            _ => Err(Error::Input(
                "a [[tool]] must have exactly one of `sphere`, `capsule`, `box`, `plane` and `surface`".into(),
            )),
        }
    }

    /// Returns its surface in its own frame, as drawn for a body of that diagonal.
    pub(super) fn surface(&self, diagonal: f64) -> Result<TriMesh> {
        Ok(match self.shape()? {
            Shape::Sphere { radius } => round(radius, 0.0),
            Shape::Capsule { radius, length } => round(radius, length),
            Shape::Box { half } => cuboid(half),
            Shape::Plane => square(0.5 * PLANE * diagonal),
            Shape::Sdf(_) => match &self.surface {
                Some(file) => read(file)?,
                None => TriMesh::default(),
            },
        })
    }
}

/// Applies the colour and opacity of a tool to its surface.
pub(super) fn apply_appearance(entry: &ToolEntry, skin: &mut Skin) -> Result<()> {
    match &entry.drawn {
        Some(drawn) => skin.set_vertex_colours(&drawn.colours)?,
        None => skin.set_colour(&SkinColouring::Plain(entry.colour.unwrap_or(GREY)))?,
    }
    skin.set_opacity(entry.opacity.unwrap_or(1.0))
}

fn read(file: &Path) -> Result<TriMesh> {
    let recipe = MeshingConfig {
        input: vec![file.to_path_buf()],
        ..MeshingConfig::default()
    };
    recipe.extract_surface(0, &crate::no_progress)
}

impl Scene {
    /// Whether a tool supports the body from below, so that it needs no other support.
    pub(super) fn supports_body(&self) -> bool {
        self.tool.iter().any(|tool| tool.plane.is_some())
    }

    /// Returns the surfaces of the displayed tools in their own frames, with the tools' indices.
    pub(super) fn tool_surfaces(&self, mesh: &TetMesh) -> Result<Vec<(usize, TriMesh)>> {
        let (low, high) = mesh.bounds();
        let drawn = self
            .tool
            .iter()
            .enumerate()
            .filter(|(_, tool)| !tool.hidden);
        drawn
            .map(|(i, tool)| {
                let surface = match &tool.drawn {
                    Some(drawn) => drawn.mesh.clone(),
                    None => tool.surface((high - low).length())?,
                };
                Ok((i, surface))
            })
            .collect()
    }
}

/// Returns a sphere, elongated by `length` along z.
fn round(radius: f64, length: f64) -> TriMesh {
    let rings = ROUND_SEGMENTS / 2;
    let mut vertices = Vec::new();
    // The ring at the equator is duplicated, so that the cylinder between is straight.
    let heights = (0..=rings / 2)
        .map(|k| (k, -0.5))
        .chain((rings / 2..=rings).map(|k| (k, 0.5)));
    for (k, end) in heights {
        let polar = std::f64::consts::PI * k as f64 / rings as f64;
        let (r, z) = (radius * polar.sin(), end * length - radius * polar.cos());
        for n in 0..ROUND_SEGMENTS {
            let angle = std::f64::consts::TAU * n as f64 / ROUND_SEGMENTS as f64;
            vertices.push(DVec3::new(r * angle.cos(), r * angle.sin(), z));
        }
    }
    let mut triangles = Vec::new();
    let all = rings + 2;
    for ring in 0..all - 1 {
        for n in 0..ROUND_SEGMENTS {
            let next = (n + 1) % ROUND_SEGMENTS;
            let at = |ring: usize, n: usize| (ring * ROUND_SEGMENTS + n) as u32;
            let [a, b, c, d] = [
                at(ring, n),
                at(ring, next),
                at(ring + 1, next),
                at(ring + 1, n),
            ];
            // Skip degenerate triangles at the poles and between coinciding equators.
            for t in [[a, b, c], [a, c, d]] {
                let [p, q, r] = t.map(|v| vertices[v as usize]);
                let area: DVec3 = (q - p).cross(r - p);
                if area.length() > 1e-9 * radius * radius {
                    triangles.push(t);
                }
            }
        }
    }
    compact(vertices, triangles)
}

/// Returns a box with separate corners for every side, so that its edges are sharp.
fn cuboid(half: DVec3) -> TriMesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let (u, v) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
            let first = vertices.len() as u32;
            for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                vertices.push(half * (side * DVec3::AXES[axis] + a * u + b * v));
            }
            let corners = match side > 0.0 {
                true => [[0, 1, 2], [0, 2, 3]],
                false => [[0, 2, 1], [0, 3, 2]],
            };
            triangles.extend(corners.map(|t: [u32; 3]| t.map(|k| first + k)));
        }
    }
    TriMesh {
        vertices,
        triangles,
        ..TriMesh::default()
    }
}

fn square(half: f64) -> TriMesh {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    TriMesh {
        vertices: corners.map(|(x, y)| half * DVec3::new(x, y, 0.0)).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriMesh::default()
    }
}

/// Removes unused vertices.
fn compact(vertices: Vec<DVec3>, mut triangles: Vec<[u32; 3]>) -> TriMesh {
    let mut number = vec![u32::MAX; vertices.len()];
    let mut kept = Vec::new();
    for v in triangles.iter_mut().flatten() {
        let own = &mut number[*v as usize];
        if *own == u32::MAX {
            *own = kept.len() as u32;
            kept.push(vertices[*v as usize]);
        }
        *v = *own;
    }
    TriMesh {
        vertices: kept,
        triangles,
        ..TriMesh::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(surface: &TriMesh) -> f64 {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| surface.vertices[v as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        surface.triangles.iter().map(of).sum()
    }

    #[test]
    fn tool_surface_matches_shape() {
        let pi = std::f64::consts::PI;
        let ball = volume(&round(2.0, 0.0)) / (4.0 / 3.0 * pi * 8.0);
        assert!(ball < 1.0 && ball > 0.98, "{ball}");
        let capsule = volume(&round(1.0, 3.0)) / (4.0 / 3.0 * pi + 3.0 * pi);
        assert!(capsule < 1.0 && capsule > 0.98, "{capsule}");
        let block = volume(&cuboid(DVec3::new(1.0, 2.0, 3.0)));
        assert!((block - 48.0).abs() < 1e-12, "{block}");
    }
}
