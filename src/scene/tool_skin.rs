//! Surfaces of tools for drawing, which follow the poses of the tools.

use super::tool::apply_appearance;
use super::{Motion, Scene};
use crate::Result;
use crate::gpu::{Array, Gpu};
use crate::mesh::{LocalFrame, TetMesh};
use crate::physics::ToolPose;
use crate::render::{Camera, local_positions};
use crate::skin::{Skin, SkinBase};
use glam::DVec3;

/// Surface of a tool.
pub(super) struct ToolSkin {
    /// Index of the tool in the scene.
    number: usize,
    /// Vertices in the tool's frame, file units.
    vertices: Vec<DVec3>,
    positions: Array,
    frame: LocalFrame,
    /// Centre and radius of a bounding sphere, in the tool's frame.
    ball: (DVec3, f64),
    /// Pose in which it is drawn.
    pose: ToolPose,
    pub skin: Skin,
}

impl ToolSkin {
    /// Creates the surfaces of the displayed tools of a scene, for a body in the given frame.
    pub fn build_all(
        gpu: &Gpu,
        scene: &Scene,
        (mesh, frame): (&TetMesh, LocalFrame),
        motion: &Motion,
    ) -> Result<Vec<ToolSkin>> {
        let mut drawn = Vec::new();
        for (number, surface) in scene.tool_surfaces(mesh)? {
            let pose = motion.time_dependent_loads.tools[number].pose(motion.time());
            let places: Vec<DVec3> = surface
                .vertices
                .iter()
                .map(|p| pose.transform_point(*p))
                .collect();
            let positions = local_positions(gpu, &frame, &places)?;
            let triangles = &surface.triangles;
            let carrier = SkinBase::with_area_normals(gpu, &positions, frame, &places, triangles)?;
            let mut skin = Skin::body_surface(gpu, &carrier, None)?;
            apply_appearance(&scene.tool[number], &mut skin)?;
            let (low, high) = crate::mesh::bounds(&surface.vertices);
            let middle = 0.5 * (low + high);
            let away = surface.vertices.iter().map(|p| p.distance(middle));
            drawn.push(ToolSkin {
                number,
                ball: (middle, away.fold(0.0, f64::max)),
                vertices: surface.vertices,
                positions,
                frame,
                pose,
                skin,
            });
        }
        Ok(drawn)
    }

    /// Whether any of it can be visible in a picture of that size.
    pub fn is_in_view(&self, camera: &Camera, size: [u32; 2]) -> bool {
        let (middle, radius) = self.ball;
        !camera.is_outside_view((self.pose.transform_point(middle), radius), size)
    }

    /// Moves it to the pose of its tool. Returns whether it has moved.
    pub fn follow(&mut self, gpu: &Gpu, motion: &Motion) -> Result<bool> {
        let tool = &motion.time_dependent_loads.tools[self.number];
        let pose = motion.simulator.loads().tool(tool.id)?;
        if pose == self.pose {
            return Ok(false);
        }
        self.pose = pose;
        let local = |p: &DVec3| {
            self.frame
                .to_local(pose.transform_point(*p))
                .extend(0.0)
                .to_array()
        };
        let places: Vec<[f32; 4]> = self.vertices.iter().map(local).collect();
        gpu.write_array(&self.positions, &places)?;
        Ok(true)
    }
}
